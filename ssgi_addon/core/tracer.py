# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through a depth field: which surface does each one meet?

A ray is a straight line in (x, y, q). It walks the level-0 cells that it crosses, without the origin's own.
With h = q_ray - q_front inside a cell (linear, like both terms), and the slab reaching `slab` behind the front:

- h > 0 on entry, h <= 0 on exit: it meets the front from outside. Facing it: HIT at the crossing.
- -slab <= h <= 0 on entry: it is inside. No deeper than `reach` (the step between two pixels of one
  surface) and facing the surface: HIT on entry; otherwise BLOCKED.
- h < -slab on entry, h >= -slab on exit: it enters from behind, BLOCKED.
- otherwise it passes in front or behind and goes on.

Within two pixels of the origin a front that faces away is self-contact and is passed over.
A ray that reaches its vanishing point inside a background cell ESCAPES; any other end is UNKNOWN.

The pyramid skips cells that the ray passes wholly in front of (nearest) or wholly behind (farthest); the
farthest bound is what keeps rays with finite thickness from crawling behind every foreground object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera import Camera
from .depth_field import DepthField
from .types import BoolArray, FloatArray, IntArray

UNKNOWN, BLOCKED, ESCAPED, HIT = 0, 1, 2, 3

# Rays are handed to the walk in groups of one direction octant; larger groups fall out of the cache.
GROUP_SIZE = 65536
# The walk drops finished rays from its arrays every so many steps: each compaction costs about one step.
_COMPACT_EVERY = 5
_SELF_CONTACT_PX = 2
_DEFAULT_STEPS = 4096
# A ray straight at the camera never leaves its cell: any finite end does, and keeps 0 * inf out.
_STRAIGHT_AT_CAMERA = 1e30


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
        Distance along the ray in units of its direction's length, where it hit or was blocked; +inf elsewhere.
    """

    status: np.ndarray
    pixel: IntArray
    distance: FloatArray


@dataclass(frozen=True, eq=False)
class ScreenRays:
    """Rays as lines (x, y, q)(s) = start + s * velocity.

    They lie over the frame from ``s_begin`` on (0 where they start there, +inf where they never do), reach
    q_end at ``s_vanish`` and their largest distance at ``s_limit``.
    """

    start: tuple[FloatArray, FloatArray, FloatArray]
    velocity: tuple[FloatArray, FloatArray, FloatArray]
    s_begin: FloatArray
    s_vanish: FloatArray
    s_limit: FloatArray


def project_rays(
    field: DepthField, origin_vs: FloatArray, direction_vs: FloatArray, max_distance: float = np.inf
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
    max_distance
        Largest t.
    """
    camera = field.camera
    ox, oy, oz = origin_vs
    dx, dy, dz = direction_vs
    depth = -oz
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if camera.is_orthographic:
            q, inverse = -depth, 1.0
            vx, vy, vq = camera.fx * dx, -camera.fy * dy, dz
            s_vanish = np.where(vq < 0.0, (field.q_end - q) / vq, np.inf)
            s_limit = np.full_like(vx, max_distance)
        else:
            q = 1.0 / depth
            inverse = q
            slope = -dz * q
            vx, vy, vq = camera.fx * (dx - ox * slope), -camera.fy * (dy - oy * slope), -slope
            s_vanish = np.where(dz < 0.0, -1.0 / dz, np.inf)
            s_limit = max_distance * q / (1.0 + max_distance * slope) if np.isfinite(max_distance) else s_vanish
            s_limit = np.where(s_limit > 0.0, s_limit, np.inf)
        x, y = camera.cx + camera.fx * ox * inverse, camera.cy - camera.fy * oy * inverse
        s_begin = _entry_into_frame(camera, (x, y), (vx, vy))
    return ScreenRays((x, y, q), (vx, vy, vq), s_begin, s_vanish, s_limit)


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
    return s_begin


def trace_rays(
    field: DepthField,
    origin_vs: FloatArray,
    direction_vs: FloatArray,
    *,
    max_distance: float = np.inf,
    max_steps: int = _DEFAULT_STEPS,
) -> TraceResult:
    """Find the first surface of the field along each ray.

    Parameters
    ----------
    field
        Slabs and pyramid; one built with ``max_level=0`` gives the linear walk and the same hits.
    origin_vs, direction_vs : (3, N)
        View-space origins and directions, one row per component. The cell under an origin is not tested.
    max_distance
        In units of the directions' length.
    max_steps
        Cells that a ray may visit; a ray out of budget is UNKNOWN.
    """
    count = origin_vs.shape[1]
    dtype = origin_vs.dtype
    result = TraceResult(
        np.zeros(count, dtype=np.int8), np.full(count, -1, dtype=np.int64), np.full(count, np.inf, dtype=dtype)
    )
    rays = project_rays(field, origin_vs, direction_vs, max_distance)
    octant = (
        (rays.velocity[0] < 0.0).astype(np.uint8)
        + 2 * (rays.velocity[1] < 0.0).astype(np.uint8)
        + 4 * (rays.velocity[2] < 0.0).astype(np.uint8)
    )
    octant[~(rays.s_begin < np.inf)] = 8  # never over the frame
    order = np.argsort(octant, kind="stable")
    bounds = np.searchsorted(octant.take(order), np.arange(9))
    for group in range(8):
        for begin in range(bounds[group], bounds[group + 1], GROUP_SIZE):
            members = order[begin : min(begin + GROUP_SIZE, bounds[group + 1])]
            _Walk(field, rays, direction_vs, members, group, result).run(max_steps)
    return result


class _Walk:
    """The walk of one group of rays whose velocities share their signs.

    Coordinates are mirrored so that every ray moves toward +x and +y, which leaves one rule for cell
    borders and makes the walk exactly symmetric under flips of the image.
    """

    def __init__(
        self,
        field: DepthField,
        rays: ScreenRays,
        direction_vs: FloatArray,
        members: IntArray,
        octant: int,
        result: TraceResult,
    ) -> None:
        self.field, self.result, self.direction_vs = field, result, direction_vs
        self.flip_x, self.flip_y = bool(octant & 1), bool(octant & 2)
        self.is_receding = bool(octant & 4)  # q falls along the ray
        # Atlas index of the mirrored cell (0, 0) of each level.
        level = np.arange(field.levels, dtype=np.int64)
        self.base = field.origins.copy()
        if self.flip_x:
            self.base += (field.padded_width >> level) - 1
        if self.flip_y:
            self.base += ((field.padded_height >> level) - 1) * field.stride
        self.id = members
        x, y, self.q0 = (component.take(members) for component in rays.start)
        vx, vy, self.vq = (component.take(members) for component in rays.velocity)
        self.x0 = field.padded_width - x if self.flip_x else x
        self.y0 = field.padded_height - y if self.flip_y else y
        self.vx, self.vy = np.abs(vx), np.abs(vy)
        with np.errstate(divide="ignore"):
            self.ivx, self.ivy = 1.0 / self.vx, 1.0 / self.vy
        self.s = rays.s_begin.take(members)
        s_vanish = rays.s_vanish.take(members)
        self.s_end = np.minimum(np.minimum(s_vanish, rays.s_limit.take(members)), self._exit_from_frame())
        self.is_vanishing = (self.s_end == s_vanish) & (self.s < self.s_end)
        self._enter_first_cell()

    # Arrays with one entry per ray that is still walking.
    _STATE = ("id", "x0", "y0", "q0", "vx", "vy", "vq", "ivx", "ivy", "s", "s_end", "is_vanishing", "ix", "iy", "level")

    def _exit_from_frame(self) -> FloatArray:
        """Return s at the frame's border, by the expression that the walk uses for cell borders."""
        width, height = self.field.camera.width, self.field.camera.height
        limit_x = self.field.padded_width if self.flip_x else width
        limit_y = self.field.padded_height if self.flip_y else height
        with np.errstate(invalid="ignore"):
            s_exit = np.fmin((limit_x - self.x0) * self.ivx, (limit_y - self.y0) * self.ivy)
        return np.fmin(s_exit, _STRAIGHT_AT_CAMERA)

    def _enter_first_cell(self) -> None:
        """Step out of the origin's own cell; rays that come in from outside start in the border cell."""
        begins_inside = self.s == 0.0
        self.ix = np.floor(self.x0 + self.vx * self.s).astype(np.int64)
        self.iy = np.floor(self.y0 + self.vy * self.s).astype(np.int64)
        self.ix.clip(0, self.field.padded_width - 1, out=self.ix)
        self.iy.clip(0, self.field.padded_height - 1, out=self.iy)
        self.level = np.zeros(self.ix.shape[0], dtype=np.int64)
        s_x = (self.ix + 1 - self.x0) * self.ivx
        s_y = (self.iy + 1 - self.y0) * self.ivy
        s_out = np.minimum(np.minimum(s_x, s_y), self.s_end)
        self.ix += begins_inside & (s_x <= s_out)
        self.iy += begins_inside & (s_y <= s_out)
        self.s = np.where(begins_inside, s_out, self.s).astype(self.s_end.dtype)

    def run(self, max_steps: int) -> None:
        """Walk all rays to their ends and write the results."""
        is_walking = self.s < self.s_end
        self._finish(np.flatnonzero(~is_walking))
        is_walking = self._compact(is_walking)
        top = self.field.levels - 1
        for step in range(1, max_steps + 1):
            if self.id.shape[0] == 0:
                return
            is_clear, cell, s_out, s_x, s_y = self._test_cells()
            # At level 0 look into the slab itself
            leaf = np.flatnonzero((self.level == 0) & ~is_clear & is_walking)
            stopped = leaf[self._meet_slabs(leaf, s_out.take(leaf))] if leaf.size else leaf
            is_walking[stopped] = False
            # Leave the cell where nothing was met, else descend
            is_leaving = is_clear | (self.level == 0)
            ended = np.flatnonzero(is_leaving & is_walking & (s_out >= self.s_end))
            if ended.size:
                self._finish(ended)
                is_walking[ended] = False
            self._advance(is_leaving, s_out, s_x, s_y)
            np.minimum(self.level + np.where(is_leaving, 1, -1), top, out=self.level)
            if step % _COMPACT_EVERY == 0:
                is_walking = self._compact(is_walking)

    def _test_cells(self) -> tuple[BoolArray, IntArray, FloatArray, FloatArray, FloatArray]:
        """Tell for each ray whether it passes its current cell wholly in front of or wholly behind."""
        field = self.field
        column, row = self.ix >> self.level, self.iy >> self.level
        s_x = ((column + 1 << self.level) - self.x0) * self.ivx
        s_y = ((row + 1 << self.level) - self.y0) * self.ivy
        s_out = np.minimum(s_x, s_y)
        np.minimum(s_out, self.s_end, out=s_out)
        row *= field.stride
        cell = self.base.take(self.level)
        cell = cell - row if self.flip_y else cell + row
        cell = cell - column if self.flip_x else cell + column
        q_in, q_out = self.q0 + self.vq * self.s, self.q0 + self.vq * s_out
        q_low, q_high = (q_out, q_in) if self.is_receding else (q_in, q_out)
        is_clear = q_low > field.atlas_nearest.take(cell, mode="clip")
        is_clear |= q_high < field.atlas_farthest.take(cell, mode="clip")
        return is_clear, cell, s_out, s_x, s_y

    def _meet_slabs(self, leaf: IntArray, s_out: FloatArray) -> BoolArray:
        """Test rays against their level-0 cell; write hits and blocks, return which rays stopped."""
        field = self.field
        s_in = self.s.take(leaf)
        ix, iy = self.ix.take(leaf), self.iy.take(leaf)
        dx_in = self.x0.take(leaf) - (ix + 0.5)
        dy_in = self.y0.take(leaf) - (iy + 0.5)
        vx, vy, vq = self.vx.take(leaf), self.vy.take(leaf), self.vq.take(leaf)
        x = np.clip(field.padded_width - 1 - ix if self.flip_x else ix, 0, field.camera.width - 1)
        y = np.clip(field.padded_height - 1 - iy if self.flip_y else iy, 0, field.camera.height - 1)
        pixel = y * field.camera.width + x
        gx, gy = field.gradient_x.take(pixel), field.gradient_y.take(pixel)
        if self.flip_x:
            gx = -gx
        if self.flip_y:
            gy = -gy
        # h(s) = h0 + s * dh: how far in front of the patch's plane the ray is, in q
        h0 = self.q0.take(leaf) - field.front.take(pixel) - gx * dx_in - gy * dy_in
        dh = vq - gx * vx - gy * vy
        h_in, h_out = h0 + dh * s_in, h0 + dh * s_out
        slab = field.slab.take(pixel)
        is_surface = ~field.is_background.take(pixel)
        crosses = (h_in > 0.0) & (h_out <= 0.0) & is_surface
        is_inside = (h_in <= 0.0) & (h_in >= -slab) & is_surface
        from_behind = (h_in < -slab) & (h_out >= -slab) & is_surface
        candidate = np.flatnonzero(crosses | is_inside | from_behind)
        stops = np.zeros(leaf.shape[0], dtype=np.bool_)
        if candidate.size == 0:
            return stops
        pixel, ray = pixel.take(candidate), self.id.take(leaf.take(candidate))
        crosses = crosses.take(candidate)
        h_in, dh, s_in = h_in.take(candidate), dh.take(candidate), s_in.take(candidate)
        faces = self._facing(pixel, ray) < 0.0
        is_own = ~faces & self._near_origin(leaf.take(candidate), ix.take(candidate), iy.take(candidate))
        # The step between two pixels of one surface is part of its front
        is_step = is_inside.take(candidate) & (h_in >= -field.reach.take(pixel))
        is_hit = faces & (crosses | is_step)
        with np.errstate(divide="ignore", invalid="ignore"):
            s_hit = np.where(crosses, s_in - h_in / dh, s_in)
        is_kept = ~is_own
        self._write(
            ray[is_kept],
            np.where(is_hit, HIT, BLOCKED)[is_kept],
            pixel[is_kept],
            self._distance(leaf.take(candidate), s_hit)[is_kept],
        )
        stops[candidate[is_kept]] = True
        return stops

    def _facing(self, pixel: IntArray, ray: IntArray) -> FloatArray:
        """Return n . D: negative where the ray comes toward the surface's front."""
        normal = self.field.normal.take(pixel, axis=0)
        dx, dy, dz = (component.take(ray) for component in self.direction_vs)
        return normal[:, 0] * dx + normal[:, 1] * dy + normal[:, 2] * dz

    def _near_origin(self, ray: IntArray, ix: IntArray, iy: IntArray) -> BoolArray:
        away_x = np.abs(ix - np.floor(self.x0.take(ray)))
        away_y = np.abs(iy - np.floor(self.y0.take(ray)))
        return np.maximum(away_x, away_y) <= _SELF_CONTACT_PX

    def _distance(self, ray: IntArray, s: FloatArray) -> FloatArray:
        """Convert s back to distance: t = s / q(s), orthographic t = s."""
        if self.field.camera.is_orthographic:
            return s
        return s / (self.q0.take(ray) + self.vq.take(ray) * s)

    def _write(self, ray: IntArray, status: FloatArray, pixel: IntArray, distance: FloatArray) -> None:
        self.result.status[ray] = status
        self.result.pixel[ray] = pixel
        self.result.distance[ray] = distance

    def _finish(self, ended: IntArray) -> None:
        """Rays at their vanishing point escape if they are over background; all others stay UNKNOWN."""
        ended = ended[self.is_vanishing.take(ended)]
        s = self.s_end.take(ended)
        ix = np.floor(self.x0.take(ended) + self.vx.take(ended) * s).astype(np.int64)
        iy = np.floor(self.y0.take(ended) + self.vy.take(ended) * s).astype(np.int64)
        camera = self.field.camera
        x = np.clip(self.field.padded_width - 1 - ix if self.flip_x else ix, 0, camera.width - 1)
        y = np.clip(self.field.padded_height - 1 - iy if self.flip_y else iy, 0, camera.height - 1)
        escapes = self.field.is_background.take(y * camera.width + x)
        self.result.status[self.id.take(ended[escapes])] = ESCAPED

    def _advance(self, is_leaving: BoolArray, s_out: FloatArray, s_x: FloatArray, s_y: FloatArray) -> None:
        """Move the leaving rays to the first level-0 cell beyond the cell that they leave."""
        last_x = ((self.ix >> self.level) + 1) << self.level
        last_y = ((self.iy >> self.level) + 1) << self.level
        with np.errstate(invalid="ignore", over="ignore"):
            x = np.floor(self.x0 + self.vx * s_out)
            y = np.floor(self.y0 + self.vy * s_out)
            x = np.minimum(np.maximum(x, self.ix), last_x - 1)
            y = np.minimum(np.maximum(y, self.iy), last_y - 1)
        x = np.where(s_x <= s_out, last_x, x)
        y = np.where(s_y <= s_out, last_y, y)
        np.copyto(self.ix, x.astype(np.int64), where=is_leaving)
        np.copyto(self.iy, y.astype(np.int64), where=is_leaving)
        np.copyto(self.s, s_out, where=is_leaving)

    def _compact(self, is_walking: BoolArray) -> BoolArray:
        """Drop the rays that have ended."""
        kept = np.flatnonzero(is_walking)
        if kept.shape[0] < is_walking.shape[0]:
            for name in self._STATE:
                setattr(self, name, getattr(self, name).take(kept))
        return np.ones(kept.shape[0], dtype=np.bool_)
