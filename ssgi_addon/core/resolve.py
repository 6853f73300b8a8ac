# SPDX-License-Identifier: GPL-3.0-or-later
"""Reuse of reflection rays by the pixels around them.

After Stachowiak and Uludag 2015, "Stochastic Screen-Space Reflections": what a ray found counts for every
pixel near it on the same surface, with the weight f cos / pdf of that pixel's own lobe over the density that
the ray was drawn with, normalised by the sum of the weights. Rays that found nothing keep their weight.
A pixel need not have rays of its own, so fewer rays than pixels may be traced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import parallel
from .camera import Camera
from .cells import chosen_pixels, grid_shape
from .frame_points import surface_points, toward_camera
from .gbuffer import GBuffer
from .light import luminance
from .lobes import Lobes
from .types import BoolArray, FloatArray, IntArray

# Rays are borrowed from at most this many cells of the grid away.
MARGIN = 3
# A neighbour so many times its distance on the grid off the pixel's tangent plane no longer counts.
_PLANE_WIDTH = 1.0
# The cosine between normals counts to the power of 2 to this.
_NORMAL_SQUARINGS = 5
# No borrowed ray counts more than this many of the pixel's own.
_MOST_WEIGHT = 4.0
# Pixels that receive at a time: what is read and written for them stays in the cache.
_PIXELS_PER_TASK = 16384


class RayGrid:
    """One or more rays from one pixel of every cell of ``stride`` x ``stride`` pixels, for a band of rows.

    The arrays hold the band's cells and MARGIN more on every side, with rays where the frame has some there.

    Attributes
    ----------
    stride
        Pixels per cell and axis.
    top, bottom
        First row of cells of the band, and the one after its last.
    columns
        Cells per row.
    cells : (N,) int64
        Flat indices, in the whole frame's grid, of the cells that have rays.
    pixel : (N,) int64
        The pixels that they start from.
    position, normal : (3, bottom - top + 2 MARGIN, columns + 2 MARGIN) float32
        Of those pixels, view space.
    direction : (rays, 3, ...) float32
        Unit directions.
    inverse_distance, inverse_pdf, known : (rays, ...) float32
        1 / distance to the hit (0 for none), 1 / density per steradian (0 where there is no ray), and how far
        the ray was answered, 0..1.
    is_hidden : (rays, ...) bool
        Rays that ended behind something.
    radiance : (rays, 3, ...) float32
        What each ray brings.
    """

    def __init__(
        self, is_active: BoolArray, stride: int, rays: int, top: int, bottom: int, dtype: np.dtype
    ) -> None:
        rows, self.columns = grid_shape(is_active.shape, stride)
        self.stride, self.top, self.bottom = stride, top, bottom
        self.cells, self.pixel = chosen_pixels(
            is_active, stride, max(0, top - MARGIN), min(rows, bottom + MARGIN)
        )
        shape = (bottom - top + 2 * MARGIN, self.columns + 2 * MARGIN)
        self.position = np.zeros((3, *shape), dtype=dtype)
        self.normal = np.zeros((3, *shape), dtype=dtype)
        self.direction = np.zeros((rays, 3, *shape), dtype=dtype)
        self.inverse_distance = np.zeros((rays, *shape), dtype=dtype)
        self.inverse_pdf = np.zeros((rays, *shape), dtype=dtype)
        self.known = np.zeros((rays, *shape), dtype=dtype)
        self.is_hidden = np.zeros((rays, *shape), dtype=np.bool_)
        self.radiance = np.zeros((rays, 3, *shape), dtype=dtype)

    def places(self, cells: IntArray) -> IntArray:
        """Return where cells stand in the flat arrays."""
        row, column = np.divmod(cells, self.columns)
        places: IntArray = (row - self.top + MARGIN) * self.position.shape[2] + column + MARGIN
        return places

    def set_rays(
        self,
        places: IntArray,
        position: FloatArray,
        normal: FloatArray,
        direction: FloatArray,
        pdf: FloatArray,
    ) -> None:
        """Store where rays start (3, N), their directions (3, rays, N) and densities (rays, N)."""
        self.position.reshape(3, -1)[:, places] = position
        self.normal.reshape(3, -1)[:, places] = normal
        rays = pdf.shape[0]
        self.direction.reshape(rays, 3, -1)[:, :, places] = direction.transpose(1, 0, 2)
        self.inverse_pdf.reshape(rays, -1)[:, places] = 1.0 / np.maximum(pdf, 1e-20)

    def set_answers(
        self,
        ray: int,
        places: IntArray,
        inverse_distance: FloatArray,
        radiance: FloatArray,
        known: FloatArray,
        is_hidden: BoolArray,
    ) -> None:
        """Store what one ray of some cells found; radiance (N, 3), all else (N,)."""
        self.inverse_distance[ray].reshape(-1)[places] = inverse_distance
        self.radiance[ray].reshape(3, -1)[:, places] = radiance.T
        self.known[ray].reshape(-1)[places] = known
        self.is_hidden[ray].reshape(-1)[places] = is_hidden


class LobeSums:
    """Weighted sums over rays, per pixel of the frame or of a part of it.

    Attributes
    ----------
    radiance : (3, ...) float32
        Σ w L.
    weight, known, hidden, nearness : (...) float32
        Σ w; Σ w over what was answered, and over what ended behind something; Σ w / distance.
    squared, first, second : (...) float32
        Σ w², Σ w² l and Σ w² l² with the luminance l.
    """

    def __init__(self, sums: FloatArray) -> None:
        self.sums, self.radiance = sums, sums[:3]
        self.weight, self.known, self.hidden, self.nearness, self.squared, self.first, self.second = sums[3:]

    @classmethod
    def zero(cls, shape: tuple[int, int], dtype: np.dtype) -> LobeSums:
        """Return the sums over no rays."""
        return cls(np.zeros((10, *shape), dtype=dtype))

    def take(self, pixel: IntArray) -> LobeSums:
        """Return a copy of some pixels' sums."""
        return LobeSums(self.sums.reshape(10, -1).take(pixel, axis=1))

    def put(self, pixel: IntArray, found: LobeSums) -> None:
        """Set the sums of some pixels."""
        self.sums.reshape(10, -1)[:, pixel] = found.sums


def keep(grid: RayGrid, sums: LobeSums) -> None:
    """Add to the sums what the one ray of each mirror found, for the pixel that it starts from alone."""
    row = grid.cells // grid.columns
    own = np.flatnonzero((row >= grid.top) & (row < grid.bottom))
    pixel, places = grid.pixel.take(own), grid.places(grid.cells.take(own))
    for total, found in (
        (sums.radiance, grid.radiance[0]),
        (sums.known, grid.known),
        (sums.hidden, grid.is_hidden),
        (sums.nearness, grid.inverse_distance),
    ):
        rows = total.reshape(-1, sums.weight.size)
        rows[:, pixel] = found.reshape(rows.shape[0], -1).take(places, axis=1)
    sums.weight.reshape(-1)[pixel] = 1.0
    sums.squared.reshape(-1)[pixel] = 1.0


def neighbour_offsets(stride: int, phase: tuple[int, int], count: int) -> Sequence[tuple[int, int]]:
    """Return the cells (down, right) whose rays a pixel takes: its own first, then the nearest ones.

    Parameters
    ----------
    stride
        Of the grid.
    phase
        Row and column of the pixel within its cell.
    count
        Of cells beside its own.
    """
    y, x = ((p + 0.5) / stride - 0.5 for p in phase)
    reach = range(-MARGIN, MARGIN + 1)
    order = sorted(
        ((down - y) ** 2 + (right - x) ** 2, abs(down - right), down, right)
        for down in reach
        for right in reach
    )
    return [(down, right) for _, _, down, right in order[: count + 1]]


def resolve(
    grid: RayGrid,
    gbuffer: GBuffer,
    camera: Camera,
    is_active: BoolArray,
    reuse: int,
    is_elongated: bool,
    sums: LobeSums,
    threads: int | None,
) -> None:
    """Add what the rays of a grid found to the sums of the pixels that take part.

    Parameters
    ----------
    grid
        Rays with their answers.
    gbuffer, camera
        The frame.
    is_active : (H, W)
        The pixels that receive.
    reuse
        Cells beside its own whose rays a pixel takes.
    is_elongated
        As in `Lobes.at`.
    sums
        Of the frame; changed.
    threads
        Worker threads.
    """
    height, width = gbuffer.shape
    stride = grid.stride
    rows = slice(grid.top * stride, min(grid.bottom * stride, height))
    receiving = np.flatnonzero(is_active[rows]) + rows.start * width
    offsets = np.array(
        [neighbour_offsets(stride, (y, x), reuse) for y in range(stride) for x in range(stride)]
    )  # (phases, 1 + reuse, 2)
    steps = offsets[..., 0] * grid.position.shape[2] + offsets[..., 1]
    # A sample that far off, in pixels, may lie as much farther off the plane
    per_pixel = (1.0 / (_PLANE_WIDTH * stride * np.maximum(np.abs(offsets).max(axis=-1), 1))).astype(
        grid.position.dtype
    )

    def work(pixel: IntArray) -> None:
        row, column = np.divmod(pixel, width)
        (row, phase_y), (column, phase_x) = np.divmod(row, stride), np.divmod(column, stride)
        own, phase = grid.places(row * grid.columns + column), phase_y * stride + phase_x
        found = sums.take(pixel)
        band = _Receivers.of(gbuffer, camera, pixel, is_elongated)
        for neighbour in range(reuse + 1):
            there = own + steps[:, neighbour].take(phase)
            _borrow(grid, band, there, per_pixel[:, neighbour].take(phase), found)
        sums.put(pixel, found)

    parallel.run_chunks(work, parallel.split(receiving, _PIXELS_PER_TASK), threads)


@dataclass(frozen=True, eq=False)
class _Receivers:
    """N pixels that receive: where they are, their lobes, and how many of them a unit of length holds."""

    position: FloatArray
    lobes: Lobes
    per_footprint: FloatArray | float

    @classmethod
    def of(cls, gbuffer: GBuffer, camera: Camera, pixel: IntArray, is_elongated: bool) -> _Receivers:
        position, normal = surface_points(gbuffer, camera, pixel)
        roughness = gbuffer.roughness.reshape(-1).take(pixel)
        lobes = Lobes.at(normal, toward_camera(camera, position), roughness, is_elongated)
        scale = 1.0 if camera.is_orthographic else -position[2]
        return cls(position, lobes, max(camera.fx, camera.fy) / scale)


def _borrow(grid: RayGrid, band: _Receivers, there: IntArray, per_pixel: FloatArray, sums: LobeSums) -> None:
    """Add the rays of one cell per receiver, which stand at the given places (N,), to the receivers' sums."""
    apart = grid.position.reshape(3, -1).take(there, axis=1)
    apart -= band.position
    normal, axis = band.lobes.normal, grid.normal.reshape(3, -1).take(there, axis=1)
    similarity = np.maximum(normal[0] * axis[0] + normal[1] * axis[1] + normal[2] * axis[2], 0.0)
    for _ in range(_NORMAL_SQUARINGS):
        np.multiply(similarity, similarity, out=similarity)
    off_plane = np.abs(apart[0] * normal[0] + apart[1] * normal[1] + apart[2] * normal[2])
    off_plane *= band.per_footprint
    off_plane *= per_pixel
    similarity *= np.maximum(1.0 - off_plane, 0.0)
    for ray in range(grid.radiance.shape[0]):
        nearness = grid.inverse_distance[ray].reshape(-1).take(there)
        # From this pixel to where the ray ended, or along it where it never ended
        toward = apart * nearness
        toward += grid.direction[ray].reshape(3, -1).take(there, axis=1)
        toward *= 1.0 / np.sqrt(np.maximum((toward * toward).sum(axis=0), 1e-20))
        weight = band.lobes.value(toward) * grid.inverse_pdf[ray].reshape(-1).take(there)
        weight = np.minimum(weight, _MOST_WEIGHT) * similarity
        radiance = grid.radiance[ray].reshape(3, -1).take(there, axis=1)
        sums.radiance += weight * radiance
        sums.weight += weight
        sums.known += weight * grid.known[ray].reshape(-1).take(there)
        sums.hidden += weight * grid.is_hidden[ray].reshape(-1).take(there)
        sums.nearness += weight * nearness
        brightness = luminance(radiance.T)
        np.multiply(weight, weight, out=weight)
        sums.squared += weight
        np.multiply(weight, brightness, out=weight)
        sums.first += weight
        sums.second += weight * brightness
