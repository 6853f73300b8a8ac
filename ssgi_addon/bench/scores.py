# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a picture is from the reference, over all pixels and over parts of them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ..core.metrics import display_referred, flip_map, relative_squared_error, ssim_map, trimmed_mean
from ..core.types import BoolArray, FloatArray

Scores = dict[str, dict[str, float | None]]

METRICS = ("relmse", "relmse_untrimmed", "bias", "ssim", "flip")
SUBSETS = ("all", "known", "silhouettes", "rest")
# What is compared: the finished picture; its indirect light in the reference's direct light; the passes
TARGETS = ("picture", "replaced", "diffuse", "glossy")


def score(
    image: FloatArray, reference: FloatArray, subsets: Mapping[str, BoolArray], exposure: float
) -> Scores:
    """Return each metric over each part of the pixels.

    Parameters
    ----------
    image, reference : (H, W, 3)
        Scene-linear.
    subsets : dict of (H, W) bool
        By name, as `core.metrics.pixel_subsets` makes them.
    exposure
        Stops, for what models a viewer: SSIM and FLIP.

    Returns
    -------
    dict of dict
        By subset and metric: relMSE without and with the worst pixels, bias, SSIM, FLIP; None where a part
        holds no pixel, or the evaluator is not installed.
    """
    squared = relative_squared_error(image, reference).mean(axis=-1)
    signed = (np.asarray(image, np.float64) - reference).mean(axis=-1)
    similar = ssim_map(image, reference, exposure=exposure)
    flipped = flip_map(image, reference, exposure=exposure)
    found: Scores = {}
    for name, mask in subsets.items():
        errors = squared[mask]
        values = (
            trimmed_mean(errors),
            trimmed_mean(errors, 0.0),
            _mean(signed[mask]),
            _mean(similar[mask]),
            None if flipped is None else _mean(flipped[mask]),
        )
        found[name] = {metric: _finite(value) for metric, value in zip(METRICS, values, strict=True)}
    return found


def own_error(halves: FloatArray) -> float:
    """Return the relMSE of the mean of two halves of a reference, (2, H, W, 3), from what they differ by.

    With independent noise the mean of both has a quarter of the squared difference.
    """
    mean = halves.mean(axis=0, dtype=np.float64)
    half_difference = 0.5 * (np.asarray(halves[0], np.float64) - halves[1])
    return trimmed_mean(relative_squared_error(mean + half_difference, mean).mean(axis=-1).reshape(-1))


def flicker(images: FloatArray, references: FloatArray, exposure: float) -> float:
    """Return the RMS of the frame-to-frame change of the error, display-referred, in 1/255.

    Parameters
    ----------
    images, references : (N, H, W, 3)
        Frames of one camera move, scene-linear.
    exposure
        Stops.
    """
    errors = display_referred(images, exposure) - display_referred(references, exposure)
    return 255.0 * math.sqrt(float(np.mean(np.diff(errors, axis=0) ** 2)))


def _mean(values: FloatArray) -> float:
    return float(values.mean(dtype=np.float64)) if values.size else math.nan


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value
