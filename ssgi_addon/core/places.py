# SPDX-License-Identifier: GPL-3.0-or-later
"""The places that views look from, and rays that come into their sight from elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from . import tracer
from .answers import TOUCHING, MergedAnswers, Sight, sight_through_layers
from .camera import Camera, move_between
from .depth_field import DepthField
from .field_stack import FieldStack
from .frame_points import move_rays
from .gbuffer import GBuffer
from .types import BoolArray, FloatArray, IntArray

# Cameras nearer to each other than this share of their nearest surface's depth stand at one place; parallel
# views, whose directions and planes differ by less than this share of 1 and of their width.
_SAME_PLACE = 1e-4
# Rays that come from behind a camera are followed from this share of its nearest surface's depth on. Nobody
# sees what lies between, so that it has to be small beside what rays cross near a surround's place.
_NEAR = 0.02


@dataclass(frozen=True, eq=False)
class PlacedView:
    """A camera's layers, front first, and where their pixels stand among all texels.

    Nothing of a perspective view lies nearer than `nearest_depth`.
    """

    camera: Camera
    layers: list[GBuffer]
    fields: list[DepthField]
    offsets: list[int]
    nearest_depth: float = np.inf

    @cached_property
    def is_lit(self) -> list[BoolArray | None]:
        """Where each layer behind hands on light (H*W,); None for the front layer."""
        behind = [(layer.diffuse_source > 0.0).any(axis=-1).reshape(-1) for layer in self.layers[1:]]
        return [None, *behind]


@dataclass(frozen=True, eq=False)
class OnwardRays:
    """Rays that go on in other views: their numbers, (3, N) origins and directions, and from how far on.

    Origins and directions are in the space of the camera that they come from.
    """

    number: IntArray
    origin_vs: FloatArray
    direction_vs: FloatArray
    begin: FloatArray
    camera: Camera


@dataclass(frozen=True)
class TraceLimits:
    """How rays are followed: `tracer.trace_visitors` says what each is."""

    max_distance: float
    max_steps: int | None
    march: tracer.MarchOptions | None


class Place:
    """The views that look from one place; fields of one size and projection are walked together.

    Parameters
    ----------
    views
        Of the whole scene.
    members
        Which of them look from here.
    """

    def __init__(self, views: Sequence[PlacedView], members: Sequence[int]) -> None:
        self.views, self.members = views, tuple(members)
        groups: dict[tuple[int, int, int, bool], list[int]] = {}
        for index in members:
            camera = views[index].camera
            for layer in range(len(views[index].fields)):
                kind = (layer, camera.width, camera.height, camera.is_orthographic)
                groups.setdefault(kind, []).append(index)
        # Front layers first: only what is out of their sight is looked for in the next ones
        self.stacks = [
            _Stack(layer, shown, FieldStack([views[view].fields[layer] for view in shown]))
            for (layer, *_), shown in sorted(groups.items(), key=lambda group: group[0][0])
        ]

    def follow(
        self,
        rays: OnwardRays,
        home: int | None,
        merged: MergedAnswers,
        limits: TraceLimits,
        threads: int | None,
    ) -> None:
        """Trace rays through all views of this place but their own, and take in what these answer."""
        seen: dict[int, list[_Visit]] = {}
        for stack in self.stacks if rays.number.size else ():
            visits = []
            for index, view in enumerate(stack.shown):
                if view == home:
                    continue
                if stack.layer == 0:
                    visit = _visit(self.views[view], index, rays, limits.max_distance)
                    seen[view] = [visit]
                else:
                    visit = seen[view][-1].onward(index)
                    seen[view].append(visit)
                visits.append(visit)
            stack.trace(visits, limits, threads)
            for visit in visits:
                view = stack.shown[visit.index]
                placed = self.views[view]
                merged.add(
                    placed.fields[stack.layer],
                    placed.offsets[stack.layer],
                    rays.number.take(visit.ray),
                    visit.found,
                    placed.is_lit[stack.layer],
                )
        for layers in seen.values():
            in_sight = sight_through_layers(
                [visit.found for visit in layers], [visit.asked for visit in layers[1:]]
            )
            merged.see(Sight(rays.number.take(layers[0].ray), layers[0].enters, in_sight))


def with_nearest_depths(views: Sequence[PlacedView]) -> list[PlacedView]:
    """Return views with the depth of what they show nearest; where one shows none, that of all the others."""
    nearest = [1.0 / max(1e-30, *(float(field.front.max()) for field in view.fields)) for view in views]
    shows = [not all(field.is_background.all() for field in view.fields) for view in views]
    overall = min((depth for depth, is_any in zip(nearest, shows, strict=True) if is_any), default=1.0)
    return [
        replace(view, nearest_depth=depth if is_any else overall)
        for view, depth, is_any in zip(views, nearest, shows, strict=True)
    ]


def places_of(views: Sequence[PlacedView]) -> list[Place]:
    """Group views by the place that they look from: for parallel ones, the direction and the plane."""
    groups: list[list[int]] = []
    for index, view in enumerate(views):
        own = [one for one in groups if _is_at(views[one[0]], view)]
        if own:
            own[0].append(index)
        else:
            groups.append([index])
    return [Place(views, members) for members in groups]


def _is_at(first: PlacedView, second: PlacedView) -> bool:
    one, other = first.camera, second.camera
    if one.is_orthographic != other.is_orthographic:
        return False
    apart = one.world_from_view[:3, 3] - other.world_from_view[:3, 3]
    if one.is_orthographic:
        back = one.world_from_view[:3, 2]
        is_parallel = np.linalg.norm(back - other.world_from_view[:3, 2]) <= _SAME_PLACE
        width = min(one.width / one.fx, other.width / other.fx)
        return bool(is_parallel and abs(apart @ back) <= _SAME_PLACE * width)
    nearest = min(first.nearest_depth, second.nearest_depth)
    return bool(np.linalg.norm(apart) <= _SAME_PLACE * nearest)


@dataclass(eq=False)
class _Visit:
    """Rays that enter a field of another view: which, from where on, how they look there, what they find.

    They are followed from `begin` on, and come over the view's frame at `enters`. For a layer behind, `asked`
    are those among the rays of the layer before.
    """

    index: int  # of the field in its stack
    ray: IntArray
    begin: FloatArray
    enters: FloatArray
    rays: tracer.ScreenRays
    direction: FloatArray
    asked: IntArray
    found: tracer.TraceResult

    def onward(self, index: int) -> _Visit:
        """Return the rays that went out of this layer's sight, for the next one."""
        asked = np.flatnonzero(self.found.hidden < np.inf)
        return _Visit(
            index,
            self.ray.take(asked),
            self.begin.take(asked),
            self.enters.take(asked),
            replace(self.rays.only(asked), field=np.full_like(asked, index)),
            self.direction.take(asked, axis=1),
            asked,
            tracer.TraceResult.empty(0, self.begin.dtype),
        )


@dataclass(frozen=True, eq=False)
class _Stack:
    """Fields of one layer, size and projection, and the views that show them."""

    layer: int
    shown: list[int]
    fields: FieldStack

    def trace(self, visits: Sequence[_Visit], limits: TraceLimits, threads: int | None) -> None:
        """Follow the rays of all visits in one walk, and let each keep what its rays find."""
        if not visits:
            return
        found = tracer.trace_visitors(
            self.fields,
            tracer.ScreenRays.joined([visit.rays for visit in visits]),
            np.concatenate([visit.direction for visit in visits], axis=1),
            max_steps=limits.max_steps,
            march=limits.march,
            threads=threads,
        )
        end = 0
        for visit in visits:
            part = slice(end, end + visit.ray.shape[0])
            end = part.stop
            # Distances from the rays' origins, pixels of the visit's own field
            visit.found = tracer.TraceResult(
                found.status[part],
                found.pixel[part] - visit.index * self.fields.pixels_per_field,
                found.distance[part] + visit.begin,
                found.x_px[part],
                found.y_px[part],
                found.hidden[part] + visit.begin,
            )


def _visit(view: PlacedView, index: int, rays: OnwardRays, max_distance: float) -> _Visit:
    """Express rays in a view's space, those that come into its sight after they begin."""
    move = move_between(rays.camera, view.camera)
    moved, turned = move_rays(move, rays.origin_vs, rays.direction_vs)
    begin = _in_front_of_camera(view, moved, turned, rays.begin)
    reaching = np.flatnonzero(begin * TOUCHING < max_distance)
    begin, turned = begin.take(reaching), turned.take(reaching, axis=1)
    moved = moved.take(reaching, axis=1) + turned * begin
    lines = tracer.project_rays(view.fields[0], moved, turned, max_distance - begin, index)
    # Some come over the frame's rectangle only beyond their vanishing points
    seen = np.flatnonzero(lines.s_begin < np.minimum(lines.s_vanish, lines.s_limit))
    lines, begin = lines.only(seen), begin.take(seen)
    enters = begin + lines.entry_distance(view.camera.is_orthographic)
    nothing = tracer.TraceResult.empty(0, begin.dtype)
    return _Visit(
        index, reaching.take(seen), begin, enters, lines, turned.take(seen, axis=1), reaching, nothing
    )


def _in_front_of_camera(
    view: PlacedView, origin: FloatArray, direction: FloatArray, begin: FloatArray
) -> FloatArray:
    """Return from which distance rays lie in front of a view's camera: at least `begin`, +inf for never."""
    near = 0.0 if view.camera.is_orthographic else _NEAR * view.nearest_depth
    depth, approach = -origin[2], -direction[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        enters = np.where(approach > 0.0, (near - depth) / approach, np.inf)
    starts_in_front = depth + begin * approach >= near
    return np.where(starts_in_front, begin, np.where(enters > begin, enters, np.inf)).astype(begin.dtype)
