# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as flat planes with a margin of nothing: a neighbour is the same array some places on."""

from __future__ import annotations

import numpy as np

from .types import BoolArray, FloatArray, IntArray

Box = tuple[slice, slice]


class PlaneLayout:
    """Where the pixels of a part of an image stand in a flat plane.

    Parameters
    ----------
    width
        Of the whole image, pixels.
    box
        Its rows and columns that the plane holds.
    margin
        Pixels of nothing on all sides.

    Attributes
    ----------
    shape
        Rows and columns of the part.
    stride
        From a pixel to the one below it.
    size
        Places in a plane.
    """

    def __init__(self, width: int, box: Box, margin: int) -> None:
        self.width, self.box, self.margin = width, box, margin
        self.shape = height, _ = box[0].stop - box[0].start, box[1].stop - box[1].start
        self.stride = self.shape[1] + 2 * margin
        # A neighbour's neighbour in the margin stays within the plane
        self.size = (height + 2 * margin) * self.stride + 2 * margin

    def bands(self, most_places: int) -> list[slice]:
        """Return runs of about so many places that hold whole rows, all rows together."""
        height, per_band = self.shape[0], max(1, most_places // self.stride)
        first = self.margin + self.margin * self.stride
        return [
            slice(first + top * self.stride, first + min(top + per_band, height) * self.stride)
            for top in range(0, height, per_band)
        ]

    def places(self, pixel: IntArray) -> IntArray:
        """Return where flat pixel indices of the whole image stand in a plane."""
        row, column = np.divmod(pixel, self.width)
        row += self.margin - self.box[0].start
        row *= self.stride
        row += column
        row += self.margin - self.box[1].start
        return row

    def image(self, plane: FloatArray) -> FloatArray:
        """Return the image (..., rows, columns) that lies in planes (..., size), a view."""
        height, width = self.shape
        tall = height + 2 * self.margin
        rows = plane[..., self.margin : self.margin + tall * self.stride]
        inside = (slice(self.margin, self.margin + height), slice(0, width))
        return rows.reshape(*plane.shape[:-1], tall, self.stride)[..., *inside]


def box_around(is_inside: BoolArray, reach: int = 0) -> Box:
    """Return the rows and columns of an image (H, W) that hold what is inside, and `reach` pixels around."""
    rows, columns = (_run_of(is_inside.any(axis=axis), reach) for axis in (1, 0))
    return rows, columns


def _run_of(is_inside: BoolArray, reach: int) -> slice:
    there = np.flatnonzero(is_inside)
    if not there.size:
        return slice(0, 0)
    return slice(max(0, int(there[0]) - reach), min(is_inside.size, int(there[-1]) + 1 + reach))
