# SPDX-License-Identifier: GPL-3.0-or-later
"""All views that rays walk, and the one answer that they give together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from . import parallel, tracer
from .answers import Answers, MergedAnswers, Sight, only_hits, sight_through_layers
from .camera import Camera, move_between
from .depth_field import MAX_LEVEL, DepthField
from .environment import Environment
from .gbuffer import GBuffer
from .places import OnwardRays, Place, PlacedView, TraceLimits, places_of, with_nearest_depths
from .settings import Settings
from .types import FloatArray, IntArray

View = tuple[GBuffer, Camera]


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
    notes_hidden
        Note where rays go out of the sight of their own view; None where other views or layers answer, too.
    """

    def __init__(
        self,
        gbuffer: GBuffer,
        camera: Camera,
        views: Sequence[View],
        settings: Settings,
        *,
        method: str = "hierarchical",
        notes_hidden: bool | None = None,
    ) -> None:
        rays, march = settings.reflections, None
        if method == "linear" and rays.march_step > 0.0:
            march = tracer.MarchOptions(rays.march_step, rays.bisections)
        self.limits = TraceLimits(settings.reach, settings.max_steps, march)
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
            # Layers of one view end together: rays come into the sight of all of them or of none
            q_end = min(field.q_end for field in placed.fields)
            placed.fields[:] = [replace(field, q_end=q_end) for field in placed.fields]
            self.views.append(placed)
        self.views = with_nearest_depths(self.views)
        self.places = places_of(self.views)
        has_others = sum(len(view.fields) for view in self.views) > 1
        self.notes_hidden = has_others if notes_hidden is None else notes_hidden

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
        turn = move_between(self.views[home].camera, self.views[0].camera)[:3, :3]
        return replace(environment, world_from_view=environment.world_from_view @ turn)

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

        A ray continues in the other views from where it went out of sight of the first one: at the frame's
        border, behind a surface, or where something may be in its way. The nearest answer wins.

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
        view = self.views[home]
        if len(self.views) == len(view.fields) == 1 and not is_clear:
            found = self._trace(view.fields[0], origin_vs, direction_vs, threads, advance)
            return only_hits(found.status, found.pixel, found.distance, found.x_px, found.y_px, self.texels)
        return self.merge(origin_vs, direction_vs, home, threads, advance, is_clear=is_clear).answers(
            self.texels
        )

    def merge(
        self,
        origin_vs: FloatArray,
        direction_vs: FloatArray,
        home: int = 0,
        threads: int | None = 1,
        advance: parallel.Advance | None = None,
        *,
        is_clear: bool = False,
    ) -> MergedAnswers:
        """Return what all views say of rays, and how far they saw them; the parameters are `answer`'s."""
        view, count = self.views[home], origin_vs.shape[1]
        merged, everywhere = MergedAnswers(count, origin_vs.dtype), np.arange(count)
        if is_clear:
            found = tracer.pass_through(view.fields[0], origin_vs, direction_vs, self.limits.max_distance)
            merged.escapes[found.status == tracer.ESCAPED] = True
            left, end = found.distance, found.distance
        else:
            left, end = self._trace_layers(home, origin_vs, direction_vs, merged, threads, advance)
        merged.see(Sight(everywhere, np.zeros_like(end), end))

        def follow(place: Place, onward: IntArray, begin: FloatArray) -> None:
            rays = OnwardRays(
                onward,
                origin_vs.take(onward, axis=1),
                direction_vs.take(onward, axis=1),
                begin.take(onward),
                view.camera,
            )
            place.follow(rays, home, merged, self.limits, threads)

        for place in sorted(self.places, key=lambda place: home not in place.members):
            if home in place.members:
                # From there everything hides what it hid before: only what leaves the frame goes on
                follow(place, np.flatnonzero((left < merged.nearest) & np.isfinite(left)), left)
            else:
                # What was in sight all the way to an answer needs no other view
                follow(place, np.flatnonzero(merged.is_uncertain()), merged.open_until)
        return merged

    def _trace_layers(
        self,
        home: int,
        origin: FloatArray,
        direction: FloatArray,
        merged: MergedAnswers,
        threads: int | None,
        advance: parallel.Advance | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Trace rays through all layers of their own view and take in the answers.

        Returns
        -------
        left : (N,)
            Where rays left the frame unanswered; +inf for all others.
        end : (N,)
            Until where they were in sight.
        """
        view = self.views[home]
        found: list[tracer.TraceResult] = []
        followed: list[IntArray] = []
        ray = np.arange(origin.shape[1])
        for field, offset, is_lit in zip(view.fields, view.offsets, view.is_lit, strict=True):
            if found:
                # What stayed in sight meets nothing in the layers behind
                followed.append(np.flatnonzero(found[-1].hidden < np.inf))
                ray = ray.take(followed[-1])
                origin, direction = (vector.take(followed[-1], axis=1) for vector in (origin, direction))
            found.append(self._trace(field, origin, direction, threads, advance))
            merged.add(field, offset, ray, found[-1], is_lit)
        left = np.where(found[0].status == tracer.UNKNOWN, found[0].distance, np.inf)
        return left.astype(origin.dtype), sight_through_layers(found, followed)

    def open_from(
        self, origin_vs: FloatArray, direction_vs: FloatArray, threads: int | None = 1
    ) -> FloatArray:
        """Return how far views see rays in the open that start in the air, (N,); 0 where none sees them.

        Parameters
        ----------
        origin_vs, direction_vs : (3, N)
            In the space of view 0.
        threads
            As in `tracer.trace_rays`.
        """
        count, camera = origin_vs.shape[1], self.views[0].camera
        merged = MergedAnswers(count, origin_vs.dtype)
        begin = np.zeros(count, dtype=origin_vs.dtype)
        rays = OnwardRays(np.arange(count), origin_vs, direction_vs, begin, camera)
        for place in self.places:
            place.follow(rays, None, merged, self.limits, threads)
        return merged.open_until

    def _trace(
        self,
        field: DepthField,
        origin_vs: FloatArray,
        direction_vs: FloatArray,
        threads: int | None,
        advance: parallel.Advance | None,
    ) -> tracer.TraceResult:
        return tracer.trace_rays(
            field, origin_vs, direction_vs, max_distance=self.limits.max_distance,
            max_steps=self.limits.max_steps, notes_hidden=self.notes_hidden,
            march=self.limits.march, threads=threads, advance=advance,
        )  # fmt: skip
