# SPDX-License-Identifier: GPL-3.0-or-later
"""Pinhole and orthographic cameras: view space to pixels and back.

View space is right-handed, the camera looks down -Z, +Y is up; pixel (0, 0) is the top left one.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .gbuffer import LARGEST, as_array
from .types import FloatArray

# What single precision can project. Pixels: the longest side of an image, and how far the optical axis may
# lie off its middle (a sixteenth of a pixel is told apart there).
LARGEST_SIDE = 65536
_FARTHEST_AXIS = 1e6
# Focal lengths in image widths: 179.9 degrees to a millionth of a radian.
_FOCAL_LENGTHS = (5e-4, 1e6)
# Of parallel views, scene units.
_WIDTHS = (1e-12, 1e12)
_LEAST_ASPECT = 1e-3
# All that these make of `fx` and `fy`.
_SCALES = {False: (1e-7, 1e14), True: (1e-15, 1e20)}


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics in pixels and the pose.

    Construction validates what single precision can project: sides of up to 65536 pixels, and an optical axis
    within a million pixels of the image's middle.

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

    Raises
    ------
    ValueError
        If a number is out of that range, or the pose is no invertible transform.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    is_orthographic: bool
    world_from_view: FloatArray

    def __post_init__(self) -> None:
        lowest, highest = _SCALES[bool(self.is_orthographic)]
        unit = "pixels per scene unit" if self.is_orthographic else "pixels"
        for side, scale, axis in (("width", "fx", "cx"), ("height", "fy", "cy")):
            _check_side(side, getattr(self, side))
            value = getattr(self, scale)
            if not (_is_number(value) and lowest <= value <= highest):
                raise ValueError(f"{scale}: expected {lowest:g} to {highest:g} {unit}, got {value!r}")
            value = getattr(self, axis)
            if not (_is_number(value) and abs(value - 0.5 * getattr(self, side)) <= _FARTHEST_AXIS):
                raise ValueError(
                    f"{axis}: expected pixels within {_FARTHEST_AXIS:g} of the middle, got {value!r}"
                )
        object.__setattr__(self, "world_from_view", as_pose(self.world_from_view, ((4, 4),)))

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
            If a size is not a positive integer, or the field of view, the shift or the aspect is out of
            range.
        """
        _check_side("width", width)
        widest, narrowest = (2.0 * math.atan(0.5 / focal) for focal in _FOCAL_LENGTHS)
        if not (_is_number(fov_x) and narrowest <= fov_x <= widest):
            raise ValueError(
                f"fov_x: expected radians between 0 and pi, from {narrowest:.0e} to {widest:.4f}, "
                f"got {fov_x!r}"
            )
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
        _check_side("width", width)
        if not (_is_number(width_units) and _WIDTHS[0] <= width_units <= _WIDTHS[1]):
            raise ValueError(
                f"width_units: expected a positive number of scene units from {_WIDTHS[0]:g} to "
                f"{_WIDTHS[1]:g}, got {width_units!r}"
            )
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
        _check_side("height", height)
        if not (_is_number(pixel_aspect) and _LEAST_ASPECT <= pixel_aspect <= 1.0 / _LEAST_ASPECT):
            raise ValueError(
                f"pixel_aspect: expected a positive number from {_LEAST_ASPECT:g} to "
                f"{1.0 / _LEAST_ASPECT:g}, got {pixel_aspect!r}"
            )
        if as_array("shift_px", shift_px).shape != (2,) or not all(_is_number(value) for value in shift_px):
            raise ValueError(f"shift_px: expected two finite numbers, got {shift_px!r}")
        if any(abs(shift) > _FARTHEST_AXIS for shift in shift_px):
            raise ValueError(f"shift_px: expected at most {_FARTHEST_AXIS:g} pixels, got {shift_px!r}")
        return cls(
            int(width),
            int(height),
            float(fx),
            float(fx) * float(pixel_aspect),
            0.5 * width + float(shift_px[0]),
            0.5 * height + float(shift_px[1]),
            is_orthographic,
            np.eye(4) if world_from_view is None else world_from_view,
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
    array = as_array("world_from_view", matrix)
    expected = " or ".join(str(shape) for shape in shapes)
    if array.dtype.kind not in "fiu" or array.shape not in shapes:
        raise ValueError(
            f"world_from_view: expected a {expected} matrix of numbers, got {array.dtype} {array.shape}"
        )
    pose = array.astype(np.float64)
    if not _is_invertible(pose):
        raise ValueError(f"world_from_view: expected a finite invertible matrix, got {matrix!r}")
    if pose.shape == (4, 4) and not np.allclose(pose[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-6):
        raise ValueError(
            f"world_from_view: expected 0, 0, 0, 1 in the last row, for column vectors, got {pose[3]}"
        )
    return pose


def _is_invertible(matrix: FloatArray) -> bool:
    """Return whether single precision can take vectors through a matrix and back."""
    if not (np.abs(matrix) <= LARGEST).all():  # False for NaN
        return False
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return False
    return bool((np.abs(inverse) <= LARGEST).all())


def move_between(home: Camera, other: Camera) -> FloatArray:
    """Return the (4, 4) transform from one camera's space to another's."""
    return np.linalg.inv(other.world_from_view) @ home.world_from_view


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return False
    # An integer may be longer than a float
    return abs(value) <= sys.float_info.max if isinstance(value, int) else math.isfinite(value)


def _check_side(name: str, value: Any) -> None:
    is_integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_integer or not 1 <= value <= LARGEST_SIDE:
        raise ValueError(
            f"{name}: expected a positive integer number of pixels up to {LARGEST_SIDE}, got {value!r}"
        )
