# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces hand on to others, from passes that tell what they show to the camera (ADR 9)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .core import Camera, GBuffer
from .core.light import luminance

FloatArray = NDArray[np.float32]

# Of a surface with less diffuse colour than this, Diffuse Direct says nothing: it is divided by the colour.
_LEAST_DIFFUSE_COLOR = 1e-3
# Lobes of this roughness and more light what is around them; sharper ones show their lamps to single places.
_SPREADING_ROUGHNESS = 0.25
# Mean of (1 - cos)^5 over the cosine hemisphere: what Fresnel adds to the reflectance at a right angle.
_MEAN_FRESNEL = 1.0 / 21.0
# Without fireflies no pixel is brighter than this many times the median of those within a radius.
_BRIGHTEST = 4.0
_MEDIAN_RADIUS = 2


def handed_on(layers: Mapping[str, FloatArray], roughness: FloatArray) -> FloatArray:
    """Return the reflected direct light (H, W, 3) that surfaces hand on, whichever way they are seen from.

    Gloss takes its part of the light before the diffuse colour gets the rest, most of it at the camera's
    grazing angles. It hands its part on, too: what is missing in the colour is put back. A metal has no
    diffuse light to go by; where it is rough, what it shows to the camera stands for what it shows to others,
    but for the highlights of lamps, which are bright to one side alone.

    Parameters
    ----------
    layers
        Diffuse Direct and Color, Glossy Direct and Color, (H, W, 3) each.
    roughness : (H, W)
        Of the glossy lobe.
    """
    color, gloss = layers["Diffuse Color"], layers["Glossy Color"]
    is_rough_metal = (color.max(axis=-1) < _LEAST_DIFFUSE_COLOR) & (roughness >= _SPREADING_ROUGHNESS)
    is_surface = (color + gloss).max(axis=-1) > 0.0
    handed = layers["Diffuse Direct"] * _whole(color, gloss)
    if is_rough_metal.any():
        glossy = limit_fireflies(layers["Glossy Direct"] * gloss, is_surface, is_rough_metal)
        handed[is_rough_metal] = glossy[is_rough_metal]
    return handed


def seen_from_elsewhere(gbuffer: GBuffer) -> GBuffer:
    """Return a view's G-buffer without the gloss that lamps leave on what it shows.

    Gloss shines toward who looks. What a view from another place than the frame's sees of it is not what the
    frame's mirrors see: in the inside corners of rough metals, which rays find through such views, it was ten
    times too bright.

    Parameters
    ----------
    gbuffer
        Of the view; what metals hand on to diffuse rays stays, since that is a mean over all directions.
    """
    is_metal = (gbuffer.albedo.max(axis=-1) < _LEAST_DIFFUSE_COLOR) & (gbuffer.specular.max(axis=-1) > 0.0)
    return replace(gbuffer, glossy_source=np.where(is_metal[..., None], 0.0, gbuffer.diffuse_source))


def reflectance(color: FloatArray, gloss: FloatArray, normal_vs: FloatArray, camera: Camera) -> FloatArray:
    """Return the share (H, W, 3) of even light that surfaces reflect to others, diffuse and glossy.

    The glossy part at a right angle follows from that at the camera's angle by Schlick's approximation (1994,
    "An Inexpensive BRDF Model for Physically-based Rendering", equation 15), and its mean over the hemisphere
    is F0 + (1 - F0) / 21.

    Parameters
    ----------
    color, gloss : (H, W, 3)
        Diffuse Color and Glossy Color, as the camera sees them.
    normal_vs : (H, W, 3)
        View-space normals.
    camera
        Of the frame.
    """
    y, x = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float32) + 0.5
    away = camera.pixel_to_view(x, y, np.ones_like(x))
    if camera.is_orthographic:
        away = np.broadcast_to(np.float32([0.0, 0.0, -1.0]), away.shape)
    cosine = -(away * normal_vs).sum(axis=-1) / np.linalg.norm(away, axis=-1)
    grazing = ((1.0 - np.clip(cosine, 0.05, 1.0)) ** 5)[..., None]
    head_on = np.clip((gloss - grazing) / (1.0 - grazing), 0.0, 1.0)
    mean = np.where(gloss > 0.0, head_on + (1.0 - head_on) * _MEAN_FRESNEL, 0.0)
    whole = _whole(color, gloss)
    reflected: FloatArray = (whole + (1.0 - whole) * mean).astype(np.float32)
    return reflected


def _whole(color: FloatArray, gloss: FloatArray) -> FloatArray:
    """Return the diffuse colour before gloss takes its part of the light."""
    # The two together reflect no more than all light
    left = np.maximum(1.0 - gloss, np.minimum(color, 1.0))
    whole: FloatArray = np.divide(color, left, out=np.zeros_like(color), where=color > 0.0)
    return whole


def limit_fireflies(
    light: FloatArray, is_surface: NDArray[np.bool_], chosen: NDArray[np.bool_]
) -> FloatArray:
    """Return light (H, W, 3) whose chosen pixels (H, W) do not outshine all around them.

    Few light paths find small bright things by rare luck: such a pixel is right on average and wrong alone.
    None keeps more luminance than 4 times the median of the surfaces in the 5 x 5 pixels around it. That
    takes light away, the less the more samples there are.
    """
    radius = _MEDIAN_RADIUS
    brightness = np.where(is_surface, luminance(light), np.float32(np.inf))
    padded = np.pad(brightness, radius, constant_values=np.inf)
    row, column = np.nonzero(chosen & is_surface)
    corner = row * padded.shape[1] + column
    offsets = [down * padded.shape[1] + right for down, right in np.ndindex(2 * radius + 1, 2 * radius + 1)]
    ordered = np.sort(padded.reshape(-1).take(corner + np.array(offsets)[:, None]), axis=0)
    # The inf of what is no surface stands last; the pixel itself is one
    count = np.isfinite(ordered).sum(axis=0)
    lower, upper = (
        np.take_along_axis(ordered, index[None], axis=0)[0] for index in ((count - 1) // 2, count // 2)
    )
    own = light[row, column]
    limit = (0.5 * _BRIGHTEST) * (lower + upper)
    limited = light.copy()
    limited[row, column] = own * np.minimum(1.0, limit / np.maximum(luminance(own), 1e-20))[:, None]
    return limited
