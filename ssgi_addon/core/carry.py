# SPDX-License-Identifier: GPL-3.0-or-later
"""Carry values from the surfaces of one view to those of another: joint bilateral upsampling.

After Kopf, Cohen, Lischinski and Uyttendaele 2007, "Joint Bilateral Upsampling": what a coarse image holds is
read with weights that tell surfaces apart on the fine one. Here depth and normal tell them: a sample counts
by its distance on the coarse image, from the receiving point's tangent plane, and by its normal. Both views
are placed in the world, so they may have cameras of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from . import parallel
from .camera import Camera, move_between
from .frame_points import move_rays, surface_points
from .gbuffer import GBuffer
from .types import BoolArray, FloatArray, IntArray

_Weigh = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]

# Samples are read up to so many pixels of their view away.
_REACH = 2
# A sample one pixel's footprint times this off the receiver's plane is no part of its surface.
_PLANE_WIDTH = 1.0
# The cosine between normals counts to the power of 2 to this.
_NORMAL_SQUARINGS = 5
# Where no sample lies on the receiver's surface, those within so many footprints of it count instead.
_NEAR = 8.0
# Less weight than this is no answer.
_LEAST_WEIGHT = 1e-3


def carry_over(
    parts: Sequence[FloatArray],
    source: tuple[GBuffer, Camera],
    target: tuple[GBuffer, Camera],
    pixel: IntArray,
    threads: int | None,
    *,
    is_strict: bool = False,
    is_loose: bool = False,
    reach: int | None = None,
) -> tuple[list[FloatArray], BoolArray]:
    """Read values of one view's surfaces at points of another's.

    Where nothing lies on a point's own surface (thin things, silhouettes), the samples near to it in space
    that do not look away count, the nearest most.

    Parameters
    ----------
    parts : (h * w, C) each
        Values of all pixels of the source.
    source, target
        Views, placed by `Camera.world_from_view`; of the G-buffers only depth and normal are read.
    pixel : (P,)
        Flat indices of the target's surfaces to answer.
    threads
        Worker threads.
    is_strict
        Only samples on a point's own surface count.
    is_loose
        Where nothing lies near in space either, whatever lies beside it on the image counts.
    reach
        Samples are read up to so many pixels of the source away: 1 reads four of them, and more where none
        of those counts; 2 reads sixteen. None means 2.

    Returns
    -------
    values : (P, C) each
        0 where nothing is found.
    is_found : (P,)
        Where the source sees the point, or something near to it.
    """
    gbuffer, camera = source
    sampled = _Samples(gbuffer, camera, _REACH if reach is None else reach)
    weighs = [_on_surface] if is_strict else [_on_surface, _in_space, *[_on_image] * is_loose]
    values = [np.zeros((pixel.size, part.shape[1]), dtype=part.dtype) for part in parts]
    is_found = np.zeros(pixel.size, dtype=np.bool_)
    move = move_between(target[1], camera)
    is_moved = not np.array_equal(move, np.eye(4))

    def work(slots: IntArray) -> None:
        point, axis = surface_points(*target, pixel.take(slots))
        if is_moved:
            point, axis = move_rays(move, point, axis)
        is_found[slots] = sampled.read(parts, point, axis, weighs, slots, values)

    parallel.run_chunks(work, parallel.split(np.arange(pixel.size), parallel.RAYS_PER_TASK // 4), threads)
    return values, is_found


class _Samples:
    """The pixels of a view as points in its space."""

    def __init__(self, gbuffer: GBuffer, camera: Camera, reach: int) -> None:
        self.shape, self.camera, self.reach = gbuffer.shape, camera, reach
        with np.errstate(invalid="ignore"):
            self.position, self.normal = surface_points(gbuffer, camera, np.arange(gbuffer.depth.size))
        # In place of an endless distance; normals are zero there, so nothing has weight
        self.position[:, gbuffer.is_background.reshape(-1)] = 0.0

    def read(
        self,
        parts: Sequence[FloatArray],
        point: FloatArray,
        axis: FloatArray,
        weighs: Sequence[_Weigh],
        slots: IntArray,
        values: Sequence[FloatArray],
    ) -> BoolArray:
        """Set `values` of some points with normals, in this view's space; return where any are found.

        Each way to weigh samples is for the points that those before it left.
        """
        is_found = np.zeros(slots.size, dtype=np.bool_)
        left = self._in_sight(point)
        near = [(weighs[0], self.reach)] if self.reach < _REACH else []
        for weigh, reach in (*near, *((weigh, _REACH) for weigh in weighs)):
            mean = self._mean(parts, point.take(left, axis=1), axis.take(left, axis=1), weigh, reach)
            is_read = mean.weight > _LEAST_WEIGHT
            read = np.flatnonzero(is_read)
            for value, read_value in zip(values, mean.means(read), strict=True):
                value[slots.take(left.take(read))] = read_value
            is_found[left.take(read)] = True
            left = left.take(np.flatnonzero(~is_read))
        return is_found

    def _in_sight(self, point: FloatArray) -> IntArray:
        """Return which points have pixels of this view near them."""
        height, width = self.shape
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            x, y, depth = self.camera.view_to_pixel(point.T)
            is_near = (x > -_REACH) & (x < width + _REACH) & (y > -_REACH) & (y < height + _REACH)
        if not self.camera.is_orthographic:
            is_near &= depth > 0.0
        return np.flatnonzero(is_near)

    def _mean(
        self, parts: Sequence[FloatArray], point: FloatArray, axis: FloatArray, weigh: _Weigh, reach: int
    ) -> _Mean:
        """Return the mean over the samples around points, each by its place on the image times a weight."""
        camera, (height, width) = self.camera, self.shape
        x, y, depth = camera.view_to_pixel(point.T)
        per_footprint = max(camera.fx, camera.fy) / (np.ones_like(x) if camera.is_orthographic else depth)
        mean = _Mean(x.size, parts)
        left, top = (np.floor(at - 0.5).astype(np.int64) for at in (x, y))
        for down in range(1 - reach, reach + 1):
            row = top + down
            row_kernel = _tent(row.astype(y.dtype) + 0.5 - y, reach) * ((row >= 0) & (row < height))
            for right in range(1 - reach, reach + 1):
                column = left + right
                kernel = _tent(column.astype(x.dtype) + 0.5 - x, reach) * ((column >= 0) & (column < width))
                texel = np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)
                apart, other = self.position.take(texel, axis=1), self.normal.take(texel, axis=1)
                apart -= point
                cosine = axis[0] * other[0] + axis[1] * other[1] + axis[2] * other[2]
                weight = weigh(apart, axis, cosine, per_footprint)
                mean.add(texel, weight * kernel * row_kernel)
        return mean


def _on_surface(
    apart: FloatArray, axis: FloatArray, cosine: FloatArray, per_footprint: FloatArray
) -> FloatArray:
    """Return how far samples belong to the surfaces of points: by distance from their planes, and normals."""
    off_plane = np.abs(apart[0] * axis[0] + apart[1] * axis[1] + apart[2] * axis[2]) * per_footprint
    cosine = np.maximum(cosine, 0.0)
    for _ in range(_NORMAL_SQUARINGS):
        cosine = cosine * cosine
    weight: FloatArray = cosine * np.maximum(1.0 - off_plane * (1.0 / _PLANE_WIDTH), 0.0)
    return weight


def _in_space(
    apart: FloatArray, axis: FloatArray, cosine: FloatArray, per_footprint: FloatArray
) -> FloatArray:
    """Return how near samples lie to points, as far as they do not look away."""
    distance = np.sqrt(apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2) * per_footprint
    weight: FloatArray = np.maximum(cosine, 0.0) * np.maximum(1.0 - distance * (1.0 / _NEAR), 0.0)
    return weight


def _on_image(
    apart: FloatArray, axis: FloatArray, cosine: FloatArray, per_footprint: FloatArray
) -> FloatArray:
    """Return the same weight for all surfaces; background has no normal."""
    weight: FloatArray = (cosine != 0.0).astype(cosine.dtype)
    return weight


class _Mean:
    """A weighted mean of samples' values, being added up."""

    def __init__(self, count: int, parts: Sequence[FloatArray]) -> None:
        self.parts = parts
        self.sums = [np.zeros((count, part.shape[1]), dtype=part.dtype) for part in parts]
        self.weight = np.zeros(count, dtype=parts[0].dtype)

    def add(self, texel: IntArray, weight: FloatArray) -> None:
        self.weight += weight
        for total, part in zip(self.sums, self.parts, strict=True):
            total += weight[:, None] * part.take(texel, axis=0)

    def means(self, chosen: IntArray) -> list[FloatArray]:
        inverse = 1.0 / self.weight.take(chosen)
        return [total.take(chosen, axis=0) * inverse[:, None] for total in self.sums]


def _tent(offset: FloatArray, reach: int) -> FloatArray:
    weight: FloatArray = np.maximum(1.0 - np.abs(offset) * (1.0 / reach), 0.0)
    return weight
