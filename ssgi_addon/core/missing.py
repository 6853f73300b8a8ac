# SPDX-License-Identifier: GPL-3.0-or-later
"""What views could not answer, from a fill: the light that it has and the answered light lacks.

The answered light is taken to the fill's resolution, subtracted there, and what is left comes back along depth
and normal; so detail stays that of the rays. The few light paths of a fill are noisy: fireflies are limited,
the filter runs along surfaces, and what is left counts the less the more of it may be noise.
"""

from __future__ import annotations

import numpy as np

from .camera import Camera
from .carry import carry_over
from .denoise import filter_light
from .fill import Fill
from .gbuffer import GBuffer
from .light import luminance
from .types import BoolArray, FloatArray, IntArray

# Passes of the filter, all blind to luminance: the last reaches 4 pixels of the fill.
_LEVELS = 3
# Pixels whose mean a filtered one is, about: fewer than on an open plane, since edges are everywhere.
_FILTERED_PIXELS = 40.0
# No pixel of a fill is brighter than this many times the median of those within a radius.
_BRIGHTEST = 4.0
_MEDIAN_RADIUS = 2
# Sharper reflections show what the few pixels of a fill cannot: they stay as they are.
LEAST_FILLED_ROUGHNESS = 0.2


def add_missing(
    light: FloatArray,
    pixel: IntArray,
    frame: tuple[GBuffer, Camera],
    fill: Fill,
    indirect: FloatArray,
    threads: int | None,
) -> FloatArray:
    """Return answered light with what it lacks of a fill's.

    Parameters
    ----------
    light : (P, 3)
        What rays brought to some pixels of the frame; unknown directions may bring nothing, or a guess.
    pixel : (P,)
        Flat indices of these pixels.
    frame
        Its G-buffer and camera.
    fill
        Of the same world, from any place.
    indirect : (h, w, 3)
        One of the fill's two kinds of light: the one that `light` is.
    threads
        Worker threads.
    """
    texel, answered = _answered(light, pixel, frame, fill, threads)
    if not texel.size:
        return light
    traced = limit_fireflies(indirect, ~fill.surfaces.is_background).reshape(-1, 3).take(texel, axis=0)
    squared = luminance(traced)[:, None] ** 2
    parts = filter_light(
        fill.surfaces, fill.camera, texel, [traced, answered, squared], squared[:, 0], _LEVELS, threads,
        geometric_levels=_LEVELS,
    )  # fmt: skip
    image = np.zeros((fill.depth.size, 8), dtype=light.dtype)
    image[texel] = np.concatenate([*parts, np.ones_like(squared)], axis=1)
    (found,), _ = carry_over([image], (fill.surfaces, fill.camera), frame, pixel, threads)
    share = found[:, 7:]
    found *= 1.0 / np.maximum(share, 1e-6)
    missing = np.maximum(found[:, :3] - found[:, 3:6], 0.0)
    noise = np.maximum(found[:, 6] - luminance(found[:, :3]) ** 2, 0.0) * (1.0 / _FILTERED_PIXELS)
    # Wiener's gain: signal over signal and noise
    signal = luminance(missing) ** 2
    gain = signal / np.maximum(signal + noise, 1e-20)
    return light + gain[:, None] * missing


def _answered(
    light: FloatArray, pixel: IntArray, frame: tuple[GBuffer, Camera], fill: Fill, threads: int | None
) -> tuple[IntArray, FloatArray]:
    """Return the fill's pixels (T,) that the frame sees, and its light (T, 3) there."""
    texel = np.flatnonzero(~fill.surfaces.is_background)
    # Pixels without rays are no part of the mean
    image = np.zeros((frame[0].depth.size, 4), dtype=light.dtype)
    image[pixel, :3], image[pixel, 3] = light, 1.0
    (found,), _ = carry_over([image], frame, (fill.surfaces, fill.camera), texel, threads)
    seen = np.flatnonzero(found[:, 3] > 0.0)
    found = found.take(seen, axis=0)
    return texel.take(seen), found[:, :3] / found[:, 3:]


def limit_fireflies(light: FloatArray, is_surface: BoolArray) -> FloatArray:
    """Return light (h, w, 3) without single pixels that outshine all around them.

    Few light paths find small bright things by rare luck: such a pixel is right on average and wrong alone.
    None keeps more luminance than 4 times the median of the surfaces in the 5 x 5 pixels around it. This
    takes light away, the less the more samples there are.
    """
    brightness = np.where(is_surface, luminance(light), np.float32(np.inf))
    radius = _MEDIAN_RADIUS
    padded = np.pad(brightness, radius, constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1, 2 * radius + 1))
    ordered = np.sort(windows.reshape(*brightness.shape, -1), axis=-1)
    # The inf of what is no surface stands last
    count = np.isfinite(ordered).sum(axis=-1, keepdims=True)
    middle = np.maximum((count - 1) // 2, 0), np.maximum(count // 2, 0)
    lower, upper = (np.take_along_axis(ordered, index, axis=-1) for index in middle)
    with np.errstate(invalid="ignore"):
        limit = np.where(count > 0, (0.5 * _BRIGHTEST) * (lower + upper), 0.0)
        scale = np.minimum(1.0, limit / np.maximum(luminance(light)[..., None], 1e-20))
    return np.where(is_surface[..., None], light * scale, light).astype(light.dtype, copy=False)
