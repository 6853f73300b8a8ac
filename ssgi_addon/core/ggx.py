# SPDX-License-Identifier: GPL-3.0-or-later
"""The GGX microfacet lobe: sampling of visible normals and Smith's masking.

Local space: +Z is the surface normal, vectors point away from the surface.
"""

from __future__ import annotations

import numpy as np

from .types import FloatArray

# Below this roughness the lobe is narrower than a pixel's cone and one exact ray answers it.
MIRROR_ROUGHNESS = 0.03


def sample_visible_normal(view: FloatArray, alpha: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Draw microfacet normals with the density of the normals visible from `view`.

    Parameters
    ----------
    view : (3, N)
        Unit local vectors toward the viewer, z > 0.
    alpha : (N,)
        GGX alpha = roughness².
    u, v : (rays, N)
        Sample points of [0, 1)².

    Returns
    -------
    (3, rays, N)
        Unit normals. Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps", listing 3.
    """
    wx, wy, wz = view[0] * alpha, view[1] * alpha, view[2]
    inverse = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
    wx, wy, wz = wx * inverse, wy * inverse, wz * inverse
    angle = 2.0 * np.pi * u
    cz = (1.0 - v) * (1.0 + wz) - wz
    sine = np.sqrt(np.clip(1.0 - cz * cz, 0.0, 1.0))
    hx = (sine * np.cos(angle) + wx) * alpha
    hy = (sine * np.sin(angle) + wy) * alpha
    hz = cz + wz
    inverse = 1.0 / np.sqrt(np.maximum(hx * hx + hy * hy + hz * hz, 1e-30))
    return np.stack([hx * inverse, hy * inverse, hz * inverse])


def smith_lambda(cosine: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return Smith's Lambda for GGX (Heitz 2014, equation 72); `cosine` > 0."""
    cosine2 = cosine * cosine
    tangent2 = np.maximum(1.0 - cosine2, 0.0) / np.maximum(cosine2, 1e-12)
    return 0.5 * (np.sqrt(1.0 + alpha * alpha * tangent2) - 1.0)


def sample_weight(cosine_view: FloatArray, cosine_light: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return f cos / pdf without Fresnel for visible-normal samples: G2 / G1, height-correlated.

    Zero where the light direction is below the surface (Heitz 2018, section 5).
    """
    lambda_view = smith_lambda(cosine_view, alpha)
    lambda_light = smith_lambda(np.maximum(cosine_light, 1e-6), alpha)
    weight = (1.0 + lambda_view) / (1.0 + lambda_view + lambda_light)
    return np.where(cosine_light > 0.0, weight, 0.0)
