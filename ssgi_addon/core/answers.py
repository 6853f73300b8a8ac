# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays met, merged from all views and layers that they crossed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import tracer
from .depth_field import DepthField
from .types import BoolArray, FloatArray, IntArray, StatusArray

# Distances that differ by less are one: each view computes them in its own space.
TOUCHING = 1.0 + 1e-4
# What lies before this part of the open stretch is not there; nearer to its end views differ by their pixels.
SURELY_BEFORE = 0.98


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
    distance : (N,) float32
        To the hit, in units of the direction's length; +inf for all other rays.
    x_px, y_px : (N,) float32
        Where in its view's image the hit lies; 0 for all other rays.
    """

    status: StatusArray
    texel: IntArray
    distance: FloatArray
    x_px: FloatArray
    y_px: FloatArray

    def brings_environment(self, unknown: str) -> BoolArray:
        """Return (N,) which rays bring the environment: escapes, and others where `unknown` says so."""
        least = tracer.UNKNOWN if unknown == "environment" else tracer.ESCAPED
        return (self.status >= least) & (self.status <= tracer.ESCAPED)


@dataclass(frozen=True, eq=False)
class Sight:
    """How far views saw rays go: each listed ray lies in the open from `begin` to `end`."""

    ray: IntArray
    begin: FloatArray
    end: FloatArray


@dataclass(frozen=True, eq=False)
class _Hits:
    """What one field hit: of each listed ray, and whether the ray was in that field's sight all the way."""

    ray: IntArray
    texel: IntArray
    distance: FloatArray
    x: FloatArray
    y: FloatArray
    is_in_sight: BoolArray


class MergedAnswers:
    """The nearest answer that several fields give to the same rays.

    What a view saw a ray pass in the open, in front of all its surfaces, is empty, whatever another view
    guesses to be there that has lost sight of the ray: a hit on entry, or something in the way. Beyond what
    any view saw, a ray that one field blocks at distance t takes hits of the others up to t plus the blocking
    surface's thickness.
    """

    def __init__(self, count: int, dtype: np.dtype[Any]) -> None:
        self.nearest = np.full(count, np.inf, dtype=dtype)
        self.escapes = np.zeros(count, dtype=np.bool_)
        self.open_until = np.zeros(count, dtype=dtype)
        self._hits: list[_Hits] = []
        self._blocks: list[tuple[IntArray, FloatArray, FloatArray]] = []
        self._sights: list[Sight] = []

    def add(
        self,
        field: DepthField,
        offset: int,
        ray: IntArray,
        found: tracer.TraceResult,
        is_lit: BoolArray | None = None,
    ) -> None:
        """Take in what one field answers to the listed rays; its pixels are texels from `offset` on.

        `is_lit` is given for a layer behind, (H*W,): the bounces that such a layer receives are not known, so
        what no light reaches directly is in the way, and no answer. Nor is its background the sky: nothing
        was captured there.
        """
        hit, blocked = (np.flatnonzero(found.status == kind) for kind in (tracer.HIT, tracer.BLOCKED))
        if is_lit is None:
            self.escapes[ray[found.status == tracer.ESCAPED]] = True
        else:
            shows = is_lit.take(found.pixel.take(hit))
            hit, blocked = hit[shows], np.concatenate([blocked, hit[~shows]])
        hits = _Hits(
            ray.take(hit),
            found.pixel.take(hit) + offset,
            found.distance.take(hit),
            found.x_px.take(hit),
            found.y_px.take(hit),
            np.isinf(found.hidden.take(hit)),
        )
        self._hits.append(hits)
        self.nearest[hits.ray] = np.minimum(self.nearest.take(hits.ray), hits.distance)
        begin = found.distance.take(blocked)
        limit = begin + _thickness(field, found.pixel.take(blocked))
        self._blocks.append((ray.take(blocked), begin, limit))

    def see(self, sight: Sight) -> None:
        """Take in what one view saw; nothing is lost if it begins where others have not seen the ray yet."""
        self._sights.append(sight)
        for _ in self._sights:
            # All of them each time: rays that need the same ones may need them in another order
            goes_on = [self._extend(known) for known in self._sights]
            if not any(goes_on):
                return

    def _extend(self, sight: Sight) -> bool:
        """Follow rays on that come into sight before what is known of them ends; return if any goes on."""
        known = self.open_until.take(sight.ray)
        further = np.flatnonzero((sight.begin <= known * TOUCHING) & (sight.end > known))
        self.open_until[sight.ray.take(further)] = sight.end.take(further)
        return further.size > 0

    def is_uncertain(self) -> BoolArray:
        """Return (N,) which rays no view saw all the way to what they hit, or to the sky."""
        nearest = np.full_like(self.open_until, np.inf)
        for hits, kept in self._nearer_and_nearer(nearest):
            nearest[hits.ray.take(kept)] = hits.distance.take(kept)
        is_open: BoolArray = (self.open_until >= nearest) | np.isinf(self.open_until)
        return ~is_open

    def _nearer_and_nearer(self, nearest: FloatArray) -> Iterator[tuple[_Hits, IntArray]]:
        """Yield what was hit, and which of it is there and nearer than the caller's `nearest` by then."""
        for hits in self._hits:
            is_there = hits.is_in_sight | (hits.distance >= SURELY_BEFORE * self.open_until.take(hits.ray))
            yield hits, np.flatnonzero(is_there & (hits.distance < nearest.take(hits.ray)))

    def answers(self, texels: int) -> Answers:
        """Return what is known by now; `texels` is the texel of rays that hit nothing."""
        count = self.nearest.shape[0]
        is_blocked = np.zeros(count, dtype=np.bool_)
        nearest, limit = np.full((2, count), np.inf, dtype=self.nearest.dtype)
        texel, (x, y) = np.zeros(count, dtype=np.int64), np.zeros((2, count), dtype=nearest.dtype)
        for hits, kept in self._nearer_and_nearer(nearest):
            ray = hits.ray.take(kept)
            for all_rays, own in ((nearest, hits.distance), (texel, hits.texel), (x, hits.x), (y, hits.y)):
                all_rays[ray] = own.take(kept)
        for ray, begin, until in self._blocks:
            is_unseen = np.flatnonzero(begin >= self.open_until.take(ray))
            ray = ray.take(is_unseen)
            is_blocked[ray] = True
            limit[ray] = np.minimum(limit.take(ray), until.take(is_unseen))  # +inf: solid without end
        is_hit = (nearest < np.inf) & (nearest <= limit)
        # Something in the way is more certain than an open sky
        cases = [is_hit, is_blocked, self.escapes]
        kinds = [np.int8(tracer.HIT), np.int8(tracer.BLOCKED), np.int8(tracer.ESCAPED)]
        return only_hits(np.select(cases, kinds, np.int8(tracer.UNKNOWN)), texel, nearest, x, y, texels)


def sight_through_layers(found: Sequence[tracer.TraceResult], followed: Sequence[IntArray]) -> FloatArray:
    """Return how far rays lie in the open for a view with layers.

    Behind the back of what the front layer shows, a ray is in the open again as long as it is in front of the
    next layer.

    Parameters
    ----------
    found
        What each layer answers, front first.
    followed
        Which of the rays of one layer the next one was asked about, as indices; one entry less than `found`.
    """
    *fronts, last = found
    end = np.minimum(last.distance, last.hidden)
    for layer, asked in zip(reversed(fronts), reversed(followed), strict=True):
        in_sight = layer.hidden.copy()
        in_sight[asked] = np.maximum(in_sight.take(asked), end)
        end = np.minimum(layer.distance, in_sight)
    return end


def only_hits(
    status: StatusArray, texel: IntArray, distance: FloatArray, x: FloatArray, y: FloatArray, texels: int
) -> Answers:
    """Return answers that hold nothing of rays that hit nothing; the arrays become the answers' own."""
    other = np.flatnonzero(status != tracer.HIT)
    for values, nothing in ((texel, texels), (distance, np.inf), (x, 0.0), (y, 0.0)):
        values[other] = nothing
    return Answers(status, texel, distance, x, y)


def _thickness(field: DepthField, pixel: IntArray) -> FloatArray:
    """Return the thickness of the slabs of some pixels, scene units."""
    planes = field.planes.take(pixel, axis=0)
    front: FloatArray = planes[:, 0]
    slab: FloatArray = planes[:, 3]
    if field.camera.is_orthographic:
        return slab
    # 1 / (front - slab) - 1 / front, whose difference has no digits left where things are thin
    with np.errstate(divide="ignore"):
        thickness: FloatArray = slab / front / (front - slab)
    return thickness
