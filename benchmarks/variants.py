# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that benchmarks compare, named by texts, and figures that they share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from ssgi_addon.core.metrics import DARK_SHARE, bias, relmse, trimmed_mean
from ssgi_addon.core.types import BoolArray, FloatArray

SettingsT = TypeVar("SettingsT")

# Pixels around one whose mean tells how bright a noisy reference is there: 25 of them (living_room at 128
# samples, diffuse light with and without a surround: 0.25 and 0.43; 0.37 and 0.24 of the pixel alone, where
# half of the error came from pixels that noise made dark; 0.26 and 0.44 of 49 pixels).
SCALE_RADIUS = 2


def parse_variant(text: str, base: SettingsT) -> SettingsT:
    """Return the settings `base` but for what a text like ``rays=1,filter=false`` names.

    Parameters
    ----------
    text
        Names and values of fields.
    base
        Settings of one pass.

    Raises
    ------
    argparse.ArgumentTypeError
        If there is no such field, or a value is none of its values.
    """
    defaults = {item.name: item.default for item in fields(base)}
    changes: dict[str, Any] = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        if name not in defaults:
            raise argparse.ArgumentTypeError(
                f"{name!r} is none of {type(base).__name__}: {', '.join(defaults)}"
            )
        try:
            changes[name] = _converted(value, defaults[name])
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"{part!r}: {error}") from error
    try:
        return replace(base, **changes)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _converted(text: str, default: Any) -> Any:
    if default is None:
        return int(text)  # of the settings, only whole numbers may be missing
    if not isinstance(default, bool):
        return type(default)(text)
    if text not in ("true", "false"):
        raise ValueError("expected true or false")
    return text == "true"


def relative_bias(light: FloatArray, truth: FloatArray, mask: BoolArray) -> float:
    """Return the bias relative to the mean of the truth, over the pixels of the mask."""
    return bias(light, truth, mask=mask) / float(truth[mask].mean(dtype=np.float64))


def noise_of(halves: FloatArray, mask: BoolArray) -> float:
    """Return what the noise of a reference adds to every relMSE, over the pixels of the mask.

    The reference is the mean of two halves ``(2, H, W, 3)`` of independent noise. Each differs from it by
    half of their difference, whose mean square is the variance of the mean.
    """
    return relmse(halves[0], halves.mean(axis=0), mask=mask)


def relmse_without_noise(
    image: FloatArray, halves: FloatArray, mask: BoolArray, radius: int = SCALE_RADIUS
) -> float:
    """Return the relMSE of an image as a reference without noise would give it, over the pixels of the mask.

    The halves' noise is independent, so that of ``(v - h1) * (v - h2)`` has the mean 0. It is divided by
    ``r^2 + 0.01 mean(r)^2`` and the worst pixels are left out, as in `metrics.relmse`; but r is a mean over
    neighbours. Where the noise of a single pixel makes the reference dark, its small r would give whatever is
    brighter far too much weight, and call dark images better than right ones.

    Parameters
    ----------
    image : (H, W, 3)
        Scene-linear light.
    halves : (2, H, W, 3)
        The reference, in halves that differ by noise alone.
    mask : (H, W) bool
        The pixels to count; the mean of the reference still runs over all.
    radius
        Of the square of neighbours, pixels, of which those of the mask count; 0 takes the pixel alone.

    Returns
    -------
    float
        About 0, on either side, where nothing but noise is left.
    """
    v, first, second = (np.asarray(picture, np.float64) for picture in (image, *halves))
    mean = 0.5 * (first + second)
    scale = _local_mean(mean, mask, radius) ** 2 + DARK_SHARE * mean.mean() ** 2
    return trimmed_mean(((v - first) * (v - second) / scale).mean(axis=-1)[mask])


def _local_mean(image: FloatArray, mask: BoolArray, radius: int) -> FloatArray:
    """Return the mean (H, W, 3) over squares of an image's pixels that are in the mask."""
    height, width = mask.shape
    margin = ((radius, radius), (radius, radius), (0, 0))
    counts = np.pad(mask[..., None].astype(np.float64), margin)
    values = np.pad(image, margin) * counts
    total, count = np.zeros_like(image), np.zeros((height, width, 1))
    for y, x in np.ndindex(2 * radius + 1, 2 * radius + 1):
        total += values[y : y + height, x : x + width]
        count += counts[y : y + height, x : x + width]
    mean: FloatArray = total / np.maximum(count, 1.0)
    return mean


def geometric_mean(values: Sequence[float]) -> float:
    """Return the geometric mean of positive values."""
    return float(np.exp(np.log(values).mean()))
