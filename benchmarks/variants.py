# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that benchmarks compare, named by texts, and figures that they share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from ssgi_addon.core.metrics import bias, relative_squared_error, relmse, trimmed_mean
from ssgi_addon.core.types import BoolArray, FloatArray

SettingsT = TypeVar("SettingsT")


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


def relmse_without_noise(image: FloatArray, halves: FloatArray, mask: BoolArray) -> float:
    """Return the relMSE of an image as a reference without noise would give it, over the pixels of the mask.

    The halves' noise is independent, so that of ``(v - h1) * (v - h2)`` has the mean 0. Its scale is that of
    `metrics.relmse`, and as there the worst pixels are left out. What noise there is in the scale, the mean
    of both, stays in it. Below 0 where nothing but noise is left.

    Parameters
    ----------
    image : (H, W, 3)
        Scene-linear light.
    halves : (2, H, W, 3)
        The reference, in halves that differ by noise alone.
    mask : (H, W) bool
        The pixels to count; the mean of the reference still runs over all.
    """
    mean = halves.mean(axis=0)
    # (v - h1)(v - h2) = (v - r)^2 - (h1 - r)^2, with r the mean of both
    errors = relative_squared_error(image, mean) - relative_squared_error(halves[0], mean)
    return trimmed_mean(errors.mean(axis=-1)[mask])


def geometric_mean(values: Sequence[float]) -> float:
    """Return the geometric mean of positive values."""
    return float(np.exp(np.log(values).mean()))
