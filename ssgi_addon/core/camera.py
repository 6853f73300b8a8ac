# SPDX-License-Identifier: GPL-3.0-or-later
"""Pinhole and orthographic cameras: view space to pixels and back.

View space is right-handed, the camera looks down -Z, +Y is up; pixel (0, 0) is the top left one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .types import FloatArray


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics in pixels and the pose.

    Attributes
    ----------
    width, height
        Image size, pixels.
    fx, fy
        Perspective: focal lengths in pixels. Orthographic: pixels per scene unit.
    cx, cy
        Where the optical axis meets the image, pixels from the top left corner.
    is_orthographic
        Parallel projection.
    world_from_view
        (4, 4) float64 rigid transform for column vectors.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    is_orthographic: bool
    world_from_view: FloatArray

    @classmethod
    def perspective(
        cls,
        width: int,
        height: int,
        fov_x: float,
        *,
        shift_px: Sequence[float] = (0.0, 0.0),
        pixel_aspect: float = 1.0,
        world_from_view: FloatArray | None = None,
    ) -> Camera:
        """Make a pinhole camera.

        Parameters
        ----------
        width, height
            Image size, pixels.
        fov_x
            Horizontal field of view, radians, between 0 and pi.
        shift_px
            Offset of the optical axis from the image centre, pixels, y down.
        pixel_aspect
            Pixel width divided by pixel height.
        world_from_view
            (4, 4) pose; None means identity.

        Raises
        ------
        ValueError
            If a size is not a positive integer, or the field of view or the aspect is out of range.
        """
        if not (_is_number(fov_x) and 0.0 < fov_x < math.pi):
            raise ValueError(f"fov_x: expected radians between 0 and pi, got {fov_x!r}")
        _check_size(width, height)
        return cls._make(
            width, height, 0.5 * width / math.tan(0.5 * fov_x), shift_px, pixel_aspect, False, world_from_view
        )

    @classmethod
    def orthographic(
        cls,
        width: int,
        height: int,
        width_units: float,
        *,
        shift_px: Sequence[float] = (0.0, 0.0),
        pixel_aspect: float = 1.0,
        world_from_view: FloatArray | None = None,
    ) -> Camera:
        """Make a camera with parallel rays.

        Parameters
        ----------
        width, height
            Image size, pixels.
        width_units
            What it sees across its width, scene units.
        shift_px, pixel_aspect, world_from_view
            As in `perspective`.

        Raises
        ------
        ValueError
            If a size is not a positive integer, or the width in units or the aspect is not positive.
        """
        if not (_is_number(width_units) and width_units > 0.0):
            raise ValueError(f"width_units: expected a positive number of scene units, got {width_units!r}")
        _check_size(width, height)
        return cls._make(width, height, width / width_units, shift_px, pixel_aspect, True, world_from_view)

    @classmethod
    def _make(
        cls,
        width: int,
        height: int,
        fx: float,
        shift_px: Sequence[float],
        pixel_aspect: float,
        is_orthographic: bool,
        world_from_view: FloatArray | None,
    ) -> Camera:
        if not (_is_number(pixel_aspect) and pixel_aspect > 0.0):
            raise ValueError(f"pixel_aspect: expected a positive number, got {pixel_aspect!r}")
        if np.shape(shift_px) != (2,) or not all(_is_number(value) for value in shift_px):
            raise ValueError(f"shift_px: expected two finite numbers, got {shift_px!r}")
        pose = np.eye(4) if world_from_view is None else as_pose(world_from_view, ((4, 4),))
        return cls(
            int(width),
            int(height),
            float(fx),
            float(fx) * float(pixel_aspect),
            0.5 * width + float(shift_px[0]),
            0.5 * height + float(shift_px[1]),
            is_orthographic,
            pose,
        )

    def view_to_pixel(self, points_vs: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Project view-space points.

        Parameters
        ----------
        points_vs : (..., 3)
            View-space points, scene units.

        Returns
        -------
        x_px, y_px, depth : (...)
            Pixel coordinates and distance along the view axis; perspective points at depth <= 0
            lie behind the camera and have no meaningful pixel.
        """
        depth = -points_vs[..., 2]
        scale = 1.0 if self.is_orthographic else 1.0 / depth
        x_px = self.cx + self.fx * points_vs[..., 0] * scale
        y_px = self.cy - self.fy * points_vs[..., 1] * scale
        return x_px, y_px, depth

    def pixel_to_view(self, x_px: FloatArray, y_px: FloatArray, depth: FloatArray) -> FloatArray:
        """Unproject pixel coordinates at a depth; inverse of `view_to_pixel`.

        Parameters
        ----------
        x_px, y_px : (...)
            Pixels from the top left corner.
        depth : (...)
            Distance along the view axis, scene units.

        Returns
        -------
        (..., 3)
            View-space points, scene units.
        """
        scale = 1.0 if self.is_orthographic else depth
        x = (x_px - self.cx) / self.fx * scale
        y = (self.cy - y_px) / self.fy * scale
        return np.stack(np.broadcast_arrays(x, y, -depth), axis=-1)


def as_pose(matrix: object, shapes: Sequence[tuple[int, int]]) -> FloatArray:
    """Return a float64 copy of `world_from_view`, or raise ValueError where it is no invertible matrix."""
    array = np.asarray(matrix)
    expected = " or ".join(str(shape) for shape in shapes)
    if array.dtype.kind not in "fiu" or array.shape not in shapes:
        raise ValueError(
            f"world_from_view: expected a {expected} matrix of numbers, got {array.dtype} {array.shape}"
        )
    pose = array.astype(np.float64)
    if not np.isfinite(pose).all() or np.linalg.det(pose) == 0.0:
        raise ValueError(f"world_from_view: expected a finite invertible matrix, got {matrix!r}")
    return pose


def move_between(home: Camera, other: Camera) -> FloatArray:
    """Return the (4, 4) transform from one camera's space to another's."""
    return np.linalg.inv(other.world_from_view) @ home.world_from_view


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and math.isfinite(value)


def _check_size(width: object, height: object) -> None:
    for name, value in (("width", width), ("height", height)):
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
            raise ValueError(f"{name}: expected a positive integer number of pixels, got {value!r}")
