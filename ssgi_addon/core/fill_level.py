# SPDX-License-Identifier: GPL-3.0-or-later
"""What views could not answer, from a fill: it sets the level of the light, the rays its detail.

The answered light is taken to the fill's resolution and compared with it there; the difference comes back
along depth and normal. Few light paths are noisy, by fireflies most of all, so the filtered fill tells two
bounds: without fireflies it is too dark, with them too bright, if anything. Answered light is moved only as
far as into these bounds.
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
from .types import BoolArray, FloatArray, IntArray

# Passes of the filter, all blind to luminance: the last reaches 4 pixels of the fill.
_LEVELS = 3
# Without fireflies no pixel of a fill is brighter than this many times the median of those within a radius.
_BRIGHTEST = 4.0
_MEDIAN_RADIUS = 2


def set_level(
    lights: Sequence[tuple[FloatArray, IntArray, FloatArray]],
    frame: tuple[GBuffer, Camera],
    fill: Fill,
    threads: int | None,
) -> list[FloatArray]:
    """Return answered lights at the level of a fill's; where nothing of the fill is near, they stay.

    Parameters
    ----------
    lights
        Of each kind (P, 3), what rays brought to some pixels of the frame, unknown directions nothing or a
        guess; the flat indices of these pixels (P,); and the fill's light of that kind (h, w, 3).
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
    for _, pixel, _ in lights:
        is_lit[pixel] = True
    everywhere = np.flatnonzero(is_lit)
    slots = np.cumsum(is_lit) - 1
    carried, _ = carry_over(moves, (fill.surfaces, fill.camera), frame, everywhere, threads)
    levelled = []
    for (light, pixel, _), found in zip(lights, carried, strict=True):
        found = found.take(slots.take(pixel), axis=0)
        # Pixels of the fill that the frame does not see are no part of the mean
        found *= 1.0 / np.maximum(found[:, 6:], 1e-6)
        levelled.append(light * (1.0 - found[:, 3:6]) + found[:, :3])
    return levelled


def _moves(
    light: FloatArray,
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
    texel, answered = _answered(light, pixel, frame, fill, threads)
    if texel.size:
        limited = limit_fireflies(traced, ~fill.surfaces.is_background)
        brightest, darkest = (of.reshape(-1, 3).take(texel, axis=0) for of in (traced, limited))
        brightest, darkest, level = filter_light(
            fill.surfaces, fill.camera, texel, [brightest, darkest, answered], np.zeros_like(darkest[:, 0]),
            _LEVELS, threads, geometric_levels=_LEVELS,
        )  # fmt: skip
        target = np.clip(level, darkest, np.maximum(darkest, brightest))
        image[texel, :3] = np.maximum(target - level, 0.0)
        image[texel, 3:6] = np.maximum(level - target, 0.0) / np.maximum(level, np.float32(1e-20))
        image[texel, 6] = 1.0
    return image


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
    None keeps more luminance than 4 times the median of the surfaces in the 5 x 5 pixels around it. That
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
