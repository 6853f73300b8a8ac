# SPDX-License-Identifier: GPL-3.0-or-later
"""All views that rays walk, and the one answer that they give together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import tracer
from .camera import Camera
from .depth_field import MAX_LEVEL, DepthField
from .gbuffer import GBuffer
from .settings import Settings
from .types import FloatArray, IntArray

View = tuple[GBuffer, Camera]


@dataclass(frozen=True, eq=False)
class Answers:
    """What N rays met.

    Attributes
    ----------
    status : (N,) int8
        `tracer.HIT`, `ESCAPED`, `BLOCKED` or `UNKNOWN`.
    texel : (N,) int64
        For hits the flat pixel index into all views' pixels one after another; for all other rays the index
        one past the last, where tables of radiance hold black.
    """

    status: np.ndarray
    texel: IntArray


class TraceScene:
    """Depth fields of the frame and of all further views, in the frame's view space.

    The layer behind a view is a view of its own with the same camera.

    Parameters
    ----------
    gbuffer, camera
        The frame; its pixels come first.
    views
        Further G-buffers and cameras, placed by `Camera.world_from_view`.
    settings
        Thickness and maximum distance.
    max_level
        Coarsest level of the pyramids; 0 gives linear walks.
    """

    def __init__(
        self, gbuffer: GBuffer, camera: Camera, views: Sequence[View], settings: Settings, *, max_level: int = MAX_LEVEL
    ) -> None:
        self.gbuffers: list[GBuffer] = []
        self.fields: list[DepthField] = []
        self.from_frame: list[FloatArray | None] = []
        self.offsets: list[int] = []
        self.max_distance = settings.max_distance
        self.thickness = settings.thickness
        self.pixels = 0
        for index, (view, view_camera) in enumerate([(gbuffer, camera), *views]):
            moves = None if index == 0 else np.linalg.inv(view_camera.world_from_view) @ camera.world_from_view
            layer: GBuffer | None = view
            while layer is not None:
                self.gbuffers.append(layer)
                self.fields.append(DepthField.build(layer, view_camera, settings.thickness, max_level=max_level))
                self.from_frame.append(moves)
                self.offsets.append(self.pixels)
                self.pixels += layer.depth.size
                layer = layer.behind

    def table(self, name: str) -> FloatArray:
        """Return a property of all views' pixels ``(pixels + 1, 3)`` with black in the last row."""
        rows = [getattr(gbuffer, name).reshape(-1, 3) for gbuffer in self.gbuffers]
        return np.concatenate([*rows, np.zeros((1, 3), dtype=rows[0].dtype)])

    def answer(self, origin_vs: FloatArray, direction_vs: FloatArray) -> Answers:
        """Trace rays of the frame's view space, ``(3, N)``, through all views; the nearest answer wins.

        A ray that one view blocks at distance t takes answers of other views up to t plus the blocking
        surface's thickness.
        """
        first = tracer.trace_rays(self.fields[0], origin_vs, direction_vs, max_distance=self.max_distance)
        is_hit = first.status == tracer.HIT
        status, texel = first.status, np.where(is_hit, first.pixel, self.pixels)
        if len(self.fields) == 1:
            return Answers(status, texel)
        nearest = np.where(is_hit, first.distance, np.inf)
        limit = self._limit(self.fields[0], first)
        for index in range(1, len(self.fields)):
            found = self._trace_view(index, origin_vs, direction_vs)
            limit = np.minimum(limit, self._limit(self.fields[index], found))
            is_nearer = (found.status == tracer.HIT) & (found.distance < nearest)
            nearest = np.where(is_nearer, found.distance, nearest)
            texel = np.where(is_nearer, found.pixel + self.offsets[index], texel)
            status = np.maximum(status, found.status)
        is_blocked = nearest > limit
        texel = np.where(is_blocked | ~np.isfinite(nearest), self.pixels, texel)
        # Without a hit: something in the way is more certain than an open sky.
        has_hit = np.isfinite(nearest) & ~is_blocked
        status = np.where(has_hit, tracer.HIT, np.where(np.isfinite(limit), tracer.BLOCKED, status))
        return Answers(status.astype(np.int8), texel)

    def _limit(self, field: DepthField, found: tracer.TraceResult) -> FloatArray:
        """Return how far along a blocked ray other views may still answer; +inf for rays not blocked."""
        limit = np.full_like(found.distance, np.inf)
        blocked = np.flatnonzero(found.status == tracer.BLOCKED)
        if blocked.size:
            pixel = found.pixel.take(blocked)
            front, slab = field.front.take(pixel), field.slab.take(pixel)
            if field.camera.is_orthographic:
                extent = slab
            else:
                with np.errstate(divide="ignore"):
                    extent = 1.0 / (front - slab) - 1.0 / front
            limit[blocked] = found.distance.take(blocked) + extent
        return limit

    def _trace_view(self, index: int, origin_vs: FloatArray, direction_vs: FloatArray) -> tracer.TraceResult:
        """Trace the frame's rays in another view's space; distances stay the same."""
        field, moves = self.fields[index], self.from_frame[index]
        if moves is not None:
            rows = [[float(value) for value in row] for row in moves]
            origin_vs = np.stack(
                [r[0] * origin_vs[0] + r[1] * origin_vs[1] + r[2] * origin_vs[2] + r[3] for r in rows[:3]]
            )
            direction_vs = np.stack(
                [r[0] * direction_vs[0] + r[1] * direction_vs[1] + r[2] * direction_vs[2] for r in rows[:3]]
            )
        if field.camera.is_orthographic:
            return tracer.trace_rays(field, origin_vs, direction_vs, max_distance=self.max_distance)
        # A perspective view starts where the ray comes before its camera: nothing is nearer than its nearest surface
        near = 0.5 / max(float(field.front.max()), 1e-30)
        depth, approach = -origin_vs[2], -direction_vs[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            skipped = np.where(depth >= near, 0.0, np.where(approach > 0.0, (near - depth) / approach, np.inf))
        skipped = skipped.astype(origin_vs.dtype)
        visible = np.flatnonzero(np.isfinite(skipped))
        start = skipped.take(visible)
        direction = direction_vs.take(visible, axis=1)
        origin = origin_vs.take(visible, axis=1) + direction * start
        part = tracer.trace_rays(field, origin, direction, max_distance=self.max_distance)
        count = skipped.shape[0]
        result = tracer.TraceResult(
            np.zeros(count, dtype=np.int8), np.full(count, -1, dtype=np.int64), np.full_like(skipped, np.inf)
        )
        result.status[visible] = part.status
        result.pixel[visible] = part.pixel
        result.distance[visible] = part.distance + start
        return result
