# SPDX-License-Identifier: GPL-3.0-or-later
"""What views could not answer, from a fill: it sets the level of the light, the rays its detail.

The answered light is taken to the fill's resolution and compared with it there; the difference comes back
along depth and normal. Few light paths are noisy, and rays that the views could not answer make answered
light wrong: the level lies between the two, nearer to the one whose error is smaller.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .camera import Camera
from .carry import carry_over
from .denoise import filter_light
from .fill import Fill
from .gbuffer import GBuffer
from .light import luminance
from .types import FloatArray, IntArray

# Passes of the filter, all blind to luminance: the last of three reaches 4 pixels of the fill.
_LEVELS = 3
# Fewer samples than these take one pass more.
_FEW_SAMPLES = 4.0
# No pixel of a fill counts as brighter than this many times the filtered light around it.
_BRIGHTEST = 8.0
# Squared error of answered light, in units of that of a fill with one sample: what the unknown share,
# squared, makes of it, and what all else does.
_UNKNOWN_ERROR, _LEAST_ERROR = 3.0, 0.13


def set_level(
    lights: Sequence[tuple[FloatArray, FloatArray, IntArray, FloatArray]],
    frame: tuple[GBuffer, Camera],
    fill: Fill,
    threads: int | None,
) -> list[FloatArray]:
    """Return answered lights at the level of a fill's; where nothing of the fill is near, they stay.

    Parameters
    ----------
    lights
        Of each kind (P, 3), what rays brought to some pixels of the frame, unknown directions nothing or a
        guess; the known fraction of these rays (P,); the flat indices of the pixels (P,); and the fill's
        light of that kind (h, w, 3).
    frame
        Its G-buffer and camera.
    fill
        Of the same world, from any place.
    threads
        Worker threads.
    """
    moves = [_moves(*light, frame, fill, threads) for light in lights]
    # Weights are the same for all kinds of light
    is_lit = np.zeros(frame[0].depth.size, dtype=np.bool_)
    for _, _, pixel, _ in lights:
        is_lit[pixel] = True
    everywhere = np.flatnonzero(is_lit)
    slots = np.cumsum(is_lit) - 1
    carried, _ = carry_over(moves, (fill.surfaces, fill.camera), frame, everywhere, threads)
    levelled = []
    for (light, _, pixel, _), found in zip(lights, carried, strict=True):
        found = found.take(slots.take(pixel), axis=0)
        # Pixels of the fill that the frame does not see are no part of the mean
        found *= 1.0 / np.maximum(found[:, 6:], 1e-6)
        levelled.append(light * (1.0 - found[:, 3:6]) + found[:, :3])
    return levelled


def _moves(
    light: FloatArray,
    known: FloatArray,
    pixel: IntArray,
    traced: FloatArray,
    frame: tuple[GBuffer, Camera],
    fill: Fill,
    threads: int | None,
) -> FloatArray:
    """Return how light has to move at the fill's pixels (h * w, 7).

    What has to be added, by which share of itself light that is too bright is lowered (a sum would leave
    black spots where the rays' detail is dark), and 1 where that is known.
    """
    image = np.zeros((fill.depth.size, 7), dtype=light.dtype)
    texel, answered, share = _answered(light, known, pixel, frame, fill, threads)
    if texel.size:
        raw = traced.reshape(-1, 3).take(texel, axis=0)
        samples = np.asarray(fill.samples).reshape(-1).take(texel)
        levels = _LEVELS + int(samples.min() < _FEW_SAMPLES)

        def smooth(parts: list[FloatArray]) -> list[FloatArray]:
            nothing = np.zeros_like(raw[:, 0])
            return filter_light(
                fill.surfaces, fill.camera, texel, parts, nothing, levels, threads, geometric_levels=levels
            )

        mean, level, share = smooth([raw, answered, share])
        (mean,) = smooth([_without_fireflies(raw, mean)])
        target = level + (mean - level) * _trust(samples, share[:, 0])[:, None]
        image[texel, :3] = np.maximum(target - level, 0.0)
        image[texel, 3:6] = np.maximum(level - target, 0.0) / np.maximum(level, np.float32(1e-20))
        image[texel, 6] = 1.0
    return image


def _trust(samples: FloatArray, known: FloatArray) -> FloatArray:
    """Return the weight (N,) of a fill beside answered light: inverse to their squared errors."""
    unknown = np.maximum(1.0 - known, 0.0)
    weight: FloatArray = samples * (_UNKNOWN_ERROR * unknown * unknown + _LEAST_ERROR)
    return weight / (1.0 + weight)


def _answered(
    light: FloatArray,
    known: FloatArray,
    pixel: IntArray,
    frame: tuple[GBuffer, Camera],
    fill: Fill,
    threads: int | None,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the fill's pixels (T,) that the frame sees, its light there (T, 3), and how much is known."""
    texel = np.flatnonzero(~fill.surfaces.is_background)
    # Pixels without rays are no part of the mean
    image = np.zeros((frame[0].depth.size, 5), dtype=light.dtype)
    image[pixel, :3], image[pixel, 3], image[pixel, 4] = light, known, 1.0
    (found,), _ = carry_over([image], frame, (fill.surfaces, fill.camera), texel, threads)
    seen = np.flatnonzero(found[:, 4] > 0.0)
    found = found.take(seen, axis=0)
    found[:, :4] /= found[:, 4:]
    return texel.take(seen), found[:, :3], found[:, 3:4]


def _without_fireflies(light: FloatArray, around: FloatArray) -> FloatArray:
    """Return light (N, 3) without single pixels that outshine all around them.

    Few light paths find small bright things by rare luck: such a pixel is right on average and wrong alone.
    None keeps more luminance than 8 times that of the mean `around` it, (N, 3).
    """
    limit = _BRIGHTEST * luminance(around)
    scale = np.minimum(1.0, limit / np.maximum(luminance(light), np.float32(1e-20)))
    limited: FloatArray = light * scale[:, None]
    return limited
