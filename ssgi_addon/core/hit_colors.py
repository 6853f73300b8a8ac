# SPDX-License-Identifier: GPL-3.0-or-later
"""The radiance that a ray finds where it hits: between pixels, and as wide as the ray's cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .depth_field import DepthField
from .scene import Answers, TraceScene
from .types import BoolArray, FloatArray, IntArray

# Cones wider than 2 to this many pixels read a cell of that size.
_MOST_LEVEL = 5


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
            if not mine.size:
                continue
            pixel = texel.take(mine) - layer.offset
            x, y = answers.x_px[rays].take(mine), answers.y_px[rays].take(mine)
            level = np.zeros(mine.size, dtype=np.int64)
            if self.has_levels and spread is not None:
                level = layer.level_of(pixel, distance.take(mine) * spread.take(mine))
            found = layer.between(pixel, x, y, level)
            chosen = np.flatnonzero((level > 0) | self.is_subpixel)
            radiance[mine.take(chosen)] = found.take(chosen, axis=0)
        return radiance


@dataclass(frozen=True, eq=False)
class _Layer:
    """A layer's radiance, level after level; each row is RGB times the share of surface, and that share."""

    field: DepthField
    offset: int
    end: int
    rgba: FloatArray
    base: IntArray
    width: IntArray
    height: IntArray

    @classmethod
    def of(cls, source: FloatArray, field: DepthField, offset: int, most_level: int) -> _Layer:
        height, width = field.camera.height, field.camera.width
        end = offset + height * width
        is_surface = ~field.is_background.reshape(height, width, 1)
        rgba = np.empty((height, width, 4), dtype=source.dtype)
        rgba[..., :3] = source[offset:end].reshape(height, width, 3) * is_surface
        rgba[..., 3:] = is_surface
        levels = [rgba]
        while len(levels) <= most_level and max(levels[-1].shape[:2]) > 1:
            levels.append(_halved(levels[-1]))
        sizes = np.array([level.shape[:2] for level in levels], dtype=np.int64)
        base = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))[:-1]])
        rows = np.concatenate([level.reshape(-1, 4) for level in levels])
        return cls(field, offset, end, rows, base, sizes[:, 1].copy(), sizes[:, 0].copy())

    def level_of(self, pixel: IntArray, diameter: FloatArray) -> IntArray:
        """Return the level whose cells are as wide as cones of a diameter, scene units, at some pixels."""
        camera = self.field.camera
        wide = diameter * max(camera.fx, camera.fy)
        if not camera.is_orthographic:
            wide *= self.field.front.take(pixel)
        level: IntArray = np.rint(np.log2(np.maximum(wide, 1.0))).astype(np.int64)
        np.minimum(level, self.base.shape[0] - 1, out=level)
        return level

    def between(self, pixel: IntArray, x_px: FloatArray, y_px: FloatArray, level: IntArray) -> FloatArray:
        """Return the bilinear mean of the four cells around a point, of those that belong to its surface."""
        scale = (1.0 / (1 << level)).astype(x_px.dtype)
        x, y = x_px * scale - 0.5, y_px * scale - 0.5
        column, row = np.floor(x), np.floor(y)
        right, down = x - column, y - row
        column, row = column.astype(np.int64), row.astype(np.int64)
        base, width, height = self.base.take(level), self.width.take(level), self.height.take(level)
        own = (self.rgba.take(pixel, axis=0) * x_px.dtype.type(1e-6)).T
        total = own.copy()
        is_fine = np.flatnonzero(level == 0)
        for step_y, weight_y in ((0, 1.0 - down), (1, down)):
            for step_x, weight_x in ((0, 1.0 - right), (1, right)):
                at_x = np.minimum(np.maximum(column + step_x, 0), width - 1)
                at_y = np.minimum(np.maximum(row + step_y, 0), height - 1)
                cell = base + at_y * width + at_x
                weight = weight_x * weight_y
                is_same = self._is_same_surface(pixel.take(is_fine), cell.take(is_fine))
                weight[is_fine] *= is_same
                total += weight * self.rgba.take(cell, axis=0).T
        mean: FloatArray = (total[:3] / np.maximum(total[3], 1e-12)).T
        return mean

    def _is_same_surface(self, pixel: IntArray, other: IntArray) -> BoolArray:
        """Return where another pixel lies on the plane of a pixel beside it, or a small step off."""
        width = self.field.camera.width
        front, gx, gy, _ = self.field.planes.take(pixel, axis=0).T
        right, down = other % width - pixel % width, other // width - pixel // width
        step = self.field.front.take(other) - front - gx * right - gy * down
        is_same: BoolArray = np.abs(step) <= 2.0 * self.field.reach.take(pixel)
        return is_same


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
