# SPDX-License-Identifier: GPL-3.0-or-later
"""Display-referred pictures as arrays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

#: (H, W, 3) uint8, top row first
Picture = npt.NDArray[np.uint8]


def shrunk(picture: Picture, factor: int) -> Picture:
    """Return a picture smaller by a whole factor, by means of squares.

    Rows and columns that fill no whole square are left out, unless there is no other.
    """
    height, width = picture.shape[:2]
    rows, columns = max(height // factor, 1), max(width // factor, 1)
    part = picture[: rows * factor, : columns * factor]
    squares = part.reshape(rows, part.shape[0] // rows, columns, part.shape[1] // columns, 3)
    smaller: Picture = np.rint(squares.mean(axis=(1, 3))).astype(np.uint8)
    return smaller
