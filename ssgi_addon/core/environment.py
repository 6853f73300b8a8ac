# SPDX-License-Identifier: GPL-3.0-or-later
"""The light that comes from outside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .camera import as_pose
from .gbuffer import LARGEST, _clean_light, as_array, as_float32
from .types import FloatArray


@dataclass(frozen=True, eq=False)
class Environment:
    """Radiance by direction: constant, or an equirectangular image in Blender's mapping.

    Attributes
    ----------
    image : (H, W, 3) float32
        Radiance, scene-linear; (1, 1, 3) for a constant environment.
    world_from_view : (3, 3) float64
        Rotation from view to world directions.
    """

    image: FloatArray
    world_from_view: FloatArray

    @classmethod
    def constant(cls, rgb: Sequence[float] | FloatArray) -> Environment:
        """The same radiance from every direction.

        Parameters
        ----------
        rgb : (3,)
            Radiance, scene-linear.

        Raises
        ------
        ValueError
            If `rgb` is not three numbers from 0 to 1e15.
        """
        radiance = as_float32("rgb", rgb, (3,))
        if not ((radiance >= 0.0) & (radiance <= LARGEST)).all():
            raise ValueError(f"rgb: expected three finite numbers from 0 to {LARGEST:g}, got {rgb!r}")
        return cls(radiance.reshape(1, 1, 3), np.eye(3))

    @classmethod
    def equirectangular(cls, image: FloatArray, world_from_view: Any) -> Environment:
        """Radiance from an image in Cycles' mapping.

        World direction (x, y, z) reads u = 0.5 - atan2(y, x) / 2 pi, row from the top = acos(z) / pi * H.

        Parameters
        ----------
        image : (H, W, 3)
            Radiance, scene-linear; bad pixels count as black.
        world_from_view : (4, 4) or (3, 3)
            Pose of the camera whose view space the directions will be given in; column vectors.

        Raises
        ------
        ValueError
            If a shape is wrong.
        """
        given = as_array("image", image)
        shape = given.shape
        if len(shape) != 3 or shape[2] != 3 or 0 in shape:
            raise ValueError(f"image: expected shape (H, W, 3), got {shape}")
        pose = as_pose(world_from_view, ((4, 4), (3, 3)))
        return cls(_clean_light(as_float32("image", given, shape)), pose[:3, :3].copy())

    @property
    def is_constant(self) -> bool:
        """True where no direction needs a lookup."""
        return self.image.shape[:2] == (1, 1)

    def radiance(self, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        """Look up radiance, bilinear between pixel centres and wrapping around in longitude.

        Parameters
        ----------
        x, y, z : (N,)
            Components of unit view-space directions.

        Returns
        -------
        (N, 3)
            Radiance, scene-linear.
        """
        if self.is_constant:
            return np.broadcast_to(self.image.reshape(1, 3), (x.shape[0], 3))
        height, width = self.image.shape[:2]
        rows = [[float(value) for value in row] for row in self.world_from_view]
        wx, wy, wz = (row[0] * x + row[1] * y + row[2] * z for row in rows)
        column = (0.5 - np.arctan2(wy, wx) / (2.0 * np.pi)) * width - 0.5
        row_px = np.arccos(np.clip(wz, -1.0, 1.0)) / np.pi * height - 0.5
        left, top = np.floor(column), np.floor(row_px)
        tx, ty = (column - left)[:, None], (row_px - top)[:, None]
        x0 = left.astype(np.int64) % width
        x1 = (x0 + 1) % width
        y0 = np.clip(top.astype(np.int64), 0, height - 1)
        y1 = np.clip(top.astype(np.int64) + 1, 0, height - 1)
        texels = self.image.reshape(-1, 3)
        upper = texels.take(y0 * width + x0, axis=0) * (1.0 - tx) + texels.take(y0 * width + x1, axis=0) * tx
        lower = texels.take(y1 * width + x0, axis=0) * (1.0 - tx) + texels.take(y1 * width + x1, axis=0) * tx
        radiance: FloatArray = upper * (1.0 - ty) + lower * ty
        return radiance
