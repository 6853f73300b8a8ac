# SPDX-License-Identifier: GPL-3.0-or-later
"""The radiance that a ray finds where it hits: between pixels, and as wide as the ray's cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .answers import Answers
from .depth_field import DepthField
from .scene import TraceScene
from .types import BoolArray, FloatArray, IntArray

# Cones wider than 2 to this many pixels read a cell of that size.
_MOST_LEVEL = 5
# Standard deviation of depth, relative, above which a cell of the pyramid is more than one surface.
_SURFACE_STEP = 0.05
# Cosine between normals of neighbouring pixels of one surface.
_ALIGNED = 0.9
# Squared length of the mean of a flat cell's normals.
_FLATNESS = 0.95


class HitColors:
    """Radiance tables of all views' layers, each with its pyramid of means.

    A ray stands for a cone; the mean over the cone's footprint is what it would find on average (Křivánek and
    Colbert 2008, "Real-time Shading with Filtered Importance Sampling").

    Parameters
    ----------
    scene
        The views.
    source : (texels + 1, 3)
        Radiance that each texel hands on, black in the last row.
    is_subpixel
        Read between pixels, not at the centre of the one that was hit.
    has_levels
        Build the pyramids; without them every cone is a line.
    """

    def __init__(self, scene: TraceScene, source: FloatArray, *, is_subpixel: bool, has_levels: bool) -> None:
        self.source, self.is_subpixel, self.has_levels = source, is_subpixel, has_levels
        self.layers = [
            _Layer.of(source, field, offset, _MOST_LEVEL if has_levels else 0)
            for view in scene.views
            for field, offset in zip(view.fields, view.offsets, strict=True)
        ]

    def radiance(self, answers: Answers, rays: slice, spread: FloatArray | None) -> FloatArray:
        """Return the radiance (N, 3) that a run of rays finds; black where they hit nothing.

        Parameters
        ----------
        answers
            Of many rays.
        rays
            The run.
        spread : (N,) or None
            Diameter of each ray's cone in units of its distance; None for lines.
        """
        texel, distance = answers.texel[rays], answers.distance[rays]
        radiance = self.source.take(texel, axis=0)
        if not (self.is_subpixel or (self.has_levels and spread is not None)):
            return radiance
        for layer in self.layers:
            mine = np.flatnonzero((texel >= layer.offset) & (texel < layer.end))
            pixel = texel.take(mine) - layer.offset
            x, y = answers.x_px[rays].take(mine), answers.y_px[rays].take(mine)
            if self.is_subpixel:
                radiance[mine] = layer.between(pixel, x, y)
            if self.has_levels and spread is not None:
                diameter = distance.take(mine) * spread.take(mine)
                level = layer.level_of(pixel, diameter)
                wide = np.flatnonzero(level > 0)
                radiance[mine.take(wide)] = layer.mean_around(
                    pixel.take(wide), x.take(wide), y.take(wide), level.take(wide)
                )
        return radiance


@dataclass(frozen=True, eq=False)
class _Layer:
    """A layer's radiance and its pyramid.

    Attributes
    ----------
    field, offset, end
        Its surfaces, and where its pixels stand among all texels.
    pixels : (H*W, 3)
        Radiance per pixel.
    means : (cells, 8)
        Mean radiance per cell of level 1, of level 2, ... one after another, 1 for cells of one flat surface,
        and the means of q and of the normals.
    base, width
        Where each of these levels begins, and how many cells wide it is.
    """

    field: DepthField
    offset: int
    end: int
    pixels: FloatArray
    means: FloatArray
    base: IntArray
    width: IntArray

    @classmethod
    def of(cls, source: FloatArray, field: DepthField, offset: int, most_level: int) -> _Layer:
        height, width = field.camera.height, field.camera.width
        end = offset + height * width
        pixels = source[offset:end]
        levels = []
        is_surface = ~field.is_background.reshape(height, width, 1)
        # Sums over surfaces: radiance, normal, q, q² and their number
        q = np.where(is_surface, field.front.reshape(height, width, 1), 0.0)
        planes = (pixels.reshape(height, width, 3), field.normal.reshape(height, width, 3), q, q * q)
        sums = np.concatenate([*(plane * is_surface for plane in planes), is_surface], axis=-1, dtype=q.dtype)
        for _ in range(most_level):
            sums = _halved(sums)
            levels.append(_means(sums, field))
        sizes = np.array([level.shape[:2] for level in levels], dtype=np.int64).reshape(-1, 2)
        base = np.cumsum(np.concatenate([[0], sizes.prod(axis=1)]))[: len(levels)]
        means = np.concatenate([level.reshape(-1, 8) for level in levels]) if levels else np.zeros((0, 8))
        return cls(field, offset, end, pixels, means.astype(source.dtype), base, sizes[:, 1].copy())

    def level_of(self, pixel: IntArray, diameter: FloatArray) -> IntArray:
        """Return the level whose cells are as wide as a cone where it hits, no wider than one surface.

        Parameters
        ----------
        pixel : (N,)
            What the cones' axes hit.
        diameter : (N,)
            Of the cones there, scene units.
        """
        camera = self.field.camera
        wide = diameter * max(camera.fx, camera.fy)
        if not camera.is_orthographic:
            wide *= self.field.planes.take(pixel, axis=0)[:, 0]
        wanted: IntArray = np.rint(np.log2(np.maximum(wide, 1.0))).astype(np.int64)
        np.minimum(wanted, self.base.shape[0], out=wanted)
        level = np.zeros_like(wanted)
        for coarse in range(self.base.shape[0], 0, -1):
            there = np.flatnonzero((wanted >= coarse) & (level == 0))
            is_one = self.means[:, 3].take(self._number_of(pixel.take(there), coarse)) > 0.0
            level[there[is_one]] = coarse
        return level

    def mean_around(self, pixel: IntArray, x_px: FloatArray, y_px: FloatArray, level: IntArray) -> FloatArray:
        """Return the bilinear mean (N, 3) of the four cells around points, of those on the same surface.

        Parameters
        ----------
        pixel, x_px, y_px : (N,)
            What was hit, and where.
        level : (N,)
            Of the cells, at least 1.
        """
        width = self.field.camera.width
        size = (1 << level).astype(x_px.dtype)
        x, y = x_px / size - 0.5, y_px / size - 0.5
        left, top = np.floor(x), np.floor(y)
        own = self._number_of(pixel, level)
        front, gx, gy, _ = self.field.planes.take(pixel, axis=0).T
        normal = self.field.normal.take(pixel, axis=0)
        units = self.field.camera.width / self.field.camera.fx if self.field.camera.is_orthographic else front
        total = np.zeros((3, *pixel.shape), dtype=self.pixels.dtype)
        weights = np.zeros_like(x)
        for step_y, weight_y in ((0, 1.0 - y + top), (1, y - top)):
            for step_x, weight_x in ((0, 1.0 - x + left), (1, x - left)):
                middle_x, middle_y = (left + (step_x + 0.5)) * size, (top + (step_y + 0.5)) * size
                cell = self._number(*self._cell(middle_x, middle_y, level), level)
                mean = self.means.take(cell, axis=0)
                # Where the plane that was hit would lie in the middle of the cell
                q = front + gx * (middle_x - pixel % width - 0.5) + gy * (middle_y - pixel // width - 0.5)
                is_same = np.abs(q - mean[:, 4]) <= _SURFACE_STEP * units
                is_same &= (normal * mean[:, 5:]).sum(axis=-1) >= _ALIGNED
                weight = weight_x * weight_y
                weight *= (cell == own) | ((mean[:, 3] > 0.0) & is_same)
                weights += weight
                total += weight * mean[:, :3].T
        around: FloatArray = (total / np.maximum(weights, 1e-12)).T
        return around

    def _cell(self, x_px: FloatArray, y_px: FloatArray, level: IntArray | int) -> tuple[IntArray, IntArray]:
        """Return column and row of the cells that hold points, which are moved into the image."""
        camera = self.field.camera
        column = np.clip(x_px.astype(np.int64), 0, camera.width - 1) >> level
        row = np.clip(y_px.astype(np.int64), 0, camera.height - 1) >> level
        return column, row

    def _number_of(self, pixel: IntArray, level: IntArray | int) -> IntArray:
        """Return where the cells of pixels stand in `means`.

        By the pixel, not by the place: rays that come into a slab at its side meet it on a border exactly.
        """
        width = self.field.camera.width
        return self._number(pixel % width >> level, pixel // width >> level, level)

    def _number(self, column: IntArray, row: IntArray, level: IntArray | int) -> IntArray:
        """Return where cells stand in `means`."""
        below = np.asarray(level) - 1
        number: IntArray = self.base.take(below) + row * self.width.take(below) + column
        return number

    def between(self, pixel: IntArray, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
        """Return the bilinear mean (N, 3) of the four pixels around points, of those on the same surface."""
        camera = self.field.camera
        left, top = np.floor(x_px - 0.5), np.floor(y_px - 0.5)
        right, down = x_px - 0.5 - left, y_px - 0.5 - top
        total = np.zeros((3, *pixel.shape), dtype=self.pixels.dtype)
        weights = np.zeros_like(right)
        for step_y, weight_y in ((0, 1.0 - down), (1, down)):
            for step_x, weight_x in ((0, 1.0 - right), (1, right)):
                x = np.clip(left.astype(np.int64) + step_x, 0, camera.width - 1)
                y = np.clip(top.astype(np.int64) + step_y, 0, camera.height - 1)
                other = y * camera.width + x
                weight = weight_x * weight_y
                weight *= (other == pixel) | self._is_same_surface(pixel, other)
                weights += weight
                total += weight * self.pixels.take(other, axis=0).T
        mean: FloatArray = (total / np.maximum(weights, 1e-12)).T
        return mean

    def _is_same_surface(self, pixel: IntArray, other: IntArray) -> BoolArray:
        """Return where another pixel lies on the plane of a pixel beside it, or a small step off.

        A wall that meets the floor between the two is lit otherwise.
        """
        width = self.field.camera.width
        front, gx, gy, _ = self.field.planes.take(pixel, axis=0).T
        right, down = other % width - pixel % width, other // width - pixel // width
        step = self.field.planes.take(other, axis=0)[:, 0] - front - gx * right - gy * down
        normals = self.field.normal
        aligned = (normals.take(pixel, axis=0) * normals.take(other, axis=0)).sum(axis=-1)
        is_same: BoolArray = (np.abs(step) <= 2.0 * self.field.reach.take(pixel)) & (aligned >= _ALIGNED)
        return is_same


def _means(sums: FloatArray, field: DepthField) -> FloatArray:
    """Return per cell what `_Layer.means` holds.

    What lies before, behind or around the corner is lit otherwise, and is not what the ray's neighbours see.
    """
    count = np.maximum(sums[..., 8:], 1e-20)
    mean = sums / count
    q, spread = mean[..., 6], mean[..., 7] - mean[..., 6] ** 2
    units = field.camera.width / field.camera.fx if field.camera.is_orthographic else np.abs(q)
    is_flat = (mean[..., 3:6] ** 2).sum(axis=-1) >= _FLATNESS
    is_one = is_flat & (spread <= (_SURFACE_STEP * units) ** 2) & (sums[..., 8] > 0.0)
    return np.concatenate([mean[..., :3], is_one[..., None], mean[..., 6:7], mean[..., 3:6]], axis=-1)


def _halved(image: FloatArray) -> FloatArray:
    """Return the means of 2 x 2 cells; what sticks out of an odd size counts as nothing."""
    height, width = image.shape[:2]
    rows, columns = -(-height // 2), -(-width // 2)
    total = np.zeros((rows, columns, image.shape[2]), dtype=image.dtype)
    for y in (0, 1):
        for x in (0, 1):
            part = image[y::2, x::2]
            total[: part.shape[0], : part.shape[1]] += part
    total *= 0.25
    return total
