# SPDX-License-Identifier: GPL-3.0-or-later
"""What several views say of a ray, one ray at a time, in plain Python floats.

Slow and obvious on purpose. What a single field says is `scalar_tracer`'s; here is how views and their
layers are asked in turn, and which answer wins:

- The home view is asked from the ray's origin. Views of the same place are asked from where the ray leaves
  its frame, unless something was met there: from one place, everything else hides what it hid before.
- Views of other places are asked from where the ray goes out of sight, one place after the other, until one
  has seen it all the way to an answer.
- A view sees a ray in the open from where it comes over its frame to what it meets, or to where it goes
  behind something. A view with layers sees it on behind the front layer, as long as it is in front of the
  next one. Stretches that touch make one, which begins at the origin.
- A layer behind shows nothing where no light reaches it directly, since its later bounces are not known: what
  is met there is in the way. Nor does it show any sky, only that nothing was captured.
- Within that stretch there is neither a hit nor a block of a view that had itself lost sight of the ray.
- The nearest hit is the answer, unless it lies deeper within a block than that is thick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ssgi_addon.core import tracer
from tests.reference.scalar_tracer import trace_ray

# Parts of a distance: how near two are that count as one, and up to where in an open stretch views agree.
TOUCHING = 1e-4
SURELY_BEFORE = 0.98
# Cameras this close to each other, relative to the nearest surface, stand at one place; parallel ones, whose
# directions and planes are as close, relative to 1 and to their width.
SAME_PLACE = 1e-4
# Of its nearest surface's depth: where a view's sight begins.
NEAR = 0.02


@dataclass
class Known:
    """What is known of one ray: hits (distance, texel, in sight), blocks (begin, until), open stretches."""

    hits: list[tuple[float, int, bool]] = field(default_factory=list)
    blocks: list[tuple[float, float]] = field(default_factory=list)
    stretches: list[tuple[float, float]] = field(default_factory=list)
    escapes: bool = False

    def open_until(self) -> float:
        until, is_done = 0.0, False
        while not is_done:
            touching = [end for begin, end in self.stretches if begin <= until * (1.0 + TOUCHING)]
            is_done = max(touching, default=0.0) <= until
            until = max([until, *touching])
        return until

    def nearest(self) -> tuple[float, int | None]:
        """Return distance and texel of the nearest hit that is there; of equal ones the first."""
        until = self.open_until()
        there = [(d, texel) for d, texel, in_sight in self.hits if in_sight or d >= SURELY_BEFORE * until]
        return min(there, key=lambda hit: hit[0], default=(math.inf, None))

    def is_certain(self) -> bool:
        until = self.open_until()
        return math.isinf(until) or until >= self.nearest()[0]

    def answer(self) -> tuple[int, int | None, float]:
        distance, texel = self.nearest()
        until = self.open_until()
        limits = [end for begin, end in self.blocks if begin >= until]
        if texel is not None and all(distance <= limit for limit in limits):
            return tracer.HIT, texel, distance
        if limits:
            return tracer.BLOCKED, None, math.inf
        return (tracer.ESCAPED if self.escapes else tracer.UNKNOWN), None, math.inf


def answer_ray(views, home, origin, direction, max_distance=math.inf):
    """Return (status, texel or None, distance) of a ray in the space of the view `home`.

    `views` are a scene's, in the order in which their places are asked: each with `camera`, `fields`, front
    first, `offsets`, where each field's pixels stand among all texels, and `nearest_depth`.
    """
    known = Known()
    found = _ask_layers(views[home], lambda one: trace_ray(one, origin, direction, max_distance))
    _learn(known, views[home], found, 0.0, 0.0)
    at_home = [place for place in _places(views) if home in place]
    elsewhere = [place for place in _places(views) if home not in place]
    status, _, left, _ = found[0]
    if status == tracer.UNKNOWN and math.isfinite(left) and all(left < hit[0] for hit in known.hits):
        for other in at_home[0]:
            if other != home:
                _visit(known, views[home], views[other], origin, direction, left, max_distance)
    for place in elsewhere:
        if known.is_certain():
            break
        begin = known.open_until()
        for other in place:
            _visit(known, views[home], views[other], origin, direction, begin, max_distance)
    return known.answer()


def _places(views) -> list[list[int]]:
    places: list[list[int]] = []
    for index, view in enumerate(views):
        for place in places:
            if _is_one_place(views[place[0]], view):
                place.append(index)
                break
        else:
            places.append([index])
    return places


def _is_one_place(first, second) -> bool:
    if first.camera.is_orthographic != second.camera.is_orthographic:
        return False
    here, there = (view.camera.world_from_view[:3, 3] for view in (first, second))
    if first.camera.is_orthographic:
        back, other_back = (view.camera.world_from_view[:3, 2] for view in (first, second))
        width = min(view.camera.width / view.camera.fx for view in (first, second))
        apart = abs(sum(float(b) * float(h - t) for b, h, t in zip(back, here, there)))
        return math.dist(back, other_back) <= SAME_PLACE and apart <= SAME_PLACE * width
    apart = math.dist(here, there)
    return apart <= SAME_PLACE * min(first.nearest_depth, second.nearest_depth)


def _visit(known, home, view, origin, direction, begin, max_distance) -> None:
    """Ask a view of a ray from `begin` on, if it comes over its frame after that."""
    move = np.linalg.inv(view.camera.world_from_view) @ home.camera.world_from_view
    origin = [sum(float(m) * float(v) for m, v in zip(row[:3], origin)) + float(row[3]) for row in move[:3]]
    direction = [sum(float(m) * float(v) for m, v in zip(row[:3], direction)) for row in move[:3]]
    # A perspective view is asked from shortly before its camera on, long before its nearest surface
    near = 0.0 if view.camera.is_orthographic else NEAR * view.nearest_depth
    depth, approach = -origin[2] - begin * direction[2], -direction[2]
    if depth < near:
        begin = begin + (near - depth) / approach if approach > 0.0 else math.inf
    if begin * (1.0 + TOUCHING) >= max_distance:
        return
    start = [o + begin * d for o, d in zip(origin, direction)]
    enters, leaves = _over_frame(view, start, direction)
    if enters >= min(leaves, max_distance - begin):
        return
    found = _ask_layers(view, lambda one: trace_ray(one, start, direction, max_distance - begin, False))
    _learn(known, view, found, begin, begin + enters)


def _ask_layers(view, ask) -> list[tuple[int, int, float, float]]:
    """Return what the layers say, front first: the next one is asked about what goes out of sight."""
    found = []
    for one in view.fields:
        found.append(ask(one))
        if math.isinf(found[-1][3]):
            break
    return found


def _over_frame(view, start, direction) -> tuple[float, float]:
    """Return between which distances the ray lies over the frame's pyramid, before it vanishes."""
    camera = view.camera
    (x, y, z), (dx, dy, dz) = start, direction
    depth, approach = (1.0, 0.0) if camera.is_orthographic else (-z, -dz)
    left = camera.cx * depth + camera.fx * x, camera.cx * approach + camera.fx * dx
    top = camera.cy * depth - camera.fy * y, camera.cy * approach - camera.fy * dy
    right = camera.width * depth - left[0], camera.width * approach - left[1]
    bottom = camera.height * depth - top[0], camera.height * approach - top[1]
    enters, leaves = 0.0, math.inf
    for inside, speed in (left, right, top, bottom):
        if inside < 0.0:
            enters = max(enters, -inside / speed if speed > 0.0 else math.inf)
        elif speed < 0.0:
            leaves = min(leaves, -inside / speed)
    if camera.is_orthographic and dz:
        # At the camera's plane, or far behind all that the view shows
        end = 0.0 if dz > 0.0 else min(one.q_end for one in view.fields)
        leaves = min(leaves, (end - z) / dz)
    return enters, leaves


def _learn(known, view, found, begin, enters) -> None:
    """Take in what the layers of a view say, front first, of a ray that they were asked from `begin` on."""
    end = 0.0
    for _, _, distance, hidden in reversed(found):
        end = min(distance, max(hidden, end))
    known.stretches.append((enters, begin + end))
    for layer, (status, pixel, distance, hidden) in enumerate(found):
        one, offset = view.fields[layer], view.offsets[layer]
        is_dark = layer > 0 and not (view.layers[layer].diffuse_source.reshape(-1, 3)[pixel] > 0.0).any()
        if status == tracer.HIT and not is_dark:
            known.hits.append((begin + distance, offset + pixel, math.isinf(hidden)))
        elif status in (tracer.HIT, tracer.BLOCKED):
            known.blocks.append((begin + distance, begin + distance + _thickness(one, pixel)))
        elif status == tracer.ESCAPED and layer == 0:
            known.escapes = True


def _thickness(one, pixel) -> float:
    front, slab = float(one.front[pixel]), float(one.slab[pixel])
    if one.camera.is_orthographic:
        return slab
    return 1.0 / (front - slab) - 1.0 / front if front > slab else math.inf
