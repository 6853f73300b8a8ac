# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples at one pixel of every cell, and how they become light of all pixels.

After Kopf, Cohen, Lischinski and Uyttendaele 2007, "Joint Bilateral Upsampling": a pixel takes the samples of
the four cells around it by its place between them, by their distance from its tangent plane and by normal.
What has no sample on its own surface (thin things, rims) is given some of its own: another one of its cell,
and what even then is left, one at its own pixel.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from . import parallel
from .camera import Camera
from .cells import chosen_pixels, grid_shape
from .denoise import filter_points
from .frame_points import surface_points
from .gbuffer import GBuffer
from .types import FloatArray, IntArray

# A sample one cell's footprint times this off the pixel's tangent plane no longer counts.
_PLANE_WIDTH = 1.0
# The cosine between normals counts to the power of 2 to this.
_NORMAL_SQUARINGS = 3
# Pixels whose samples weigh less than this together have none on their own surface.
_LEAST_WEIGHT = 0.05
# Samples per cell, each for what the ones before it are no samples of.
_LAYERS = 2
# Pixels that receive at a time: what is read and written for them stays in the cache.
_PIXELS_PER_TASK = 16384


@dataclass(frozen=True, eq=False)
class SampleGrid:
    """Which pixels have samples, and which samples count for every pixel.

    Attributes
    ----------
    shape
        Rows and columns of cells.
    stride
        Pixels per cell and axis.
    layers
        Flat indices of the cells (G,) that have samples; then of those that have another one, for what the
        first is no sample of; and so on.
    pixel : (S,) int64
        Flat indices of the sampled pixels: one per cell of each layer, then those that have a sample alone.
    pattern : (S,) int64
        Pixels whose sampling pattern each takes: neighbouring cells sample as evenly as neighbouring pixels.
    slot : (4, P) int32
        Samples that count for each receiving pixel.
    weight : (4, P) float32
        By how much; they sum to 1.
    nearest : (P,) int32
        The sample that counts most.
    """

    shape: tuple[int, int]
    stride: int
    layers: tuple[IntArray, ...]
    pixel: IntArray
    pattern: IntArray
    slot: np.ndarray
    weight: FloatArray
    nearest: np.ndarray

    @classmethod
    def of(
        cls, gbuffer: GBuffer, camera: Camera, receivers: IntArray, stride: int, threads: int | None
    ) -> SampleGrid:
        """Choose samples for some pixels (P,) of a view.

        Parameters
        ----------
        gbuffer, camera
            The view.
        receivers
            Flat indices of the pixels that need light; all are surfaces.
        stride
            Pixels per cell and axis.
        threads
            Worker threads.
        """
        shape, width = grid_shape(gbuffer.shape, stride), gbuffer.shape[1]
        slot = np.zeros((4, receivers.size), dtype=np.int32)
        weight = np.zeros((4, receivers.size), dtype=gbuffer.depth.dtype)
        layers: list[IntArray] = []
        chosen: list[IntArray] = []
        pattern: list[IntArray] = []
        left, count = np.arange(receivers.size), 0
        while left.size and len(layers) < _LAYERS:
            lacking = np.zeros(gbuffer.shape, dtype=np.bool_)
            lacking.reshape(-1)[receivers.take(left)] = True
            cells, pixel = chosen_pixels(lacking, stride, 0, shape[0])
            samples = _Layer.of(gbuffer, camera, cells, pixel, stride, first=count)
            is_answered = samples.weigh(receivers, left, slot, weight, threads)
            layers.append(cells)
            chosen.append(pixel)
            pattern.append(cells // shape[1] * width + cells % shape[1])
            left, count = left[~is_answered], count + cells.size
        slot[:, left] = np.arange(count, count + left.size)
        weight[:, left] = np.array([[1.0], [0.0], [0.0], [0.0]])
        alone = receivers.take(left)
        nearest = np.take_along_axis(slot, weight.argmax(axis=0)[None], axis=0)[0]
        return cls(
            shape, stride, tuple(layers), np.concatenate([*chosen, alone]), np.concatenate([*pattern, alone]),
            slot, weight, nearest,
        )  # fmt: skip

    def filter(
        self,
        gbuffer: GBuffer,
        camera: Camera,
        parts: list[FloatArray],
        variance: FloatArray,
        levels: int,
        threads: int | None,
        luminance_levels: int,
    ) -> list[FloatArray]:
        """Smooth the samples of cells among each other, as `denoise.filter_light`.

        Passes that reach less than a cell are left out, and one that reaches farther takes their place: there
        are fewer samples. Samples of single pixels stay as they are.

        Parameters
        ----------
        gbuffer, camera
            The view.
        parts : (S, C) each
            Light to smooth.
        variance : (S,)
            Of the luminance of the first part.
        levels
            Passes of the filter at full resolution.
        threads
            Worker threads.
        luminance_levels
            The last passes, which look at luminance.
        """
        passes = levels + 2 - self.stride.bit_length()
        position, normal = surface_points(gbuffer, camera, self.pixel)
        per_footprint, first = max(camera.fx, camera.fy) / self.stride, 0
        smooth = [part.copy() for part in parts]
        for cells in self.layers:
            own = slice(first, first + cells.size)
            found = filter_points(
                self.shape, (position[:, own], normal[:, own]), per_footprint, camera.is_orthographic, cells,
                [part[own] for part in parts], variance[own], passes, threads, passes - luminance_levels,
            )  # fmt: skip
            for part, values in zip(smooth, found, strict=True):
                part[own] = values
            first = own.stop
        return smooth

    def spread(self, parts: Iterable[FloatArray], threads: int | None) -> list[FloatArray]:
        """Return what the samples' values (S, C) or (S,) are at all receiving pixels, (P, C) or (P,)."""
        return [self._spread(part, threads) for part in parts]

    def _spread(self, part: FloatArray, threads: int | None) -> FloatArray:
        spread = np.empty((self.nearest.size, *part.shape[1:]), dtype=part.dtype)

        def work(slots: IntArray) -> None:
            where = slice(slots[0], slots[-1] + 1)
            shape = (-1,) + (1,) * (part.ndim - 1)
            total = part.take(self.slot[0, where], axis=0)
            total *= self.weight[0, where].reshape(shape)
            for slot, weight in zip(self.slot[1:, where], self.weight[1:, where], strict=True):
                value = part.take(slot, axis=0)
                value *= weight.reshape(shape)
                total += value
            spread[where] = total

        chunks = parallel.split(np.arange(spread.shape[0]), _PIXELS_PER_TASK)
        parallel.run_chunks(work, chunks, threads)
        return spread


@dataclass(frozen=True, eq=False)
class _Layer:
    """One sampled pixel of some cells, as points of the grid with a border of nothing around it."""

    gbuffer: GBuffer
    camera: Camera
    stride: int
    columns: int
    number: np.ndarray
    points: FloatArray

    @classmethod
    def of(
        cls, gbuffer: GBuffer, camera: Camera, cells: IntArray, pixel: IntArray, stride: int, first: int
    ) -> _Layer:
        """Return the layer of some cells' sampled pixels, which are numbered from `first` on."""
        rows, columns = grid_shape(gbuffer.shape, stride)
        row, column = np.divmod(cells, columns)
        place = (row + 1) * (columns + 2) + column + 1
        number = np.zeros((rows + 2) * (columns + 2), dtype=np.int32)
        number[place] = np.arange(first, first + cells.size)
        # A normal of nothing is like no other
        points = np.zeros((6, number.size), dtype=gbuffer.depth.dtype)
        position, normal = surface_points(gbuffer, camera, pixel)
        points[:3, place], points[3:, place] = position, normal
        return cls(gbuffer, camera, stride, columns + 2, number, points)

    def weigh(
        self, receivers: IntArray, left: IntArray, slot: np.ndarray, weight: FloatArray, threads: int | None
    ) -> np.ndarray:
        """Set samples and weights (4, P) of the receivers that are left; return which have enough (L,)."""
        is_answered = np.zeros(left.size, dtype=np.bool_)

        def work(slots: IntArray) -> None:
            own = left[slots]
            number, share = self.around(receivers.take(own))
            total = share.sum(axis=0)
            share *= 1.0 / np.maximum(total, _LEAST_WEIGHT)
            slot[:, own], weight[:, own] = number, share
            is_answered[slots] = total >= _LEAST_WEIGHT

        parallel.run_chunks(work, parallel.split(np.arange(left.size), _PIXELS_PER_TASK), threads)
        return is_answered

    def around(self, pixel: IntArray) -> tuple[np.ndarray, FloatArray]:
        """Return the samples (4, N) of the cells around pixels, and their weights (4, N)."""
        width = self.gbuffer.shape[1]
        point, axis = surface_points(self.gbuffer, self.camera, pixel)
        dtype = point.dtype.type
        # From the middle of the cell above and to the left, in cells
        row, column = np.divmod(pixel, width)
        y, x = ((at + (0.5 + 0.5 * self.stride)) / self.stride for at in (row, column))
        top, left = np.floor(y).astype(np.int64), np.floor(x).astype(np.int64)
        down, right = (y - top).astype(dtype), (x - left).astype(dtype)
        offset = (axis * point).sum(axis=0)
        per_cell = max(self.camera.fx, self.camera.fy) / (_PLANE_WIDTH * self.stride)
        scale = dtype(per_cell) if self.camera.is_orthographic else dtype(-per_cell) / point[2]
        slot = np.empty((4, pixel.size), dtype=np.int32)
        weight = np.empty((4, pixel.size), dtype=point.dtype)
        kernels = ((1.0 - down, 1.0 - right), (1.0 - down, right), (down, 1.0 - right), (down, right))
        for tap, (of_row, of_column) in enumerate(kernels):
            place = (top + tap // 2) * self.columns + left + tap % 2
            slot[tap] = self.number.take(place)
            x, y, z, nx, ny, nz = self.points.take(place, axis=1)
            similarity = np.maximum(axis[0] * nx + axis[1] * ny + axis[2] * nz, 0.0)
            for _ in range(_NORMAL_SQUARINGS):
                similarity *= similarity
            off_plane = np.abs((axis[0] * x + axis[1] * y + axis[2] * z - offset) * scale)
            similarity *= np.maximum(1.0 - off_plane, 0.0)
            weight[tap] = similarity * of_row * of_column
        return slot, weight
