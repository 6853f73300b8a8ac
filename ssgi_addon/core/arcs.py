# SPDX-License-Identifier: GPL-3.0-or-later
"""The hemisphere above a pixel in slices through the view direction, measured by cosine-weighted solid angle.

A slice is the plane of the view direction and a direction on the screen; within it a direction is the angle
theta from the view direction, 0 toward the camera, on the one side or on the other. Over all slices

    E / pi = 1/pi ∫ dphi |n'| ∫ L(theta) sin|theta| cos(theta - gamma) dtheta

with n' the normal projected into the slice and gamma its angle (Jimenez et al. 2016, "Practical Realtime
Strategies for Accurate Indirect Occlusion", equations 5 to 7). The inner integral from 0 to theta is closed:

    F(theta) = (cos(gamma) sin²(theta) + sin(gamma) (theta - sin(theta) cos(theta))) / 2

Sectors of equal F, and not of equal angle as in Therrien et al. 2023 ("Screen Space Indirect Lighting with
Visibility Bitmask"), carry equal shares of light: a count of sectors is an integral with the right weights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .camera import Camera
from .gbuffer import GBuffer
from .types import BoolArray, FloatArray

# Sectors of each side of a slice, the bits of a word.
SECTORS = 32
# arccos(c) - c sqrt(1 - c²) - pi/2 as an odd polynomial of c; off by 1.1e-3 of pi at most, by minimax fit.
_ARC = (-2.00826078, 0.41591611, -0.16016793, 0.18065966)
# A shading normal may turn away from the camera; its slices are then those of a grazing view.
_LEAST_VIEW_COSINE = 1e-3
# A side of a slice that holds less than this share of an even hemisphere's light holds none.
_LEAST_SHARE = 1e-4


def arc(cosine: FloatArray) -> FloatArray:
    """Return theta - sin(theta) cos(theta) of cosines of theta in [0, pi]."""
    square = cosine * cosine
    odd = ((_ARC[3] * square + _ARC[2]) * square + _ARC[1]) * square + _ARC[0]
    measure: FloatArray = odd * cosine + 0.5 * math.pi
    return measure


@dataclass(frozen=True, eq=False)
class Receivers:
    """Pixels that receive light, and the geometry that all slices through them share; arrays ``(N,)``.

    Attributes
    ----------
    is_surface
        False for the background.
    q
        As in `DepthField`.
    normal, view : (3, N)
        Unit shading normals, and unit vectors toward the camera.
    length, per_q
        A point at screen offset s and depth q lies `length` + s `along` - q `per_q` ahead, along the line of
        sight, in a unit that is proportional to 1 / q for a perspective camera.
    """

    is_surface: BoolArray
    q: FloatArray
    normal: FloatArray
    view: FloatArray
    length: FloatArray
    per_q: FloatArray
    camera: Camera

    @classmethod
    def of(cls, gbuffer: GBuffer, camera: Camera, where: tuple[slice, slice]) -> Receivers:
        """Return the pixels of a part of the frame."""
        height, width = gbuffer.shape
        depth = gbuffer.depth[where]
        dtype = depth.dtype
        is_surface = ~gbuffer.is_background[where].ravel()
        depth = np.where(is_surface, depth.ravel(), dtype.type(1.0))
        normal = np.ascontiguousarray(gbuffer.normal[where].reshape(-1, 3).T)
        if camera.is_orthographic:
            view = np.zeros((3, depth.size), dtype=dtype)
            view[2] = 1.0
            return cls(is_surface, -depth, normal, view, -depth, np.ones_like(depth), camera)
        x = ((np.arange(width)[where[1]] + (0.5 - camera.cx)) / camera.fx).astype(dtype)
        y = ((camera.cy - 0.5 - np.arange(height)[where[0]]) / camera.fy).astype(dtype)[:, None]
        ahead = np.stack(np.broadcast_arrays(x, y, dtype.type(-1.0))).reshape(3, -1)
        length = np.sqrt((ahead * ahead).sum(axis=0))
        view = -ahead / length
        return cls(is_surface, 1.0 / depth, normal, view, length, length * depth, camera)


@dataclass(frozen=True, eq=False)
class SliceSide:
    """One side of a slice through pixels: from the view direction to the tangent plane; arrays ``(N,)``.

    Attributes
    ----------
    axis : (3, N)
        Unit vectors in the slice, at a right angle to the view direction, that point to this side.
    tangent
        Cosine of theta at the tangent plane.
    constant, quadratic, linear
        A direction of cosine c has passed `constant` - `quadratic` c² + `linear` c P(c²) sectors, counted
        from the view direction, with P the polynomial of `arc`.
    weight
        The side's share of the light of an even hemisphere, up to a factor of the pixel's own.
    across
        Width of a pixel along `axis` at depth 1 (orthographic: at any depth), scene units.
    offset, scale, slope
        cot(theta) = (q `slope` - `scale`) / s - `offset` of a point at s pixels along the screen and depth q.
    """

    axis: FloatArray
    tangent: FloatArray
    constant: FloatArray
    quadratic: FloatArray
    linear: FloatArray
    weight: FloatArray
    across: FloatArray
    offset: FloatArray
    scale: FloatArray
    slope: FloatArray

    @classmethod
    def of(cls, receivers: Receivers, ux: float, uy: float) -> SliceSide:
        """Return the side toward a unit direction (ux, uy) on the screen, y down."""
        camera, view = receivers.camera, receivers.view
        step = (ux / camera.fx, -uy / camera.fy)
        # The step's part along the line of sight, away from the camera, and the part across it
        along = -(view[0] * step[0] + view[1] * step[1])
        axis = np.stack([step[0] + along * view[0], step[1] + along * view[1], along * view[2]])
        across = np.sqrt((axis * axis).sum(axis=0))
        inverse = 1.0 / across
        axis *= inverse
        normal = receivers.normal
        toward = np.maximum((normal * view).sum(axis=0), _LEAST_VIEW_COSINE)
        beside = (normal * axis).sum(axis=0)
        projected = np.sqrt(toward * toward + beside * beside)
        cosine, sine = toward / projected, beside / projected
        light = 0.5 * (cosine * (1.0 - sine * sine) + sine * arc(-sine))
        # An even turn on the screen is no even turn about the line of sight: dphi ~ 1 / across²
        weight = projected * light * inverse * inverse
        sectors = SECTORS * 0.5 / np.maximum(light, _LEAST_SHARE)
        quadratic, linear = sectors * cosine, sectors * sine
        constant = quadratic + (0.5 * math.pi) * linear
        weight = np.where((light > _LEAST_SHARE) & receivers.is_surface, weight, 0.0)
        return cls(
            axis, -sine, constant, quadratic, linear, weight.astype(along.dtype),
            across, along * inverse, receivers.length * inverse, receivers.per_q * inverse,
        )  # fmt: skip

    def sectors(self, cotangent: FloatArray, scratch: FloatArray) -> FloatArray:
        """Turn cot(theta) (K, N) into the number of sectors passed from the view direction, in place.

        Directions below the tangent plane count as those in it: all sectors.
        """
        np.multiply(cotangent, cotangent, out=scratch)
        np.add(scratch, 1.0, out=scratch)
        np.sqrt(scratch, out=scratch)
        cosine = np.divide(cotangent, scratch, out=cotangent)
        np.maximum(cosine, self.tangent, out=cosine)
        return self._passed(cosine, scratch)

    def _passed(self, cosine: FloatArray, square: FloatArray) -> FloatArray:
        """Return the sectors that directions have passed, in `cosine`; `square` is scratch."""
        odd = np.empty_like(cosine)
        np.multiply(cosine, cosine, out=square)
        np.multiply(square, _ARC[3], out=odd)
        for coefficient in (_ARC[2], _ARC[1]):
            np.add(odd, coefficient, out=odd)
            np.multiply(odd, square, out=odd)
        np.add(odd, _ARC[0], out=odd)
        np.multiply(odd, cosine, out=odd)
        np.multiply(odd, self.linear, out=odd)
        np.multiply(square, self.quadratic, out=square)
        np.subtract(odd, square, out=cosine)
        np.add(cosine, self.constant, out=cosine)
        return cosine

    def direction(self, passed: FloatArray, view: FloatArray) -> FloatArray:
        """Return the view-space directions (3, N) that have passed some sectors, `view` as in `Receivers`.

        By bisection: the number falls from the tangent plane's cosine to 1.
        """
        low, high = self.tangent.copy(), np.ones_like(self.tangent)
        for _ in range(14):
            middle = 0.5 * (low + high)
            is_beyond = self._passed(middle.copy(), np.empty_like(middle)) > passed
            low, high = np.where(is_beyond, middle, low), np.where(is_beyond, high, middle)
        cosine = 0.5 * (low + high)
        sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
        direction: FloatArray = cosine * view + sine * self.axis
        return direction
