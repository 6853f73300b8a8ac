# SPDX-License-Identifier: GPL-3.0-or-later
"""Edge-aware à-trous filter for the noise of few rays.

After Dammertz et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering",
with the variance guidance of Schied et al. 2017, "Spatiotemporal Variance-Guided Filtering" (section 4.4):
neighbours count by distance from the pixel's tangent plane, by normal, and by luminance difference in units
of the estimated noise, so that contact shadows stay where the noise does not explain them. The first passes
leave luminance out: single pixels of few rays are too far apart to be told from an edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import parallel
from .camera import Camera
from .frame_points import surface_points
from .gbuffer import GBuffer
from .light import luminance
from .types import BoolArray, FloatArray, IntArray

# A neighbour one pixel's footprint times this off the tangent plane no longer counts.
_PLANE_WIDTH = 1.0
# The cosine between normals counts to the power of 2 to this.
_NORMAL_SQUARINGS = 5
# Luminance differences count in units of this many standard deviations.
_LUMINANCE_WIDTH = 4.0
# Passes that leave luminance out.
GEOMETRIC_LEVELS = 3
# The variance of a pixel's few rays says nothing alone; over this radius it does. Pixels.
_NOISE_RADIUS = 3
_TAPS = [(dy, dx, (2 - abs(dy)) * (2 - abs(dx)) / 4.0) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy]


def filter_light(
    gbuffer: GBuffer,
    camera: Camera,
    signal: FloatArray,
    variance: FloatArray,
    levels: NDArray[np.integer[Any]],
    threads: int | None,
    geometric_levels: int = GEOMETRIC_LEVELS,
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
    geometric_levels
        The first passes, which leave luminance out.

    Returns
    -------
    (H, W, C)
        The smoothed signal; pixels with no level or no surface are unchanged.
    """
    guide = _Guide.of(gbuffer, camera)
    height, width = gbuffer.shape
    for level in range(int(levels.max(initial=0))):
        is_active = (levels > level) & ~gbuffer.is_background
        smoothing = _Pass(guide, signal, variance, is_active, 1 << level, level >= geometric_levels)
        rows = parallel.split(np.arange(height), max(1, 65536 // width))
        parallel.run_chunks(smoothing.filter_rows, rows, threads)
        signal, variance = smoothing.smooth, smoothing.remaining
    return signal


def filter_pixels(
    gbuffer: GBuffer,
    camera: Camera,
    signal: FloatArray,
    pixel: IntArray,
    variance: FloatArray,
    levels: NDArray[np.integer[Any]] | int,
    threads: int | None,
    geometric_levels: int = GEOMETRIC_LEVELS,
) -> FloatArray:
    """Smooth the light (P, C) of some of an image's pixels, as `filter_light` does for all.

    Parameters
    ----------
    pixel : (P,)
        Flat indices of the pixels.
    signal, variance, levels : (P, C), (P,), (P,) or a number
        As for `filter_light`; the other pixels take no part.
    """
    height, width = gbuffer.shape
    level_map = np.zeros(height * width, dtype=np.int8)
    level_map[pixel] = levels
    images = []
    for values in (signal, variance):
        image = np.zeros((height * width, *values.shape[1:]), dtype=values.dtype)
        image[pixel] = values
        images.append(image.reshape(height, width, *values.shape[1:]))
    light, noise = images
    smooth = filter_light(
        gbuffer, camera, light, noise, level_map.reshape(height, width), threads, geometric_levels
    )
    return smooth.reshape(height * width, -1).take(pixel, axis=0)


@dataclass(frozen=True, eq=False)
class _Guide:
    """What tells surfaces apart: positions and normals (3, H, W), and 1 / the size of a pixel there."""

    position: FloatArray
    normal: FloatArray
    per_footprint: FloatArray

    @classmethod
    def of(cls, gbuffer: GBuffer, camera: Camera) -> _Guide:
        height, width = gbuffer.shape
        is_background = gbuffer.is_background
        with np.errstate(invalid="ignore"):  # on the optical axis a point of the background is no number
            position, normal = surface_points(gbuffer, camera, np.arange(height * width))
        position = np.where(is_background.reshape(-1), 0.0, position).reshape(3, height, width)
        scale = 1.0 if camera.is_orthographic else np.where(is_background, np.inf, gbuffer.depth)
        per_footprint = np.broadcast_to(max(camera.fx, camera.fy) / scale, (height, width))
        dtype = gbuffer.depth.dtype
        return cls(position.astype(dtype), normal.reshape(3, height, width), per_footprint.astype(dtype))


class _Pass:
    """One à-trous pass: what it reads, and `smooth` and `remaining`, which it fills row by row."""

    def __init__(
        self,
        guide: _Guide,
        signal: FloatArray,
        variance: FloatArray,
        is_active: BoolArray,
        step: int,
        uses_luminance: bool,
    ) -> None:
        self.guide, self.signal, self.variance = guide, signal, variance
        self.is_active, self.step, self.uses_luminance = is_active, step, uses_luminance
        self.smooth, self.remaining = np.empty_like(signal), np.empty_like(variance)
        if uses_luminance:
            self.brightness = luminance(signal[..., :3])
            noise = _LUMINANCE_WIDTH * np.sqrt(local_mean(variance))
            self.inverse_noise = 1.0 / (noise + 1e-6 * self.brightness + 1e-20)

    def filter_rows(self, rows: IntArray) -> None:
        """Filter a band of consecutive rows."""
        band = slice(int(rows[0]), int(rows[-1]) + 1)
        height, width = self.variance.shape
        total = np.ones_like(self.variance[band])
        value = self.signal[band].copy()
        squared = self.variance[band].copy()
        for dy, dx, kernel in _TAPS:
            down, right = dy * self.step, dx * self.step
            y = slice(max(band.start, -down), min(band.stop, height - down))
            x = slice(max(0, -right), min(width, width - right))
            if y.start >= y.stop or x.start >= x.stop:
                continue
            here = (y, x)
            there = (slice(y.start + down, y.stop + down), slice(x.start + right, x.stop + right))
            inner = (slice(y.start - band.start, y.stop - band.start), x)
            weight = kernel * self._similarity(here, there)
            total[inner] += weight
            value[inner] += weight[..., None] * self.signal[there]
            squared[inner] += weight * weight * self.variance[there]
        inverse = 1.0 / total
        self.smooth[band] = value * inverse[..., None]
        self.remaining[band] = squared * inverse * inverse

    def _similarity(self, here: tuple[slice, slice], there: tuple[slice, slice]) -> FloatArray:
        """Return how much the pixels `there` count for those `here`, 0..1."""
        guide = self.guide
        off_plane = np.zeros(self.variance[here].shape, dtype=self.variance.dtype)
        aligned = np.zeros_like(off_plane)
        for position, normal in zip(guide.position, guide.normal, strict=True):
            off_plane += (position[there] - position[here]) * normal[here]
            aligned += normal[there] * normal[here]
        weight = np.maximum(aligned, 0.0)
        for _ in range(_NORMAL_SQUARINGS):
            np.multiply(weight, weight, out=weight)
        distance = np.abs(off_plane) * guide.per_footprint[here] * (1.0 / (_PLANE_WIDTH * self.step))
        weight *= np.maximum(1.0 - distance, 0.0)
        if self.uses_luminance:
            contrast = np.abs(self.brightness[there] - self.brightness[here]) * self.inverse_noise[here]
            weight *= np.maximum(1.0 - contrast, 0.0)
        weight *= self.is_active[here] & self.is_active[there]
        return weight


def local_mean(image: FloatArray) -> FloatArray:
    """Return the mean over squares of ``2 * _NOISE_RADIUS + 1`` pixels, edges repeated."""
    side = 2 * _NOISE_RADIUS + 1
    for axis in (0, 1):
        padding = [(_NOISE_RADIUS, _NOISE_RADIUS) if axis == other else (0, 0) for other in (0, 1)]
        padded = np.pad(image, padding, mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, side, axis=axis)
        image = windows.mean(axis=-1, dtype=image.dtype)
    return image
