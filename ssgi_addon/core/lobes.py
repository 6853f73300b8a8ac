# SPDX-License-Identifier: GPL-3.0-or-later
"""Glossy lobes about surface points: drawing directions, and what a direction is worth.

Directions below the shading surface are worth nothing: no light is reflected from there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import ggx
from .sampling import tangent_frame, to_frame
from .types import FloatArray

# A shading normal may turn away from the camera; the lobe is then that of a grazing view.
_LEAST_VIEW_COSINE = 1e-3
# A narrower lobe than this is below the rounding of a direction.
_LEAST_ALPHA = 1e-4


@dataclass(frozen=True, eq=False)
class Lobes:
    """GGX lobes without Fresnel, one per point; arrays may have any shape behind the components.

    Attributes
    ----------
    normal, axis, view : (3, ...)
        Unit shading normals; the microfacets' mean normals; and unit vectors to where the lobes are seen
        from.
    alpha : (...)
        GGX alpha = roughness².
    """

    normal: FloatArray
    axis: FloatArray
    view: FloatArray
    alpha: FloatArray

    @classmethod
    def at(
        cls, normal: FloatArray, view: FloatArray, roughness: FloatArray, is_elongated: bool = True
    ) -> Lobes:
        """Return the lobes of surface points.

        Parameters
        ----------
        normal, view : (3, ...)
            Unit shading normals, and unit vectors toward the camera.
        roughness : (...)
            As on the Principled BSDF.
        is_elongated
            Lobes stretch toward the viewer at grazing angles, as microfacets make them do. Otherwise each is
            the round lobe of a surface seen head-on, turned to the mirror direction.
        """
        alpha = np.maximum(roughness * roughness, _LEAST_ALPHA)
        if is_elongated:
            return cls(normal, normal, view, alpha)
        mirrored = 2.0 * _dot(normal, view) * normal - view
        return cls(normal, mirrored, mirrored, alpha)

    def draw(self, u: FloatArray, v: FloatArray, is_mirror: bool) -> tuple[FloatArray, FloatArray]:
        """Draw directions with the density of the microfacets that are visible from the viewer.

        Parameters
        ----------
        u, v : (rays, N)
            Sample points of [0, 1)².
        is_mirror
            Return the mirror directions alone.

        Returns
        -------
        direction : (3, rays, N)
            Unit directions.
        pdf : (rays, N)
            Their density per steradian: D G1 / (4 cos(view)) (Heitz 2018, equation 17).
        """
        tangent, bitangent = tangent_frame(self.axis)
        along = [_dot(self.view, axis) for axis in (tangent, bitangent, self.axis)]
        cosine_view = np.maximum(along[2], _LEAST_VIEW_COSINE)
        # A unit vector once more where the view was lifted; 1 - cos² holds nothing of a small angle
        scale = np.sqrt(np.maximum(1.0 - cosine_view * cosine_view, 0.0))
        scale /= np.sqrt(np.maximum(along[0] ** 2 + along[1] ** 2, 1e-20))
        scale = np.where(along[2] < _LEAST_VIEW_COSINE, scale, 1.0).astype(scale.dtype)
        local_view = np.stack([along[0] * scale, along[1] * scale, cosine_view])
        hx, hy, hz = ggx.sample_visible_normal(local_view, self.alpha, u, v)
        if is_mirror:
            hx, hy, hz = np.zeros_like(hx), np.zeros_like(hy), np.ones_like(hz)
        twice = 2.0 * (local_view[0] * hx + local_view[1] * hy + local_view[2] * hz)
        local = (twice * hx - local_view[0], twice * hy - local_view[1], twice * hz - local_view[2])
        direction = to_frame(*local, tangent, bitangent, self.axis)
        density = ggx.normal_density(hz, hx * hx + hy * hy, self.alpha)
        pdf = density / (4.0 * cosine_view * (1.0 + ggx.smith_lambda(cosine_view, self.alpha)))
        dtype = self.normal.dtype
        return direction.astype(dtype), pdf.astype(dtype)

    def peak(self) -> FloatArray:
        """Return the density (...) of `draw` at the mirror direction, per steradian."""
        cosine_view = np.maximum(_dot(self.axis, self.view), _LEAST_VIEW_COSINE)
        masked: FloatArray = 1.0 + ggx.smith_lambda(cosine_view, self.alpha)
        density: FloatArray = 1.0 / (4.0 * np.pi * self.alpha * self.alpha * cosine_view * masked)
        return density

    def value(self, direction: FloatArray) -> FloatArray:
        """Return f cos (...) for unit directions (3, ...): D G2 / (4 cos(view)) (Heitz 2018, equation 15)."""
        cosine_view = np.maximum(_dot(self.axis, self.view), _LEAST_VIEW_COSINE)
        cosine = _dot(self.axis, direction)
        half = self.view + direction
        half *= 1.0 / np.sqrt(np.maximum(_dot(half, half), 1e-20))
        cosine_half = _dot(self.axis, half)
        # The sine from the part beside the axis: 1 - cos² holds no narrow lobe in single precision
        half -= cosine_half * self.axis
        density = ggx.normal_density(cosine_half, _dot(half, half), self.alpha)
        lambda_view = ggx.smith_lambda(cosine_view, self.alpha)
        lambda_light = ggx.smith_lambda(np.maximum(cosine, 1e-6), self.alpha)
        value = density / (4.0 * cosine_view * (1.0 + lambda_view + lambda_light))
        is_above = (_dot(self.normal, direction) > 0.0) & (cosine > 0.0)
        above: FloatArray = value * is_above
        return above


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product
