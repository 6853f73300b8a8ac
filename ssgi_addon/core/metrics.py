# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a picture is from its reference: relMSE, bias, SSIM and FLIP, over all pixels or a part of them.

relMSE and bias read scene-linear radiance. SSIM and FLIP model what a viewer sees, so they read the
display-referred picture that `display_referred` makes. All sums run in float64.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from typing import Any

import numpy as np

from .types import BoolArray, FloatArray

# Keeps the relative error of dark pixels finite; small against the mean brightness squared.
DARK_SHARE = 0.01
TRIM = 0.001

# Wang et al., "Image quality assessment: from error visibility to structural similarity" (2004), section III.
SSIM_RADIUS = 5
SSIM_SIGMA = 1.5
SSIM_C1 = 0.01**2
SSIM_C2 = 0.03**2

KNOWN_ENOUGH = 0.9

# 1/depth is linear in the image across a plane, so its second difference is 0 there at any tilt. A crease of
# 90 degrees seen at 64 pixels width stays below this share of 1/depth; a step of 5 % in depth reaches it.
DEPTH_EDGE = 0.05


def relative_squared_error(image: FloatArray, reference: FloatArray) -> FloatArray:
    """Return (v - r)^2 / (r^2 + 0.01 mean(r)^2) for every value.

    Parameters
    ----------
    image, reference : (H, W) or (H, W, 3)
        Scene-linear pictures of one shape.

    Returns
    -------
    (H, W) or (H, W, 3) float64
        The mean of r runs over all pixels and channels. 0 where both pictures are black throughout.

    Raises
    ------
    ValueError
        If the shapes differ, or a picture holds something non-finite.
    """
    v, r = _pair(image, reference)
    squared = (v - r) ** 2
    scale = r**2 + DARK_SHARE * r.mean() ** 2
    # A reference that is black throughout has no brightness to relate to: any light there is infinitely off.
    with np.errstate(divide="ignore"):
        return np.divide(squared, scale, out=np.zeros_like(squared), where=squared > 0.0)


def relmse(
    image: FloatArray, reference: FloatArray, *, trim: float = TRIM, mask: BoolArray | None = None
) -> float:
    """Mean relative squared error without the worst pixels.

    A pixel's error is the mean of `relative_squared_error` over its channels. The share `trim` of the
    pixels with the largest errors, rounded down to whole pixels, is left out: a few fireflies would
    otherwise decide the figure. ``trim=0`` keeps every pixel.

    Parameters
    ----------
    image, reference : (H, W) or (H, W, 3)
        Scene-linear pictures of one shape.
    trim
        Share of the pixels to leave out, 0 <= trim < 1.
    mask : (H, W) bool, optional
        The pixels to count; the mean of the reference still runs over all. NaN where none is True.

    Raises
    ------
    ValueError
        If shapes differ, `trim` is out of range, or a picture holds something non-finite.
    """
    return trimmed_mean(_selected(_per_pixel(relative_squared_error(image, reference)), mask), trim)


def trimmed_mean(errors: FloatArray, trim: float = TRIM) -> float:
    """Mean of (N,) errors without the largest ones, as `relmse` leaves them out; NaN of none.

    Raises
    ------
    ValueError
        If `trim` is out of range.
    """
    if not 0.0 <= trim < 1.0:
        raise ValueError(f"trim: expected a share from 0 up to, not including, 1, got {trim!r}")
    kept = errors.size - math.floor(trim * errors.size)
    return _mean(np.partition(errors, kept - 1)[:kept]) if errors.size else math.nan


def bias(image: FloatArray, reference: FloatArray, *, mask: BoolArray | None = None) -> float:
    """Mean of image - reference over pixels and channels, scene-linear radiance; negative: too dark.

    Parameters and errors are those of `relmse`.
    """
    v, r = _pair(image, reference)
    return _mean(_selected(_per_pixel(v - r), mask))


def ssim(
    image: FloatArray, reference: FloatArray, *, mask: BoolArray | None = None, exposure: float = 0.0
) -> float:
    """Structural similarity of the display-referred pictures, 1 = equal.

    Wang et al. 2004: Gaussian window of 11 x 11 pixels, sigma 1.5, K1 = 0.01, K2 = 0.03, range 1; the
    mean of the channels. Pictures are mirrored at their borders, so every pixel counts.

    Parameters
    ----------
    image, reference : (H, W) or (H, W, 3)
        Scene-linear pictures of one shape.
    mask : (H, W) bool, optional
        The pixels to count; their windows may reach beyond.
    exposure
        Stops of `display_referred`.

    Raises
    ------
    ValueError
        If shapes differ, or a picture holds something non-finite.
    """
    return _mean(_selected(ssim_map(image, reference, exposure=exposure), mask))


def ssim_map(image: FloatArray, reference: FloatArray, *, exposure: float = 0.0) -> FloatArray:
    """(H, W) of the values that `ssim` averages."""
    v, r = (display_referred(picture, exposure) for picture in _pair(image, reference))
    mean_v, mean_r = _blur(v), _blur(r)
    variance_v = _blur(v * v) - mean_v**2
    variance_r = _blur(r * r) - mean_r**2
    covariance = _blur(v * r) - mean_v * mean_r
    luminance = (2.0 * mean_v * mean_r + SSIM_C1) / (mean_v**2 + mean_r**2 + SSIM_C1)
    structure = (2.0 * covariance + SSIM_C2) / (variance_v + variance_r + SSIM_C2)
    return _per_pixel(luminance * structure)


def flip(
    image: FloatArray, reference: FloatArray, *, mask: BoolArray | None = None, exposure: float = 0.0
) -> float | None:
    """Mean FLIP error of the display-referred pictures, 0 = equal.

    Andersson et al., "FLIP: A Difference Evaluator for Alternating Images" (2020), by NVIDIA's evaluator
    at its default viewing distance (67 pixels per degree); None where `flip_evaluator` is not installed.
    Parameters and errors are those of `ssim`.
    """
    error = flip_map(image, reference, exposure=exposure)
    return None if error is None else _mean(_selected(error, mask))


def flip_map(image: FloatArray, reference: FloatArray, *, exposure: float = 0.0) -> FloatArray | None:
    """(H, W) of the values that `flip` averages; None without the evaluator."""
    v, r = (display_referred(picture, exposure) for picture in _pair(image, reference))
    if importlib.util.find_spec("flip_evaluator") is None:
        return None
    evaluator: Any = importlib.import_module("flip_evaluator")
    pictures = [np.ascontiguousarray(_as_rgb(picture), dtype=np.float32) for picture in (r, v)]
    error, _, _ = evaluator.evaluate(*pictures, "LDR", inputsRGB=True, applyMagma=False)
    return _per_pixel(np.asarray(error, dtype=np.float64))


def compare_images(
    image: FloatArray, reference: FloatArray, *, mask: BoolArray | None = None, exposure: float = 0.0
) -> dict[str, float | None]:
    """Return `relmse`, `bias`, `ssim` and `flip` by name; None for what cannot be said.

    Parameters
    ----------
    image, reference : (H, W) or (H, W, 3)
        Scene-linear pictures of one shape.
    mask : (H, W) bool, optional
        The pixels to count; every figure is None where it is False throughout.
    exposure
        Stops of `display_referred`, for SSIM and FLIP.

    Returns
    -------
    dict of float or None
        ``relmse``, ``bias`` (radiance), ``ssim`` (1 is equal) and ``flip`` (0 is equal).

    Raises
    ------
    ValueError
        If shapes differ, or a picture holds something non-finite.
    """
    values = {
        "relmse": relmse(image, reference, mask=mask),
        "bias": bias(image, reference, mask=mask),
        "ssim": ssim(image, reference, mask=mask, exposure=exposure),
        "flip": flip(image, reference, mask=mask, exposure=exposure),
    }
    return {
        name: None if value is None or not math.isfinite(value) else value for name, value in values.items()
    }


def pixel_subsets(depth: FloatArray, known: FloatArray) -> dict[str, BoolArray]:
    """Split a frame by what a screen-space method could see there.

    Parameters
    ----------
    depth : (H, W)
        Distance along the view axis; +inf on background.
    known : (H, W)
        Share of a pixel's samples that could be answered, 0..1.

    Returns
    -------
    dict of (H, W) bool
        ``all``; ``known``: at least 0.9 answered; ``silhouettes``: within 1 pixel of a depth edge; ``rest``:
        in neither of the two.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    if np.shape(known) != np.shape(depth) or np.ndim(depth) != 2:
        raise ValueError(f"known: expected the shape of depth {np.shape(depth)}, got {np.shape(known)}")
    is_known = np.asarray(known) >= KNOWN_ENOUGH
    is_silhouette = find_silhouettes(depth)
    return {
        "all": np.ones(np.shape(depth), bool),
        "known": is_known,
        "silhouettes": is_silhouette,
        "rest": ~(is_known | is_silhouette),
    }


def find_silhouettes(depth: FloatArray) -> BoolArray:
    """(H, W) True within 1 pixel of a depth edge of `depth`, (H, W), +inf on background."""
    q = np.divide(1.0, np.asarray(depth, np.float64))
    padded = np.pad(q, 1, mode="edge")
    is_edge = np.zeros(q.shape, bool)
    for before, after in ((padded[1:-1, :-2], padded[1:-1, 2:]), (padded[:-2, 1:-1], padded[2:, 1:-1])):
        bend = np.abs(before - 2.0 * q + after)
        is_edge |= bend > DEPTH_EDGE * np.maximum(np.maximum(before, after), q)
    # Beyond the border the last pixel is repeated, which bends every slanted plane there; ask its neighbour.
    is_edge[[0, -1], :] = False
    is_edge[:, [0, -1]] = False
    grown = np.pad(is_edge, 1)
    height, width = q.shape
    is_near = np.zeros(q.shape, bool)
    for y, x in np.ndindex(3, 3):
        is_near |= grown[y : y + height, x : x + width]
    return is_near


def display_referred(image: FloatArray, exposure: float = 0.0) -> FloatArray:
    """Scene-linear light as a plain sRGB display shows it: ``2**exposure``, clipped to 0..1, sRGB curve.

    Parameters
    ----------
    image
        Scene-linear light of any shape.
    exposure
        Stops.

    Returns
    -------
    float64
        Of the same shape, 0 to 1.
    """
    clipped = np.clip(np.asarray(image, np.float64) * 2.0**exposure, 0.0, 1.0)
    encoded: FloatArray = np.where(
        clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055
    )
    return encoded


def _pair(image: FloatArray, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
    with np.errstate(invalid="ignore"):  # files may hold any kind of NaN, which is refused below
        v, r = np.asarray(image, np.float64), np.asarray(reference, np.float64)
    if v.shape != r.shape:
        raise ValueError(f"image: expected the shape of the reference {r.shape}, got {v.shape}")
    if v.ndim not in (2, 3) or 0 in v.shape:
        raise ValueError(f"image: expected (H, W) or (H, W, C), got {v.shape}")
    for name, picture in (("image", v), ("reference", r)):
        bad = picture.size - np.count_nonzero(np.isfinite(picture))
        if bad:
            raise ValueError(f"{name}: expected finite values, got {bad} that are not")
    return v, r


def _per_pixel(values: FloatArray) -> FloatArray:
    return values.mean(axis=-1) if values.ndim == 3 else values


def _as_rgb(picture: FloatArray) -> FloatArray:
    return picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=-1)


def _selected(values: FloatArray, mask: BoolArray | None) -> FloatArray:
    if mask is None:
        return values.reshape(-1)
    if mask.shape != values.shape or mask.dtype != np.bool_:
        raise ValueError(f"mask: expected bool {values.shape}, got {mask.dtype} {mask.shape}")
    return values[mask]


def _mean(values: FloatArray) -> float:
    return float(values.mean(dtype=np.float64)) if values.size else math.nan


def _blur(values: FloatArray) -> FloatArray:
    """Gaussian of SSIM_SIGMA over rows and columns, mirrored at the borders."""
    offsets = np.arange(-SSIM_RADIUS, SSIM_RADIUS + 1)
    weights = np.exp(-0.5 * (offsets / SSIM_SIGMA) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        margin = [(SSIM_RADIUS, SSIM_RADIUS) if a == axis else (0, 0) for a in range(values.ndim)]
        padded = np.pad(values, margin, mode="symmetric")
        rows = np.arange(values.shape[axis])
        values = np.zeros_like(values)
        for first, weight in enumerate(weights):
            values += weight * padded.take(rows + first, axis=axis)
    return values
