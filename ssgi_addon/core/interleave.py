# SPDX-License-Identifier: GPL-3.0-or-later
"""Images cut into the pixels of equal place in a tile (interleaved sampling, Keller and Heidrich 2001).

Pixels of one phase share a sampling pattern, so what they read is another phase of the image, shifted: copies
of rows instead of a gather (Segovia et al. 2006, "Non-interleaved Deferred Shading of Interleaved Sample
Patterns").
"""

from __future__ import annotations

import numpy as np

from .types import FloatArray

# Pixels of a tile of this side (a power of two) have different patterns.
SIDE = 4


def phase_shape(shape: tuple[int, ...], y: int, x: int) -> tuple[int, int]:
    """Return rows and columns of the phase (y, x) of an image ``(H, W)``."""
    return -(-(shape[0] - y) // SIDE), -(-(shape[1] - x) // SIDE)


def split_phases(image: FloatArray) -> FloatArray:
    """Return the phases ``(SIDE, SIDE, C, rows, columns)`` of an image ``(H, W, C)``.

    All are as large as the phase (0, 0); where another one has ended, they hold zeros.
    """
    rows, columns = phase_shape(image.shape, 0, 0)
    phases = np.zeros((SIDE, SIDE, image.shape[2], rows, columns), dtype=image.dtype)
    for y in range(SIDE):
        for x in range(SIDE):
            part = image[y::SIDE, x::SIDE].transpose(2, 0, 1)
            phases[y, x, :, : part.shape[1], : part.shape[2]] = part
    return phases


def merge_phases(phases: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the image ``(H, W, C)`` of phases ``(SIDE, SIDE, C, rows, columns)``."""
    image = np.empty((*shape[:2], phases.shape[2]), dtype=phases.dtype)
    for y in range(SIDE):
        for x in range(SIDE):
            part = image[y::SIDE, x::SIDE]
            part[:] = phases[y, x, :, : part.shape[0], : part.shape[1]].transpose(1, 2, 0)
    return image
