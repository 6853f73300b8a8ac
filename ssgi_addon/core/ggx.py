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
    # With cz = hz - wz: 1 - cz² by sums of what is positive, since a difference has no digits left at the
    # lobe's middle and at its end
    hz = (1.0 - v) * (1.0 + wz)
    sine = np.sqrt(v * (hz * (1.0 + wz) + (wx * wx + wy * wy)))
    hx = (sine * np.cos(angle) + wx) * alpha
    hy = (sine * np.sin(angle) + wy) * alpha
    inverse = 1.0 / np.sqrt(np.maximum(hx * hx + hy * hy + hz * hz, 1e-30))
    return np.stack([hx * inverse, hy * inverse, hz * inverse])


def smith_lambda(cosine: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return Smith's Lambda for GGX (Heitz 2014, equation 72); `cosine` > 0."""
    cosine2 = cosine * cosine
    tangent2 = np.maximum(1.0 - cosine2, 0.0) / np.maximum(cosine2, 1e-12)
    return 0.5 * (np.sqrt(1.0 + alpha * alpha * tangent2) - 1.0)


def normal_density(cosine: FloatArray, sine2: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return GGX's density of microfacet normals D, per steradian (Walter et al. 2007, equation 33).

    Parameters
    ----------
    cosine, sine2
        Cosine and squared sine of the angle to the surface's normal.
    alpha
        GGX alpha = roughness².
    """
    alpha2 = alpha * alpha
    spread = alpha2 * cosine * cosine + sine2
    density: FloatArray = alpha2 / (np.pi * spread * spread)
    return density
