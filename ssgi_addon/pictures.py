# SPDX-License-Identifier: GPL-3.0-or-later
"""Display-referred pictures as arrays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

#: (H, W, 3) uint8, top row first
RGB = npt.NDArray[np.uint8]


def shrunk(picture: RGB, factor: int) -> RGB:
    """Return a picture smaller by a whole factor, by means of squares.

    Rows and columns that fill no whole square are left out, unless there is no other.
    """
    height, width = picture.shape[:2]
    down, right = min(factor, height), min(factor, width)
    part = picture[: height - height % down, : width - width % right]
    total = np.full((part.shape[0] // down, part.shape[1] // right, 3), down * right // 2, dtype=np.uint32)
    for row in range(down):
        for column in range(right):
            total += part[row::down, column::right]
    return (total // (down * right)).astype(np.uint8)
