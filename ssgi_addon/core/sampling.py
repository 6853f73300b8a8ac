# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample points and directions: a function of pixel, sample and seed alone.

Results therefore do not depend on chunks or threads.
"""

from __future__ import annotations

import numpy as np

from .types import FloatArray, IntArray

# Steps of the R2 sequence (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences"):
# powers of the inverse of the plastic number, as 32-bit fractions.
_R2_STEP_U = 3242174889
_R2_STEP_V = 2447445413


def hash_pixels(pixel: IntArray, salt: int) -> np.ndarray:
    """Return well-mixed uint32 values ``(N,)`` for flat pixel indices (Wellons' lowbias32)."""
    value = pixel.astype(np.uint32)
    value ^= np.uint32((salt * 0x9E3779B9 + 0x85EBCA6B) & 0xFFFFFFFF)
    value ^= value >> np.uint32(16)
    value *= np.uint32(0x7FEB352D)
    value ^= value >> np.uint32(15)
    value *= np.uint32(0x846CA68B)
    value ^= value >> np.uint32(16)
    return value


def sample_square(pixel: IntArray, rays: int, seed: int, dtype: np.dtype) -> tuple[FloatArray, FloatArray]:
    """Return points (u, v) of [0, 1)², each ``(rays, N)``: one R2 sequence per pixel, randomly shifted.

    The shift (Cranley-Patterson rotation) makes every pixel's estimate unbiased and the noise of neighbours
    independent.
    """
    index = np.arange(rays, dtype=np.uint64)[:, None]
    steps = [(index * step & 0xFFFFFFFF).astype(np.uint32) for step in (_R2_STEP_U, _R2_STEP_V)]
    u = hash_pixels(pixel, 2 * seed) + steps[0]
    v = hash_pixels(pixel, 2 * seed + 1) + steps[1]
    # 24 bits fit a float32 exactly, so neither point ever rounds up to 1.
    return (u >> np.uint32(8)).astype(dtype) * 2.0**-24, (v >> np.uint32(8)).astype(dtype) * 2.0**-24


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
