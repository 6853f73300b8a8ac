# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays as straight lines in screen space, and where they ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .camera import Camera
from .depth_field import DepthField
from .types import FloatArray, IntArray, StatusArray

UNKNOWN, BLOCKED, ESCAPED, HIT = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class TraceResult:
    """Where each of N rays ended.

    Attributes
    ----------
    status : (N,) int8
        UNKNOWN, BLOCKED, ESCAPED or HIT.
    pixel : (N,) int64
        Flat index of the pixel that was hit or that blocked the ray; -1 where there is none.
    distance : (N,) float32
        How far the ray was followed, in units of its direction's length: to the hit, to what blocked it, or
        to where it left the frame or reached its largest distance; +inf for rays that vanish.
    x_px, y_px : (N,) float32
        Where in the image the ray met that pixel, in pixels from the left and the top; 0 where there is none.
    hidden : (N,) float32
        Distance from which on the ray was out of sight: where it came into the first cell that it passed
        wholly behind, or just before it entered a slab other than through its front. +inf for rays that
        stayed in sight, and where nobody asked.
    """

    status: StatusArray
    pixel: IntArray
    distance: FloatArray
    x_px: FloatArray
    y_px: FloatArray
    hidden: FloatArray

    @classmethod
    def empty(cls, count: int, dtype: np.dtype) -> TraceResult:
        """Return a result in which no ray has been followed."""
        return cls(
            np.zeros(count, dtype=np.int8),
            np.full(count, -1, dtype=np.int64),
            np.full(count, np.inf, dtype=dtype),
            np.zeros(count, dtype=dtype),
            np.zeros(count, dtype=dtype),
            np.full(count, np.inf, dtype=dtype),
        )


@dataclass(frozen=True, eq=False)
class ScreenRays:
    """Rays as lines (x, y, q)(s) = start + s * velocity.

    They lie over the frame from ``s_begin`` on (0 where they start there, +inf where they never do), reach
    q_end at ``s_vanish`` and their largest distance at ``s_limit``; ``field`` is the index, in its stack, of
    the field that each one walks.
    """

    start: tuple[FloatArray, FloatArray, FloatArray]
    velocity: tuple[FloatArray, FloatArray, FloatArray]
    s_begin: FloatArray
    s_vanish: FloatArray
    s_limit: FloatArray
    field: IntArray

    def entry_distance(self, is_orthographic: bool) -> FloatArray:
        """Return the distance at which each ray comes over the frame, in units of its direction's length."""
        if is_orthographic:
            return self.s_begin
        with np.errstate(divide="ignore", invalid="ignore"):
            distance: FloatArray = self.s_begin / (self.start[2] + self.velocity[2] * self.s_begin)
        return distance

    def run(self, where: slice) -> ScreenRays:
        """Return consecutive rays."""
        (x, y, q), (vx, vy, vq) = self.start, self.velocity
        return ScreenRays(
            (x[where], y[where], q[where]),
            (vx[where], vy[where], vq[where]),
            self.s_begin[where],
            self.s_vanish[where],
            self.s_limit[where],
            self.field[where],
        )

    def only(self, chosen: IntArray) -> ScreenRays:
        """Return some of the rays."""
        (x, y, q), (vx, vy, vq) = self.start, self.velocity
        return ScreenRays(
            (x.take(chosen), y.take(chosen), q.take(chosen)),
            (vx.take(chosen), vy.take(chosen), vq.take(chosen)),
            self.s_begin.take(chosen),
            self.s_vanish.take(chosen),
            self.s_limit.take(chosen),
            self.field.take(chosen),
        )

    @classmethod
    def joined(cls, parts: Sequence[ScreenRays]) -> ScreenRays:
        """Return the rays of all parts, one after another."""
        x, y, q = (np.concatenate([part.start[i] for part in parts]) for i in range(3))
        vx, vy, vq = (np.concatenate([part.velocity[i] for part in parts]) for i in range(3))
        return cls(
            (x, y, q),
            (vx, vy, vq),
            np.concatenate([part.s_begin for part in parts]),
            np.concatenate([part.s_vanish for part in parts]),
            np.concatenate([part.s_limit for part in parts]),
            np.concatenate([part.field for part in parts]),
        )


def project_rays(
    field: DepthField,
    origin_vs: FloatArray,
    direction_vs: FloatArray,
    max_distance: float | FloatArray = np.inf,
    index: int = 0,
) -> ScreenRays:
    """Express view-space rays as lines in (x, y, q).

    With P(t) = O + t D, depth d(t) = d0 + t dd and s = t q(t), both the pixel position and q are linear in s
    (the perspective-correct interpolation of a line); orthographic rays have s = t.

    Parameters
    ----------
    field
        The field that they will walk.
    origin_vs, direction_vs : (3, N)
        View space, one row per component; origins in front of the camera.
    max_distance : float or (N,)
        Largest t.
    index
        Of the field in its stack.
    """
    camera = field.camera
    ox, oy, oz = origin_vs
    dx, dy, dz = direction_vs
    depth = -oz
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if camera.is_orthographic:
            q, inverse = -depth, 1.0
            vx, vy, vq = camera.fx * dx, -camera.fy * dy, dz
            s_vanish = np.where(vq < 0.0, (field.q_end - q) / vq, np.inf).astype(vq.dtype)
            # Nothing behind the camera's plane is in its sight
            to_plane = np.where(vq > 0.0, -q / vq, np.inf)
            s_limit = np.minimum(max_distance, to_plane).astype(vx.dtype)
        else:
            q = 1.0 / depth
            inverse = q
            slope = -dz * q
            vx, vy, vq = camera.fx * (dx - ox * slope), -camera.fy * (dy - oy * slope), -slope
            s_vanish = np.where(dz < 0.0, -1.0 / dz, np.inf).astype(vq.dtype)
            s_limit = max_distance * q / (1.0 + max_distance * slope)
            s_limit = np.where(s_limit >= 0.0, s_limit, np.inf).astype(vx.dtype)  # NaN for +inf: no limit
        x, y = camera.cx + camera.fx * ox * inverse, camera.cy - camera.fy * oy * inverse
        s_begin = _entry_into_frame(camera, (x, y), (vx, vy))
    indices = np.full(s_begin.shape, index, dtype=np.int64)
    return ScreenRays((x, y, q), (vx, vy, vq), s_begin, s_vanish, s_limit, indices)


def _entry_into_frame(
    camera: Camera, start: tuple[FloatArray, FloatArray], velocity: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Return s at which each ray first lies over the frame: 0 from within, +inf for never."""
    s_begin = np.zeros_like(start[0])
    for position, speed, size in zip(start, velocity, (camera.width, camera.height), strict=True):
        to_border = np.where(position < 0.0, -position, size - position) / speed
        is_outside = (position < 0.0) | (position > size)
        enters = is_outside & (to_border > 0.0)
        s_begin = np.maximum(s_begin, np.where(enters, to_border, np.where(is_outside, np.inf, 0.0)))
    # Past a corner: out of the frame's height before it is within its width, or the other way round
    s_begin = np.where(s_begin < _exit_from_frame(camera, start, velocity), s_begin, np.inf)
    return s_begin.astype(start[0].dtype)


def _exit_from_frame(
    camera: Camera, start: tuple[FloatArray, ...], velocity: tuple[FloatArray, ...]
) -> FloatArray:
    """Return s at which each ray last lies within both the frame's width and its height, +inf for no end."""
    s_exit = np.full_like(start[0], np.inf)
    for position, speed, size in zip(start, velocity, (camera.width, camera.height)):
        border = (np.where(speed > 0.0, float(size), 0.0) - position) / speed
        s_exit = np.minimum(s_exit, np.where(speed == 0.0, np.inf, border))
    return s_exit


def pass_through(
    field: DepthField, origin_vs: FloatArray, direction_vs: FloatArray, max_distance: float = np.inf
) -> TraceResult:
    """Follow rays that nothing of their view stops: each vanishes within the frame, or leaves it.

    The parameters are those of `project_rays`. What vanishes over background ESCAPES; all else is UNKNOWN,
    followed to the frame's border or to the largest distance, or to no finite distance.
    """
    camera = field.camera
    rays = project_rays(field, origin_vs, direction_vs, max_distance)
    result = TraceResult.empty(direction_vs.shape[1], direction_vs.dtype)
    with np.errstate(divide="ignore", invalid="ignore"):
        s_end = np.minimum(_exit_from_frame(camera, rays.start, rays.velocity), rays.s_limit)
        distance = s_end if camera.is_orthographic else s_end / (rays.start[2] + s_end * rays.velocity[2])
    stays = rays.s_vanish <= s_end
    result.distance[:] = np.where(stays, np.inf, distance)
    gone = np.flatnonzero(stays & np.isfinite(rays.s_vanish))
    x, y = (
        np.clip(start.take(gone) + velocity.take(gone) * rays.s_vanish.take(gone), 0, size - 1).astype(
            np.int64
        )
        for start, velocity, size in zip(rays.start, rays.velocity, (camera.width, camera.height))
    )
    result.status[gone[field.is_background.take(y * camera.width + x)]] = ESCAPED
    return result
