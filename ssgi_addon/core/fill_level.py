# SPDX-License-Identifier: GPL-3.0-or-later
"""What views could not answer, from a fill: it sets the level of the light, the rays its detail.

The answered light is taken to the fill's resolution and compared with it there; the difference comes back
along depth and normal. Few light paths are noisy, and rays that the views could not answer make answered
light wrong: the level lies between the two, nearer to the one whose error is smaller.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .carry import carry_over
from .denoise import filter_light
from .fill import Fill
from .gbuffer import GBuffer
from .light import luminance
from .scene import TraceScene
from .types import BoolArray, FloatArray, IntArray

# Passes of the filter that are blind to luminance: the last of three reaches 4 pixels of the fill.
_LEVELS = 3
# Fewer samples than these take one pass more.
_FEW_SAMPLES = 4.0
# Passes after those for light that is wide enough, which look at luminance, and the most of all of them.
_LUMINANCE_LEVELS, _MOST_LEVELS = 2, 5
# No pixel of a fill counts as brighter than this many times the filtered light around it.
_BRIGHTEST = 8.0
# Squared error of answered light, in units of that of a fill with one sample: what the unknown share,
# squared, makes of it, and what all else does.
_UNKNOWN_ERROR, _LEAST_ERROR = 3.0, 0.13
# The same of a denoised fill: of one sample, and what stays of it with many, since its pixels are large.
_DENOISED_ERROR, _COARSE_ERROR = 0.125, 0.05
# A fill of so many of its pixels to one of the frame's is read between the four nearest.
_FINE = 2.5


@dataclass(frozen=True, eq=False)
class Answered:
    """One kind of light as rays brought it to P pixels of the frame.

    Attributes
    ----------
    light : (P, 3)
        Unknown directions brought nothing or a guess.
    known : (P,)
        Fraction of the rays that were answered.
    pixel : (P,)
        Flat indices.
    traced : (h, w, 3)
        The fill's light of that kind.
    passes : (P,) or a number
        Most passes of the filter: over how wide a part of a surface the light is alike. Mirrors show
        something else in every pixel.
    """

    light: FloatArray
    known: FloatArray
    pixel: IntArray
    traced: FloatArray
    passes: NDArray[np.integer[Any]] | int = _LEVELS + 1


def set_level(
    lights: Sequence[Answered],
    frame: tuple[GBuffer, Camera],
    fill: Fill,
    threads: int | None,
    dimmed: list[float] | None = None,
) -> list[FloatArray]:
    """Return answered lights at the level of a fill's; where nothing of the fill is near, they stay.

    Parameters
    ----------
    lights
        Of each kind.
    frame
        Its G-buffer and camera.
    fill
        Of the same world, from any place.
    threads
        Worker threads.
    dimmed
        Receives, for each light, which share of the fill's the limit on single bright pixels took away.
    """
    moves = []
    for answered in lights:
        image, share = _moves(answered, frame, fill, threads)
        moves.append(image)
        if dimmed is not None:
            dimmed.append(share)
    # Weights are the same for all kinds of light
    is_lit = np.zeros(frame[0].depth.size, dtype=np.bool_)
    for answered in lights:
        is_lit[answered.pixel] = True
    everywhere = np.flatnonzero(is_lit)
    slots = np.cumsum(is_lit) - 1
    carried, _ = carry_over(moves, (fill.surfaces, fill.camera), frame, everywhere, threads)
    levelled = []
    for answered, found in zip(lights, carried, strict=True):
        found = found.take(slots.take(answered.pixel), axis=0)
        # Pixels of the fill that the frame does not see are no part of the mean
        found *= 1.0 / np.maximum(found[:, 6:], 1e-6)
        levelled.append(answered.light * (1.0 - found[:, 3:6]) + found[:, :3])
    return levelled


def light_of_fill(
    fill: Fill,
    target: tuple[GBuffer, Camera],
    pixel: IntArray,
    threads: int | None,
    *,
    is_loose: bool = False,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the fill's diffuse and glossy light (P, 3) at pixels of a view, and where (P,) it has some.

    Parameters
    ----------
    fill
        Of the same world, from any place.
    target
        The view: G-buffer and camera.
    pixel : (P,)
        Flat indices of surfaces in it.
    threads
        Worker threads.
    is_loose
        As in `carry_over`.
    """
    parts = [image.reshape(-1, 3) for image in (fill.diffuse, fill.glossy)]
    reach = 1 if target[0].shape[0] <= _FINE * fill.shape[0] else None
    source = fill.surfaces, fill.camera
    (diffuse, glossy), is_found = carry_over(
        parts, source, target, pixel, threads, is_loose=is_loose, reach=reach
    )
    return diffuse, glossy, is_found


def handed_on_by_fill(
    fill: Fill, scene: TraceScene, images: Mapping[str, FloatArray], threads: int | None
) -> FloatArray:
    """Return the indirect light (texels + 1, 3) that the pixels of all views hand on to mirrors.

    Parameters
    ----------
    fill, threads
        As in `light_of_fill`.
    scene
        The frame, and views whose light is the fill's where that sees them, else the mean of it.
    images
        The frame's diffuse and glossy light, by name.
    """
    handed_on = np.zeros((scene.texels + 1, 3), dtype=scene.dtype)
    lit = np.flatnonzero(~fill.surfaces.is_background)
    ambient = fill.diffuse.reshape(-1, 3).take(lit, axis=0).mean(axis=0) if lit.size else 0.0
    for home, view in enumerate(scene.views):
        front = view.layers[0]
        texels = handed_on[scene.front_texels(home)]
        if home == 0:
            for name, color in (("diffuse", front.albedo), ("glossy", front.specular)):
                texels += (images[name] * color).reshape(-1, 3)
            continue
        pixel = np.flatnonzero(~front.is_background)
        diffuse, _, is_found = light_of_fill(fill, (front, view.camera), pixel, threads)
        diffuse = np.where(is_found[:, None], diffuse, ambient)
        texels[pixel] = front.bounce_albedo.reshape(-1, 3).take(pixel, axis=0) * diffuse
    return handed_on


def _moves(
    answered: Answered, frame: tuple[GBuffer, Camera], fill: Fill, threads: int | None
) -> tuple[FloatArray, float]:
    """Return how light has to move at the fill's pixels (h * w, 7), and the share that fireflies lost.

    What has to be added, by which share of itself light that is too bright is lowered (a sum would leave
    black spots where the rays' detail is dark), and 1 where that is known.
    """
    image = np.zeros((fill.depth.size, 7), dtype=answered.light.dtype)
    texel, level, share, passes = _at_fill(answered, frame, fill, threads)
    if texel.size:
        raw = answered.traced.reshape(-1, 3).take(texel, axis=0)
        samples = np.asarray(fill.samples).reshape(-1).take(texel)
        if fill.is_denoised:
            error = _DENOISED_ERROR / samples + _COARSE_ERROR
            _set_moves(image, texel, level, raw, _trust(error, share[:, 0], passes))
            return image, 0.0
        levels = _LEVELS + int(samples.min() < _FEW_SAMPLES)
        passes = np.minimum(passes, levels)

        def smooth(
            parts: list[FloatArray], variance: FloatArray, passes: NDArray[np.integer[Any]]
        ) -> list[FloatArray]:
            return filter_light(
                fill.surfaces, fill.camera, texel, parts, variance, passes, threads, geometric_levels=levels
            )

        mean, level, share = smooth([raw, level, share], np.zeros_like(raw[:, 0]), passes)
        limited = _without_fireflies(raw, mean)
        most = min(levels + _LUMINANCE_LEVELS, _MOST_LEVELS)
        (mean,) = smooth([limited], luminance(limited - mean) ** 2, np.where(passes < levels, passes, most))
        _set_moves(image, texel, level, mean, _trust(1.0 / samples, share[:, 0], passes))
        kept, whole = (float(luminance(part).sum(dtype=np.float64)) for part in (limited, raw))
        return image, 1.0 - kept / whole if whole else 0.0
    return image, 0.0


def _set_moves(
    image: FloatArray, texel: IntArray, level: FloatArray, mean: FloatArray, trust: FloatArray
) -> None:
    """Write into `image` how light at a level (T, 3) moves toward the mean that is trusted (T,) so far."""
    target = level + (mean - level) * trust[:, None]
    image[texel, :3] = np.maximum(target - level, 0.0)
    image[texel, 3:6] = np.maximum(level - target, 0.0) / np.maximum(level, np.float32(1e-20))
    image[texel, 6] = 1.0


def _trust(error: FloatArray, known: FloatArray, passes: NDArray[np.integer[Any]] | int) -> FloatArray:
    """Return the weight (N,) of a fill of a squared error beside answered light: inverse to both errors.

    A fill that fewer passes smooth is noisier, four times for each: what sharp mirrors show is as the rays
    found it, where they found it.
    """
    unknown = np.maximum(1.0 - known, 0.0)
    smoothed = np.asarray(0.25 ** np.maximum(_LEVELS - passes, 0), dtype=error.dtype)
    answered: FloatArray = _UNKNOWN_ERROR * unknown * unknown + _LEAST_ERROR * smoothed
    return answered / (answered + error)


def _at_fill(
    answered: Answered, frame: tuple[GBuffer, Camera], fill: Fill, threads: int | None
) -> tuple[IntArray, FloatArray, FloatArray, NDArray[np.int8]]:
    """Return the fill's pixels (T,) that the frame sees, with light (T, 3), known share (T, 1) and passes."""
    texel = np.flatnonzero(~fill.surfaces.is_background)
    # Pixels without rays are no part of the mean
    image = np.zeros((frame[0].depth.size, 6), dtype=answered.light.dtype)
    pixel = answered.pixel
    image[pixel, :3], image[pixel, 3] = answered.light, answered.known
    image[pixel, 4], image[pixel, 5] = answered.passes, 1.0
    (found,), _ = carry_over([image], frame, (fill.surfaces, fill.camera), texel, threads)
    seen = np.flatnonzero(found[:, 5] > 0.0)
    found = found.take(seen, axis=0)
    found[:, :5] /= found[:, 5:]
    return texel.take(seen), found[:, :3], found[:, 3:4], np.rint(found[:, 4]).astype(np.int8)


def _without_fireflies(light: FloatArray, around: FloatArray) -> FloatArray:
    """Return light (N, 3) without single pixels that outshine all around them.

    Few light paths find small bright things by rare luck: such a pixel is right on average and wrong alone.
    None keeps more luminance than 8 times that of the mean `around` it, (N, 3).
    """
    limit = _BRIGHTEST * luminance(around)
    scale = np.minimum(1.0, limit / np.maximum(luminance(light), np.float32(1e-20)))
    limited: FloatArray = light * scale[:, None]
    return limited
