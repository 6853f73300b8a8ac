# SPDX-License-Identifier: GPL-3.0-or-later
"""The result of the passes, and how it joins the picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .gbuffer import GBuffer
from .types import FloatArray


@dataclass(frozen=True, eq=False)
class IndirectLight:
    """Indirect light per pixel, before it is multiplied by the surface's colours.

    Attributes
    ----------
    diffuse : (H, W, 3) float32
        Mean incoming indirect radiance over the cosine hemisphere; compares with Cycles' Diffuse Indirect.
    glossy : (H, W, 3) float32
        Incoming indirect radiance weighted by the glossy lobe; compares with Cycles' Glossy Indirect.
    visibility : (H, W) float32
        Cosine-weighted open fraction of the hemisphere, 1 = open.
    known_diffuse, known_glossy, known : (H, W) float32
        Fraction of the samples that the frame or another view could answer; `known` weighs both by the
        luminance of albedo and specular.
    environment_diffuse : (H, W, 3) float32
        The part of `diffuse` that came from the environment.
    skipped
        What was not computed and why, as (what, why).
    seconds
        Wall time of each step, by its name.
    rays
        Number of rays that each pass traced, by its name.
    """

    diffuse: FloatArray
    glossy: FloatArray
    visibility: FloatArray
    known_diffuse: FloatArray
    known_glossy: FloatArray
    known: FloatArray
    environment_diffuse: FloatArray
    skipped: tuple[tuple[str, str], ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    rays: Mapping[str, int] = field(default_factory=dict)


def composite(gbuffer: GBuffer, light: IndirectLight) -> FloatArray:
    """Return the picture ``(H, W, 3)``: direct + albedo * diffuse + specular * glossy.

    Fresnel is not applied again: the glossy colour already is the lobe's directional albedo.

    Parameters
    ----------
    gbuffer
        The frame, with its direct light and colours.
    light
        Of that frame.

    Returns
    -------
    (H, W, 3) float32
        Scene-linear radiance; a new array.

    Raises
    ------
    ValueError
        If the two differ in size, or are something else.
    """
    for name, value, kind in (("gbuffer", gbuffer, GBuffer), ("light", light, IndirectLight)):
        if not isinstance(value, kind):
            raise ValueError(f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    if light.diffuse.shape != gbuffer.direct.shape:
        raise ValueError(
            f"light: expected the G-buffer's shape {gbuffer.direct.shape}, got {light.diffuse.shape}"
        )
    return gbuffer.direct + gbuffer.albedo * light.diffuse + gbuffer.specular * light.glossy


def fill_unknown(answered: FloatArray, known: FloatArray, samples: int, unknown: str) -> FloatArray:
    """Give unknown samples the mean of the pixel's answered ones where `Settings.unknown` asks for it.

    The mean of all pixels counts as one more answered sample, for pixels with none or few.

    Parameters
    ----------
    answered : (P, 3)
        Sum over the answered samples / number of samples.
    known : (P,)
        Fraction of the samples that were answered.
    samples
        Per pixel.
    unknown
        As in `Settings.unknown`.
    """
    if unknown != "mean":
        return answered
    total = float(known.sum(dtype=np.float64))
    overall = answered.sum(axis=0, dtype=np.float64) / total if total else np.zeros(3)
    one = 1.0 / samples
    mean = (answered + (overall * one).astype(answered.dtype)) / (known + one)[:, None]
    filled: FloatArray = answered + (1.0 - known)[:, None] * mean
    return filled


def luminance(rgb: FloatArray) -> FloatArray:
    """Return Rec. 709 luminance ``(...)`` of scene-linear RGB ``(..., 3)``."""
    value: FloatArray = 0.2126 * rgb[..., 0] + 0.7152 * rgb[..., 1] + 0.0722 * rgb[..., 2]
    return value
