# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals of renders whose pixels are means over several surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]

# Means of unit normals that are shorter mix surfaces that stand at more than some 25 degrees to another.
_SHORTEST = 0.95


def steady_normals(normal: FloatArray, depth: FloatArray) -> FloatArray:
    """Replace normals that are a mean over several surfaces by that of a neighbour.

    Cycles' Depth is that of one sample, its Normal the mean of all. Where an edge crosses a pixel, the mean
    is short and belongs to no surface; the neighbour nearest in depth shows the surface that Depth is of.

    Parameters
    ----------
    normal : (H, W, 3)
        Means of unit normals, in any space; zero on background.
    depth : (H, W)
        Of one sample each.

    Returns
    -------
    (H, W, 3) float32
        Unit length, but where `normal` is zero.
    """
    length = np.linalg.norm(normal, axis=-1)
    is_surface = length > 0.0
    unit = np.divide(normal, length[..., None], out=np.zeros_like(normal), where=is_surface[..., None])
    row, column = np.nonzero(is_surface & (length < _SHORTEST))
    nearest = np.full(row.shape, np.inf, dtype=np.float32)
    found = unit[row, column]
    height, width = depth.shape
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)):
        there = np.clip(row + down, 0, height - 1), np.clip(column + right, 0, width - 1)
        distance = np.abs(depth[there] - depth[row, column])
        is_better = (length[there] >= _SHORTEST) & (distance < nearest)
        nearest[is_better] = distance[is_better]
        found[is_better] = unit[there][is_better]
    unit[row, column] = found
    return unit
