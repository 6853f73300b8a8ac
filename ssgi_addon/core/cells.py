# SPDX-License-Identifier: GPL-3.0-or-later
"""Images of one pixel from every cell of some by some pixels: what is traced at lower resolution."""

from __future__ import annotations

import numpy as np

from .types import BoolArray, IntArray

# Pixels per cell and axis, by the name of the resolution.
STRIDES = {"full": 1, "half": 2, "quarter": 4}


def grid_shape(shape: tuple[int, ...], stride: int) -> tuple[int, int]:
    """Return rows and columns of the cells that cover an image."""
    return -(-shape[0] // stride), -(-shape[1] // stride)


def chosen_pixels(is_active: BoolArray, stride: int, first: int, last: int) -> tuple[IntArray, IntArray]:
    """Return the cells of some rows that have active pixels, and one such pixel of each.

    Parameters
    ----------
    is_active : (H, W)
        The pixels that can be chosen.
    stride
        Pixels per cell and axis, a power of two.
    first, last
        First row of cells, and the one after the last.

    Returns
    -------
    cells, pixel : (N,)
        Flat indices of cells in the whole image's grid, rising, and of pixels in the image.
    """
    height, width = is_active.shape
    columns = grid_shape(is_active.shape, stride)[1]
    if stride == 1:
        active = np.flatnonzero(is_active[first:last]) + first * columns
        return active, active
    chosen = np.full((last - first) * columns, -1, dtype=np.int64)
    left = np.arange(chosen.size)
    for step in range(stride * stride):
        cell_y, cell_x = np.divmod(left + first * columns, columns)
        # A diagonal walk over the cell's pixels, so that neighbouring cells choose different ones
        number = (cell_x + 2 * cell_y + step) & (stride * stride - 1)
        y, x = cell_y * stride + number // stride, cell_x * stride + number % stride
        inside = (y < height) & (x < width)
        pixel = np.where(inside, y * width + x, 0)
        is_free = inside & is_active.reshape(-1).take(pixel)
        chosen[left[is_free]] = pixel[is_free]
        left = left[~is_free]
    taken = np.flatnonzero(chosen >= 0)
    return taken + first * columns, chosen.take(taken)
