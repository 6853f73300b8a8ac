# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays met, merged from all views and layers that they crossed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from . import tracer
from .depth_field import DepthField
from .types import BoolArray, FloatArray, IntArray, StatusArray


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


class MergedAnswers:
    """The nearest answer that several fields give to the same rays.

    A ray that one field blocks at distance t takes hits of the others up to t plus the blocking surface's
    thickness.
    """

    def __init__(self, count: int, dtype: np.dtype[Any]) -> None:
        self.texel = np.zeros(count, dtype=np.int64)
        self.nearest = np.full(count, np.inf, dtype=dtype)
        self.limit = np.full(count, np.inf, dtype=dtype)
        self.x_px, self.y_px = np.zeros((2, count), dtype=dtype)
        self.escapes = np.zeros(count, dtype=np.bool_)

    def add(self, field: DepthField, offset: int, ray: IntArray, found: tracer.TraceResult) -> None:
        """Take in what one field answers to the listed rays; its pixels are texels from `offset` on."""
        hit = np.flatnonzero(found.status == tracer.HIT)
        hit = hit[found.distance.take(hit) < self.nearest.take(ray.take(hit))]
        to = ray.take(hit)
        self.nearest[to] = found.distance.take(hit)
        self.texel[to] = found.pixel.take(hit) + offset
        self.x_px[to], self.y_px[to] = found.x_px.take(hit), found.y_px.take(hit)
        blocked = np.flatnonzero(found.status == tracer.BLOCKED)
        limit = found.distance.take(blocked) + _thickness(field, found.pixel.take(blocked))
        blocked = ray.take(blocked)
        self.limit[blocked] = np.minimum(self.limit.take(blocked), limit)
        self.escapes[ray[found.status == tracer.ESCAPED]] = True

    def status(self) -> StatusArray:
        """Return each ray's status: something in the way is more certain than an open sky."""
        is_hit = (self.nearest < np.inf) & (self.nearest <= self.limit)
        cases = [is_hit, self.limit < np.inf, self.escapes]
        kinds = [np.int8(tracer.HIT), np.int8(tracer.BLOCKED), np.int8(tracer.ESCAPED)]
        return np.select(cases, kinds, np.int8(tracer.UNKNOWN))

    def answers(self, texels: int) -> Answers:
        """Return what is known by now; `texels` is the texel of rays that hit nothing."""
        return only_hits(self.status(), self.texel, self.nearest, self.x_px, self.y_px, texels)


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
    with np.errstate(divide="ignore"):
        thickness: FloatArray = 1.0 / (front - slab) - 1.0 / front
    return thickness
