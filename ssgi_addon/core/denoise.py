# SPDX-License-Identifier: GPL-3.0-or-later
"""Edge-aware à-trous filter for the noise of few rays.

After Dammertz et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering",
with the variance guidance of Schied et al. 2017, "Spatiotemporal Variance-Guided Filtering" (section 4.4):
neighbours count by distance from the pixel's tangent plane, by normal, and by luminance difference in units
of the estimated noise, so that contact shadows stay where the noise does not explain them. The first passes
leave luminance out: single pixels of few rays are too far apart to be told from an edge.
"""

from __future__ import annotations

import numpy as np

from . import parallel
from .camera import Camera
from .frame_points import surface_points
from .gbuffer import GBuffer
from .light import luminance
from .types import FloatArray, IntArray

# A neighbour one pixel's footprint times this off the tangent plane no longer counts.
_PLANE_WIDTH = 1.0
_NORMAL_POWER = 32
# Luminance differences count in units of this many standard deviations.
_LUMINANCE_WIDTH = 4.0
# Passes that leave luminance out.
_GEOMETRIC_LEVELS = 3
# The variance of a pixel's few rays says nothing alone; over this radius it does. Pixels.
_NOISE_RADIUS = 3
_TAPS = [(dy, dx, (2 - abs(dy)) * (2 - abs(dx)) / 4.0) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy]


def filter_light(
    gbuffer: GBuffer,
    camera: Camera,
    signal: FloatArray,
    variance: FloatArray,
    levels: FloatArray,
    threads: int | None,
) -> FloatArray:
    """Smooth noisy light along surfaces.

    Parameters
    ----------
    gbuffer, camera
        Depth and normals that guide the filter, and the size of a pixel.
    signal : (H, W, C)
        Light to smooth; its first three channels are RGB and steer the luminance weight.
    variance : (H, W)
        Variance of the luminance of `signal`.
    levels : (H, W)
        Filter passes that each pixel takes part in, 0..5; the k-th reaches 2**k pixels.

    Returns
    -------
    (H, W, C)
        The smoothed signal; pixels with no level or no surface are unchanged.
    """
    height, width = gbuffer.shape
    everywhere = np.arange(height * width)
    with np.errstate(invalid="ignore"):  # on the optical axis a point of the background is no number
        position, normal = surface_points(gbuffer, camera, everywhere)
    is_background = gbuffer.is_background
    position = np.where(is_background.reshape(-1), 0.0, position).reshape(3, height, width)
    normal = normal.reshape(3, height, width)
    footprint = -position[2] / max(camera.fx, camera.fy) if not camera.is_orthographic else 1.0 / camera.fx
    with np.errstate(divide="ignore"):
        per_footprint = np.where(is_background, 0.0, 1.0 / footprint)
    guide = (position, normal, per_footprint.astype(signal.dtype))
    for level in range(int(levels.max(initial=0))):
        smooth = np.empty_like(signal)
        remaining = np.empty_like(variance)
        noise = None if level < _GEOMETRIC_LEVELS else _local_mean(variance)
        is_active = (levels > level) & ~is_background

        def work(rows: IntArray, signal=signal, variance=variance, smooth=smooth, remaining=remaining, noise=noise,
                 is_active=is_active, step=1 << level) -> None:
            band = slice(rows[0], rows[-1] + 1)
            smooth[band], remaining[band] = _filter_rows(signal, variance, noise, guide, is_active, band, step)

        parallel.run_chunks(work, parallel.split(np.arange(height), max(1, 65536 // width)), threads)
        signal, variance = smooth, remaining
    return signal


def _filter_rows(
    signal: FloatArray,
    variance: FloatArray,
    noise: FloatArray | None,
    guide: tuple[FloatArray, FloatArray, FloatArray],
    is_active: FloatArray,
    band: slice,
    step: int,
) -> tuple[FloatArray, FloatArray]:
    """Return one à-trous pass over a band of rows, and the variance that remains."""
    height, width = variance.shape
    position, normal, per_footprint = guide
    centre_signal = signal[band]
    brightness = luminance(signal[..., :3])
    if noise is not None:
        inverse_noise = 1.0 / (_LUMINANCE_WIDTH * np.sqrt(noise[band]) + 1e-6 * brightness[band] + 1e-20)
    total = np.ones_like(variance[band])
    value = centre_signal.copy()
    squared = variance[band].copy()
    for dy, dx, kernel in _TAPS:
        top, bottom = max(band.start, -dy * step), min(band.stop, height - dy * step)
        left, right = max(0, -dx * step), min(width, width - dx * step)
        if top >= bottom or left >= right:
            continue
        here = (slice(top, bottom), slice(left, right))
        there = (slice(top + dy * step, bottom + dy * step), slice(left + dx * step, right + dx * step))
        inner = (slice(top - band.start, bottom - band.start), slice(left, right))
        off_plane = np.zeros(variance[here].shape, dtype=variance.dtype)
        aligned = np.zeros_like(off_plane)
        for axis in range(3):
            off_plane += (position[axis][there] - position[axis][here]) * normal[axis][here]
            aligned += normal[axis][there] * normal[axis][here]
        distance = np.abs(off_plane) * per_footprint[here] * (1.0 / (_PLANE_WIDTH * step))
        weight = kernel * np.maximum(aligned, 0.0) ** _NORMAL_POWER
        weight *= np.maximum(1.0 - distance, 0.0)
        if noise is not None:
            contrast = np.abs(brightness[there] - brightness[here]) * inverse_noise[inner]
            weight *= np.maximum(1.0 - contrast, 0.0)
        weight *= is_active[here] & is_active[there]
        total[inner] += weight
        value[inner] += weight[..., None] * signal[there]
        squared[inner] += weight * weight * variance[there]
    inverse = 1.0 / total
    return value * inverse[..., None], squared * inverse * inverse


def _local_mean(image: FloatArray) -> FloatArray:
    """Return the mean over squares of ``2 * _NOISE_RADIUS + 1`` pixels, edges repeated."""
    side = 2 * _NOISE_RADIUS + 1
    padded = np.pad(image, _NOISE_RADIUS, mode="edge")
    rows = sum(padded[shift : shift + image.shape[0]] for shift in range(side))
    return sum(rows[:, shift : shift + image.shape[1]] for shift in range(side)) * (1.0 / (side * side))
