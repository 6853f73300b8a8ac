# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample points and directions: a function of pixel, sample and seed alone.

Results therefore do not depend on chunks or threads.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .types import FloatArray, IntArray

# Steps of the R2 sequence (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences"):
# powers of the inverse of the plastic number, as 32-bit fractions.
_R2_STEP_U = 3242174889
_R2_STEP_V = 2447445413


# Pixels of a square tile of this side (a power of two) share one sequence.
_TILE = 16


def sample_square(
    pixel: IntArray,
    width: int,
    rays: int,
    seed: int,
    dtype: np.dtype[Any],
    chosen: slice = slice(None),
) -> tuple[FloatArray, FloatArray]:
    """Return sample points (u, v) of [0, 1)², each ``(rays, N)``.

    The pixels of a tile take consecutive runs of one R2 sequence, in Morton order (interleaved sampling,
    Keller and Heidrich 2001): every block of 2 x 2, 4 x 4, ... pixels together samples as evenly as one pixel
    with that many times the rays, which is what a filter over neighbours needs. The seed shifts the whole
    sequence at random, so each estimate is unbiased over seeds.

    Parameters
    ----------
    pixel : (N,)
        Flat pixel indices.
    width
        Of the image, pixels.
    rays
        Points per pixel.
    seed
        Of the shift.
    dtype
        Of the result.
    chosen
        Which of the points to return; a pixel's points are the same however many are.
    """
    order = morton(pixel % width % _TILE, pixel // width % _TILE).astype(np.uint64)
    index = order * np.uint64(rays) + np.arange(rays, dtype=np.uint64)[chosen, None]
    shift_u, shift_v = (mix(2 * seed + axis) for axis in range(2))
    u = (index * np.uint64(_R2_STEP_U) + np.uint64(shift_u)) & np.uint64(0xFFFFFFFF)
    v = (index * np.uint64(_R2_STEP_V) + np.uint64(shift_v)) & np.uint64(0xFFFFFFFF)
    # 24 bits fit a float32 exactly, so neither point ever rounds up to 1.
    u24, v24 = (u >> np.uint64(8)).astype(dtype), (v >> np.uint64(8)).astype(dtype)
    return u24 * dtype.type(2.0**-24), v24 * dtype.type(2.0**-24)


def morton(x: IntArray, y: IntArray) -> IntArray:
    """Interleave the bits of coordinates within a tile."""
    order = np.zeros_like(x)
    for bit in range(_TILE.bit_length() - 1):
        order |= ((x >> bit) & 1) << (2 * bit) | ((y >> bit) & 1) << (2 * bit + 1)
    return order


def mix(value: int) -> int:
    """Return a well-mixed 32-bit number (Wellons' lowbias32)."""
    value = (value + 0x9E3779B9) & 0xFFFFFFFF
    value = ((value ^ value >> 16) * 0x7FEB352D) & 0xFFFFFFFF
    value = ((value ^ value >> 15) * 0x846CA68B) & 0xFFFFFFFF
    return value ^ value >> 16


def tangent_frame(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors ``(3, N)`` that make a right-handed basis with each unit normal ``(3, N)``.

    Duff et al. 2017, "Building an Orthonormal Basis, Revisited", listing 3.
    """
    x, y, z = normal
    sign = np.copysign(np.ones_like(z), z)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    bitangent = np.stack([b, sign + y * y * a, -y])
    return tangent, bitangent


def cosine_directions(u: FloatArray, v: FloatArray, normal: FloatArray) -> FloatArray:
    """Return directions ``(3, rays, N)`` with density cos(theta) / pi about normals ``(3, N)``."""
    tangent, bitangent = tangent_frame(normal)
    radius, angle = np.sqrt(u), 2.0 * np.pi * v
    x, y, z = radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - u)
    return to_frame(x, y, z, tangent, bitangent, normal)


def to_frame(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    tangent: FloatArray,
    bitangent: FloatArray,
    normal: FloatArray,
) -> FloatArray:
    """Return local vectors (x, y, z), each ``(rays, N)``, in the space of the basis, ``(3, rays, N)``."""
    return np.stack([x * tangent[i] + y * bitangent[i] + z * normal[i] for i in range(3)])
