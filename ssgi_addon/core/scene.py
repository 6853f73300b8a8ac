# SPDX-License-Identifier: GPL-3.0-or-later
"""All views that rays walk, and the one answer that they give together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from . import parallel, tracer
from .answers import Answers, MergedAnswers, only_hits
from .camera import Camera
from .depth_field import MAX_LEVEL, DepthField
from .environment import Environment
from .field_stack import FieldStack
from .gbuffer import GBuffer
from .settings import Settings
from .types import FloatArray, IntArray

View = tuple[GBuffer, Camera]


@dataclass(frozen=True, eq=False)
class PlacedView:
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
        Thickness, largest distance, number of steps, and how the linear method takes them.
    method
        As in `ReflectionSettings.method`.
    """

    def __init__(
        self,
        gbuffer: GBuffer,
        camera: Camera,
        views: Sequence[View],
        settings: Settings,
        *,
        method: str = "hierarchical",
    ) -> None:
        self.max_distance, self.max_steps = settings.max_distance, settings.max_steps
        rays = settings.reflections
        self.march: tracer.MarchOptions | None = None
        if method == "linear" and rays.march_step > 0.0:
            self.march = tracer.MarchOptions(rays.march_step, rays.bisections)
        self.views: list[PlacedView] = []
        self.texels = 0
        for front, view_camera in [(gbuffer, camera), *views]:
            placed = PlacedView(view_camera, [], [], [])
            layer: GBuffer | None = front
            while layer is not None:
                placed.layers.append(layer)
                placed.fields.append(
                    DepthField.build(
                        layer,
                        view_camera,
                        settings.thickness,
                        max_level=0 if method == "linear" else MAX_LEVEL,
                        bounds="nearest" if method == "min_z" else "both",
                    )
                )
                placed.offsets.append(self.texels)
                self.texels += layer.depth.size
                layer = layer.behind
            self.views.append(placed)
        self.stacks = self._stacks()

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of all arrays."""
        return self.views[0].layers[0].depth.dtype

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

    def answer(
        self,
        origin_vs: FloatArray,
        direction_vs: FloatArray,
        home: int = 0,
        threads: int | None = 1,
        advance: parallel.Advance | None = None,
        *,
        is_clear: bool = False,
    ) -> Answers:
        """Trace rays that start on a view's surfaces: first through that view, then on through all others.

        A ray continues in the other views from where it left the first one; the nearest answer wins.

        Parameters
        ----------
        origin_vs, direction_vs : (3, N)
            In the space of view `home`.
        home
            The view whose surfaces the rays start on.
        threads, advance
            As in `tracer.trace_rays`.
        is_clear
            Nothing in that view is in the way of the rays: look at the others alone.
        """
        view, count = self.views[home], origin_vs.shape[1]
        if is_clear:
            return self._answer_beyond(home, origin_vs, direction_vs, threads)
        if len(self.views) == len(view.fields) == 1:
            found = self._trace(view.fields[0], origin_vs, direction_vs, threads, advance)
            return only_hits(found.status, found.pixel, found.distance, found.x_px, found.y_px, self.texels)
        merged = MergedAnswers(count, origin_vs.dtype)
        everywhere = np.arange(count)
        left = np.empty(0, dtype=origin_vs.dtype)
        for layer, (field, offset) in enumerate(zip(view.fields, view.offsets, strict=True)):
            found = self._trace(field, origin_vs, direction_vs, threads, advance)
            merged.add(field, offset, everywhere, found)
            left = found.distance if layer == 0 else left
        return self._finish(home, origin_vs, direction_vs, left, merged, threads)

    def _answer_beyond(
        self, home: int, origin_vs: FloatArray, direction_vs: FloatArray, threads: int | None
    ) -> Answers:
        """Answer rays that nothing in their own view stops."""
        field = self.views[home].fields[0]
        found = tracer.pass_through(field, origin_vs, direction_vs, self.max_distance)
        merged = MergedAnswers(origin_vs.shape[1], origin_vs.dtype)
        merged.escapes[found.status == tracer.ESCAPED] = True
        return self._finish(home, origin_vs, direction_vs, found.distance, merged, threads)

    def _finish(
        self,
        home: int,
        origin_vs: FloatArray,
        direction_vs: FloatArray,
        left: FloatArray,
        merged: MergedAnswers,
        threads: int | None,
    ) -> Answers:
        """Let unanswered rays go on from where they left their own view, and return all answers."""
        onward = np.flatnonzero((merged.status() == tracer.UNKNOWN) & np.isfinite(left))
        if len(self.views) > 1 and onward.size:
            self._continue_elsewhere(home, origin_vs, direction_vs, left, onward, merged, threads)
        return merged.answers(self.texels)

    def _trace(
        self,
        field: DepthField,
        origin_vs: FloatArray,
        direction_vs: FloatArray,
        threads: int | None,
        advance: parallel.Advance | None,
    ) -> tracer.TraceResult:
        return tracer.trace_rays(
            field, origin_vs, direction_vs, max_distance=self.max_distance, max_steps=self.max_steps,
            march=self.march, threads=threads, advance=advance,
        )  # fmt: skip

    def _continue_elsewhere(
        self,
        home: int,
        origin: FloatArray,
        direction: FloatArray,
        left: FloatArray,
        onward: IntArray,
        merged: MergedAnswers,
        threads: int | None,
    ) -> None:
        """Trace the `onward` rays through all other views from the distance at which they left their own."""
        origin, direction = origin.take(onward, axis=1), direction.take(onward, axis=1)
        begin = left.take(onward)
        for stack, members in self.stacks:
            visits = [
                _visit(self, home, view, layer, index, origin, direction, begin)
                for index, (view, layer) in enumerate(members)
                if view != home
            ]
            if not visits:
                continue
            rays = tracer.ScreenRays.joined([visit.rays for visit in visits])
            turned = np.concatenate([visit.direction for visit in visits], axis=1)
            found = tracer.trace_visitors(
                stack, rays, turned, max_steps=self.max_steps, march=self.march, threads=threads
            )
            end = 0
            for visit in visits:
                part = slice(end, end + visit.ray.shape[0])
                end = part.stop
                result = tracer.TraceResult(
                    found.status[part],
                    found.pixel[part] - visit.index * stack.pixels_per_field,
                    found.distance[part] + visit.begin,
                    found.x_px[part],
                    found.y_px[part],
                )
                view, layer = members[visit.index]
                offset = self.views[view].offsets[layer]
                merged.add(stack.fields[visit.index], offset, onward.take(visit.ray), result)

    def _stacks(self) -> list[tuple[FieldStack, list[tuple[int, int]]]]:
        """Group all fields by size and projection; each comes with its (view, layer)."""
        groups: dict[tuple[int, int, bool], list[tuple[int, int]]] = {}
        for index, view in enumerate(self.views):
            kind = (view.camera.width, view.camera.height, view.camera.is_orthographic)
            groups.setdefault(kind, []).extend((index, layer) for layer in range(len(view.fields)))
        return [
            (FieldStack([self.views[view].fields[layer] for view, layer in members]), members)
            for members in groups.values()
        ]

    def _moves(self, home: int, other: int) -> FloatArray:
        """Return the (4, 4) transform from one view's space to another's."""
        return (
            np.linalg.inv(self.views[other].camera.world_from_view) @ self.views[home].camera.world_from_view
        )


@dataclass(frozen=True, eq=False)
class _Visit:
    """Rays that enter a field of another view: which, from where on, and how they look there."""

    index: int  # of the field in its stack
    ray: IntArray
    begin: FloatArray
    rays: tracer.ScreenRays
    direction: FloatArray


def _visit(
    scene: TraceScene,
    home: int,
    other: int,
    layer: int,
    index: int,
    origin: FloatArray,
    direction: FloatArray,
    begin: FloatArray,
) -> _Visit:
    """Express rays of view `home` in another view's space, those that come into its sight after `begin`."""
    view = scene.views[other]
    rows = [[float(value) for value in row] for row in scene._moves(home, other)[:3]]
    moved = np.stack([r[0] * origin[0] + r[1] * origin[1] + r[2] * origin[2] + r[3] for r in rows])
    turned = np.stack([r[0] * direction[0] + r[1] * direction[1] + r[2] * direction[2] for r in rows])
    begin = _in_front_of_camera(view, moved, turned, begin)
    reaching = np.flatnonzero(begin < scene.max_distance)
    begin, turned = begin.take(reaching), turned.take(reaching, axis=1)
    moved = moved.take(reaching, axis=1) + turned * begin
    rays = tracer.project_rays(view.fields[layer], moved, turned, scene.max_distance - begin, index)
    seen = np.flatnonzero(rays.s_begin < np.inf)
    return _Visit(index, reaching.take(seen), begin.take(seen), rays.only(seen), turned.take(seen, axis=1))


def _in_front_of_camera(
    view: PlacedView, origin: FloatArray, direction: FloatArray, begin: FloatArray
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
