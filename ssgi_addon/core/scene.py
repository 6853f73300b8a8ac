# SPDX-License-Identifier: GPL-3.0-or-later
"""All views that rays walk, and the one answer that they give together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import tracer
from .camera import Camera
from .depth_field import MAX_LEVEL, DepthField
from .environment import Environment
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


@dataclass(frozen=True, eq=False)
class _PlacedView:
    """A camera's layers, front first, and where their pixels stand among all texels."""

    camera: Camera
    layers: list[GBuffer]
    fields: list[DepthField]
    offsets: list[int]

    @property
    def nearest_depth(self) -> float:
        """Nothing of a perspective view lies nearer."""
        return 1.0 / max(1e-30, *(float(field.front.max()) for field in self.fields))


class TraceScene:
    """Depth fields of the frame and of all further views.

    Parameters
    ----------
    gbuffer, camera
        The frame: view 0, whose pixels are the first texels.
    views
        Further G-buffers and cameras, placed by `Camera.world_from_view`.
    settings
        Thickness and maximum distance.
    max_level
        Coarsest level of the pyramids; 0 gives linear walks.
    """

    def __init__(
        self,
        gbuffer: GBuffer,
        camera: Camera,
        views: Sequence[View],
        settings: Settings,
        *,
        max_level: int = MAX_LEVEL,
    ) -> None:
        self.max_distance = settings.max_distance
        self.views: list[_PlacedView] = []
        self.texels = 0
        for front, view_camera in [(gbuffer, camera), *views]:
            placed = _PlacedView(view_camera, [], [], [])
            layer: GBuffer | None = front
            while layer is not None:
                placed.layers.append(layer)
                placed.fields.append(
                    DepthField.build(layer, view_camera, settings.thickness, max_level=max_level)
                )
                placed.offsets.append(self.texels)
                self.texels += layer.depth.size
                layer = layer.behind
            self.views.append(placed)

    def table(self, name: str) -> FloatArray:
        """Return a property of all texels ``(texels + 1, 3)`` with black in the last row."""
        rows = [getattr(layer, name).reshape(-1, 3) for view in self.views for layer in view.layers]
        return np.concatenate([*rows, np.zeros((1, 3), dtype=rows[0].dtype)])

    def front_texels(self, home: int) -> slice:
        """Return where the front layer's pixels of a view stand among all texels."""
        view = self.views[home]
        return slice(view.offsets[0], view.offsets[0] + view.layers[0].depth.size)

    def environment_for(self, home: int, environment: Environment | None) -> Environment | None:
        """Return the frame's environment for directions in another view's space."""
        if environment is None or home == 0:
            return environment
        rotation = environment.world_from_view @ self._moves(home, 0)[:3, :3]
        return replace(environment, world_from_view=rotation)

    def answer(self, origin_vs: FloatArray, direction_vs: FloatArray, home: int = 0) -> Answers:
        """Trace rays that start on a view's surfaces: first through that view, then on through all others.

        A ray continues in the other views from where it left the first one; the nearest answer wins.

        Parameters
        ----------
        origin_vs, direction_vs : (3, N)
            In the space of view `home`.
        home
            The view whose surfaces the rays start on.
        """
        status, texel, distance = self._through_layers(home, origin_vs, direction_vs, None)
        onward = np.flatnonzero((status == tracer.UNKNOWN) & np.isfinite(distance))
        if len(self.views) > 1 and onward.size:
            begin = distance.take(onward)
            found = self._through_others(
                home, origin_vs.take(onward, axis=1), direction_vs.take(onward, axis=1), begin
            )
            status[onward], texel[onward] = found
        return Answers(status, texel)

    def _through_others(
        self, home: int, origin: FloatArray, direction: FloatArray, begin: FloatArray
    ) -> tuple[np.ndarray, IntArray]:
        """Return status and texel of rays that have left their own view at distance `begin`."""
        count = begin.shape[0]
        status = np.full(count, tracer.UNKNOWN, dtype=np.int8)
        texel = np.full(count, self.texels, dtype=np.int64)
        nearest = np.full(count, np.inf, dtype=begin.dtype)
        for index in range(len(self.views)):
            if index == home:
                continue
            rows = [[float(value) for value in row] for row in self._moves(home, index)[:3]]
            moved = np.stack([r[0] * origin[0] + r[1] * origin[1] + r[2] * origin[2] + r[3] for r in rows])
            turned = np.stack([r[0] * direction[0] + r[1] * direction[1] + r[2] * direction[2] for r in rows])
            other, other_texel, distance = self._through_layers(index, moved, turned, begin)
            # A hit or a block ends the ray, the nearest one for good; an escape counts while nothing does
            ends = (other == tracer.HIT) | (other == tracer.BLOCKED)
            is_nearer = np.flatnonzero(ends & (distance < nearest))
            nearest[is_nearer] = distance.take(is_nearer)
            status[is_nearer], texel[is_nearer] = other.take(is_nearer), other_texel.take(is_nearer)
            status[(other == tracer.ESCAPED) & (status == tracer.UNKNOWN)] = tracer.ESCAPED
        return status, texel

    def _moves(self, home: int, other: int) -> FloatArray:
        """Return the (4, 4) transform from one view's space to another's."""
        return (
            np.linalg.inv(self.views[other].camera.world_from_view) @ self.views[home].camera.world_from_view
        )

    def _through_layers(
        self, index: int, origin: FloatArray, direction: FloatArray, begin: FloatArray | None
    ) -> tuple[np.ndarray, IntArray, FloatArray]:
        """Trace rays through a view's layers; return status, texel and distance of the nearest answer.

        `begin` is where along the rays this view takes over; None means that they start on its surfaces.
        A ray that one layer blocks takes hits of the others as far as the blocking surface is thick.
        """
        view = self.views[index]
        first = self._through_field(view, 0, origin, direction, begin)
        status, distance = first.status, first.distance
        texel = np.where(status == tracer.HIT, first.pixel + view.offsets[0], self.texels)
        if len(view.fields) == 1:
            return status, texel, distance
        limit = _block_limit(view.fields[0], first)
        nearest = np.where(status == tracer.HIT, distance, np.inf)
        for layer in range(1, len(view.fields)):
            found = self._through_field(view, layer, origin, direction, begin)
            limit = np.minimum(limit, _block_limit(view.fields[layer], found))
            is_nearer = (found.status == tracer.HIT) & (found.distance < nearest)
            nearest = np.where(is_nearer, found.distance, nearest)
            texel = np.where(is_nearer, found.pixel + view.offsets[layer], texel)
        is_hit = np.isfinite(nearest) & (nearest <= limit)
        is_blocked = ~is_hit & np.isfinite(limit)
        status = np.where(is_hit, tracer.HIT, np.where(is_blocked, tracer.BLOCKED, status)).astype(np.int8)
        distance = np.where(is_hit, nearest, np.where(is_blocked, limit, distance))
        return status, np.where(is_hit, texel, self.texels), distance

    def _through_field(
        self,
        view: _PlacedView,
        layer: int,
        origin: FloatArray,
        direction: FloatArray,
        begin: FloatArray | None,
    ) -> tracer.TraceResult:
        field = view.fields[layer]
        if begin is None:
            return tracer.trace_rays(field, origin, direction, max_distance=self.max_distance)
        begin = _in_front_of_camera(view, origin, direction, begin)
        reaches = np.flatnonzero(begin < self.max_distance)
        count, start = begin.shape[0], begin.take(reaches)
        direction = direction.take(reaches, axis=1)
        part = tracer.trace_rays(
            field,
            origin.take(reaches, axis=1) + direction * start,
            direction,
            max_distance=self.max_distance - start,
            starts_on_surface=False,
        )
        result = tracer.TraceResult.empty(count, origin.dtype)
        result.status[reaches], result.pixel[reaches] = part.status, part.pixel
        result.distance[reaches] = part.distance + start
        return result


def _in_front_of_camera(
    view: _PlacedView, origin: FloatArray, direction: FloatArray, begin: FloatArray
) -> FloatArray:
    """Return from which distance rays lie in front of a view's camera: at least `begin`, +inf for never."""
    if view.camera.is_orthographic:
        return begin
    near = 0.5 * view.nearest_depth
    depth, approach = -origin[2], -direction[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        enters = np.where(approach > 0.0, (near - depth) / approach, np.inf)
    starts_in_front = depth + begin * approach >= near
    return np.where(starts_in_front, begin, np.where(enters > begin, enters, np.inf)).astype(begin.dtype)


def _block_limit(field: DepthField, found: tracer.TraceResult) -> FloatArray:
    """Return how far along a blocked ray other layers may still answer; +inf for rays not blocked."""
    limit = np.full_like(found.distance, np.inf)
    blocked = np.flatnonzero(found.status == tracer.BLOCKED)
    pixel = found.pixel.take(blocked)
    front, slab = field.front.take(pixel), field.slab.take(pixel)
    if field.camera.is_orthographic:
        extent = slab
    else:
        with np.errstate(divide="ignore"):
            extent = 1.0 / (front - slab) - 1.0 / front
    limit[blocked] = found.distance.take(blocked) + extent
    return limit
