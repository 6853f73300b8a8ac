# SPDX-License-Identifier: GPL-3.0-or-later
"""Per-pixel error as colour, on one fixed scale, so that pictures of different scenes compare."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .core.metrics import relative_squared_error

#: Errors at and below the first are the ramp's dark end, at and above the second its bright end.
ERROR_RANGE = (1e-3, 1e1)

# The ramp in Oklch: lightness rises evenly from near black to near white, so that it also reads in
# grey; the hue turns from blue through red to yellow; the chroma stays inside sRGB everywhere.
_LIGHTNESS = (0.16, 0.97)
_HUE_DEGREES = (272.0, 462.0)
_CHROMA_KNOTS = (0.0, 0.25, 0.55, 0.8, 1.0)
_CHROMA = (0.045, 0.165, 0.205, 0.135, 0.055)
_RAMP_SIZE = 512

# Oklab to linear sRGB (B. Ottosson, "A perceptual color space for image processing", 2020).
_LMS_FROM_OKLAB = np.array(
    [
        [1.0, 0.3963377774, 0.2158037573],
        [1.0, -0.1055613458, -0.0638541728],
        [1.0, -0.0894841775, -1.2914855480],
    ]
)
_SRGB_FROM_LMS = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)


def error_map(image: npt.ArrayLike, reference: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """Colour each pixel by its share of the relative mean squared error.

    The error is the one that `relmse` averages, its mean over the channels; the colour runs along
    its logarithm over `ERROR_RANGE` and is clamped outside.

    Parameters
    ----------
    image, reference : (H, W, 3)
        Scene-linear pictures of one size.

    Returns
    -------
    (H, W, 3) uint8
        sRGB. An infinite error, any light where the reference is black throughout, takes the bright end.

    Raises
    ------
    ValueError
        If the shapes differ or are not ``(H, W, 3)``, or a picture holds something non-finite.
    """
    return color_errors(relative_squared_error(image, reference).mean(axis=-1))


def color_errors(error: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """Map errors of any shape, not NaN, to sRGB colours of the ramp, ``(..., 3)`` uint8."""
    lowest, highest = ERROR_RANGE
    decades = np.log10(np.clip(np.asarray(error, dtype=np.float64), lowest, highest) / lowest)
    position = decades / math.log10(highest / lowest)
    return _RAMP[np.rint(position * (_RAMP_SIZE - 1)).astype(np.intp)]


def legend_bar(width: int, height: int) -> npt.NDArray[np.uint8]:
    """The ramp from the smallest to the largest error, left to right, ``(height, width, 3)``."""
    lowest, highest = ERROR_RANGE
    return np.tile(color_errors(np.geomspace(lowest, highest, width)), (height, 1, 1))


def legend_labels() -> list[tuple[float, str]]:
    """Places along the ramp (0 to 1) and texts of its whole decades."""
    first, last = (round(math.log10(end)) for end in ERROR_RANGE)
    return [((decade - first) / (last - first), f"{10.0**decade:g}") for decade in range(first, last + 1)]


def _build_ramp() -> npt.NDArray[np.uint8]:
    position = np.linspace(0.0, 1.0, _RAMP_SIZE)
    hue = np.radians(np.interp(position, (0.0, 1.0), _HUE_DEGREES))
    chroma = np.interp(position, _CHROMA_KNOTS, _CHROMA)
    lightness = np.interp(position, (0.0, 1.0), _LIGHTNESS)
    oklab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=-1)

    lms = (oklab @ _LMS_FROM_OKLAB.T) ** 3
    linear = np.clip(lms @ _SRGB_FROM_LMS.T, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.rint(encoded * 255.0).astype(np.uint8)


_RAMP = _build_ramp()
