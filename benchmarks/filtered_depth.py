# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through depths that are filtered between pixels: what the patches of the tracer are compared with.

Two meanings of a depth buffer:

- bilinear: one surface through all pixels' centres, linear in q between them;
- pair: a ray is behind the surface once it is behind both the bilinear and the unfiltered depth (Stachowiak,
  kajiya 2023, and after it Bevy's screen-space reflections). The bilinear one takes the staircase away, the
  unfiltered one lets rays pass between a silhouette and what lies behind it.

Published marches take some tens of steps and accept every hit within the thickness. Here each cell on the
way is sampled several times and the crossing is refined by bisection. Fronts that face away, and slabs that
are entered from behind, stop a ray as they do in the tracer: what differs is the meaning of depth alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssgi_addon.core import tracer
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.types import BoolArray, FloatArray, IntArray

# Samples of a ray within one cell, the one where it enters included.
_SAMPLES = 5
_BISECTIONS = 24
_SELF_CONTACT_PX = 2
# Rays that walk at once.
_CHUNK = 16384


@dataclass(frozen=True, eq=False)
class FilteredDepth:
    """The depth of a field between its pixels' centres."""

    field: DepthField
    q: FloatArray
    is_pair: bool

    @classmethod
    def of(cls, field: DepthField, *, is_pair: bool) -> FilteredDepth:
        """Take the pixels' depths from a depth field."""
        q = np.where(field.is_background, field.q_end, field.front).astype(np.float64)
        return cls(field, q, is_pair)

    def surface(self, x_px: FloatArray, y_px: FloatArray, pixel: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return q of the surface, and of the nearer of what it is made of, at places within pixels."""
        width, height = self.field.camera.width, self.field.camera.height
        x, y = np.clip(x_px - 0.5, 0.0, width - 1.0), np.clip(y_px - 0.5, 0.0, height - 1.0)
        left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
        u, v = x - left, y - top
        above = self.q.take(top * width + left) * (1.0 - u) + self.q.take(top * width + right) * u
        below = self.q.take(bottom * width + left) * (1.0 - u) + self.q.take(bottom * width + right) * u
        bilinear = above * (1.0 - v) + below * v
        if not self.is_pair:
            return bilinear, bilinear
        unfiltered = self.q.take(pixel)
        return np.minimum(bilinear, unfiltered), np.maximum(bilinear, unfiltered)


def trace_filtered(
    depth: FilteredDepth, origin_vs: FloatArray, direction_vs: FloatArray
) -> tracer.TraceResult:
    """Find where rays that start on surfaces first go behind a filtered depth.

    Parameters
    ----------
    depth
        What the rays walk over.
    origin_vs, direction_vs : (3, N)
        View-space origins and directions.
    """
    result = tracer.TraceResult.empty(origin_vs.shape[1], np.dtype(np.float64))
    for begin in range(0, origin_vs.shape[1], _CHUNK):
        ids = np.arange(begin, min(begin + _CHUNK, origin_vs.shape[1]))
        rays = tracer.project_rays(
            depth.field, origin_vs[:, ids].astype(np.float64), direction_vs[:, ids].astype(np.float64)
        )
        _March(depth, rays, direction_vs[:, ids], ids, result).run()
    return result


class _March:
    """Rays on their way from cell to cell, all of them one cell at a time."""

    def __init__(
        self,
        depth: FilteredDepth,
        rays: tracer.ScreenRays,
        direction_vs: FloatArray,
        ids: IntArray,
        result: tracer.TraceResult,
    ) -> None:
        self.depth, self.result, self.ids = depth, result, ids
        self.start, self.velocity = np.stack(rays.start), np.stack(rays.velocity)
        self.direction, self.s_vanish = direction_vs, rays.s_vanish
        self.home = np.floor(self.start[:2]).astype(np.int64)
        self.cell = self.home.copy()
        self.s = np.zeros(ids.shape[0])
        self.was_behind = np.zeros(ids.shape[0], dtype=np.bool_)

    def run(self) -> None:
        """Walk all rays to their ends; none is tested in the cell that it starts in."""
        is_first = True
        with np.errstate(divide="ignore", invalid="ignore"):
            while self.ids.size:
                border = np.where(self.velocity[:2] > 0.0, self.cell + 1, self.cell)
                s_border = np.where(
                    self.velocity[:2] != 0.0, (border - self.start[:2]) / self.velocity[:2], np.inf
                )
                s_out = np.minimum(s_border.min(axis=0), self.s_vanish)
                is_over = np.isinf(s_out) if is_first else self._look(s_out)
                is_first = False
                is_over |= self._vanish(s_out, is_over)
                self.cell += np.where(s_border <= s_out, np.sign(self.velocity[:2]), 0.0).astype(np.int64)
                self.s = s_out
                camera = self.depth.field.camera
                size = np.array([[camera.width], [camera.height]])
                is_over |= ((self.cell < 0) | (self.cell >= size)).any(axis=0)
                self._keep(np.flatnonzero(~is_over))

    def _look(self, s_out: FloatArray) -> BoolArray:
        """Test each ray in its cell; write what it meets, and return which rays stop."""
        field = self.depth.field
        pixel = self.cell[1] * field.camera.width + self.cell[0]
        share = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
        s = self.s + (s_out - self.s) * share
        height, nearer = self._heights(s, np.arange(self.ids.size), pixel)
        is_below, is_inside = height <= 0.0, nearer >= -field.slab.take(pixel)
        was_behind = np.concatenate([self.was_behind[None], (is_below & ~is_inside)[:-1]])
        stops = is_below & is_inside
        stops[1:] |= is_below[1:] & ~is_below[:-1]  # through the front, however deep the next sample lies
        first = stops.argmax(axis=0)
        self.was_behind = is_below[-1] & ~is_inside[-1]
        met = np.flatnonzero(stops.any(axis=0))
        first = first.take(met)
        normal = field.normal.take(pixel.take(met), axis=0).T
        faces = (normal * self.direction[:, met]).sum(axis=0) < 0.0
        away = np.abs(self.cell[:, met] - self.home[:, met]).max(axis=0)
        counts = faces | (away > _SELF_CONTACT_PX)
        met, first, faces = met[counts], first[counts], faces[counts]
        # Refine between the last sample in front and the first behind; at a cell's border there is nothing to
        low = s[np.maximum(first - 1, 0), met]
        s_met = self._bisect(low, s[first, met], met, pixel.take(met))
        is_hit = faces & ~was_behind[first, met]
        self._write(met, np.where(is_hit, tracer.HIT, tracer.BLOCKED), pixel.take(met), s_met)
        is_over = np.zeros(self.ids.size, dtype=np.bool_)
        is_over[met] = True
        return is_over

    def _heights(self, s: FloatArray, ray: IntArray, pixel: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return how far in front of the surface, and of the nearer of what it is made of, rays are in q."""
        x, y, q = (self.start[i].take(ray) + self.velocity[i].take(ray) * s for i in range(3))
        surface, nearer = self.depth.surface(x, y, np.broadcast_to(pixel, s.shape))
        return q - surface, q - nearer

    def _bisect(self, low: FloatArray, high: FloatArray, ray: IntArray, pixel: IntArray) -> FloatArray:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            is_below = self._heights(middle, ray, pixel)[0] <= 0.0
            low, high = np.where(is_below, low, middle), np.where(is_below, middle, high)
        return high

    def _write(self, ray: IntArray, status: IntArray, pixel: IntArray, s: FloatArray) -> None:
        result, ids = self.result, self.ids.take(ray)
        x, y, q = (self.start[i].take(ray) + self.velocity[i].take(ray) * s for i in range(3))
        result.status[ids], result.pixel[ids] = status, pixel
        result.x_px[ids], result.y_px[ids] = x, y
        result.distance[ids] = s if self.depth.field.camera.is_orthographic else s / q

    def _vanish(self, s_out: FloatArray, is_over: BoolArray) -> BoolArray:
        """End rays at their vanishing points: over background they escape."""
        ends = (s_out >= self.s_vanish) & ~is_over
        pixel = self.cell[1] * self.depth.field.camera.width + self.cell[0]
        escapes = ends & self.depth.field.is_background.take(pixel)
        self.result.status[self.ids[escapes]] = tracer.ESCAPED
        return ends

    def _keep(self, kept: IntArray) -> None:
        self.ids, self.s, self.s_vanish = self.ids[kept], self.s[kept], self.s_vanish[kept]
        self.was_behind = self.was_behind[kept]
        for name in ("start", "velocity", "direction", "home", "cell"):
            setattr(self, name, getattr(self, name)[:, kept])
