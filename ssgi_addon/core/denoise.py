# SPDX-License-Identifier: GPL-3.0-or-later
"""Edge-aware à-trous filter for the noise of few rays.

After Dammertz et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering",
with the variance guidance of Schied et al. 2017, "Spatiotemporal Variance-Guided Filtering" (section 4.4):
neighbours count by distance from the pixel's tangent plane, by normal, and by luminance difference in units
of the estimated noise, so that contact shadows stay where the noise does not explain them. The first passes
leave luminance out: single pixels of few rays are too far apart to be told from an edge.

Rows that hold nothing to smooth cost nothing: a sky, or what only the deeper passes are for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import parallel
from .camera import Camera
from .gbuffer import GBuffer
from .planes import PlaneLayout, box_around
from .types import FloatArray, IntArray

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
# In place of no noise on black; far below the squares of light that anybody renders.
_NO_NOISE = 1e-30
_TAPS = [(dy, dx, (2 - abs(dy)) * (2 - abs(dx)) / 4.0) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy]
_LUMINANCE = (0.2126, 0.7152, 0.0722)
# Small enough that a pass can leave out the bands that have nothing for it.
_PIXELS_PER_BAND = 8192


def filter_light(
    gbuffer: GBuffer,
    camera: Camera,
    pixel: IntArray,
    parts: list[FloatArray],
    variance: FloatArray,
    levels: NDArray[np.integer[Any]] | int,
    threads: int | None,
    geometric_levels: int = GEOMETRIC_LEVELS,
) -> list[FloatArray]:
    """Smooth noisy light along surfaces.

    Parameters
    ----------
    gbuffer, camera
        Depth and normals that guide the filter, and the size of a pixel.
    pixel : (P,)
        Flat indices of the image's pixels that have light; the others take no part.
    parts : (P, C) each
        Light to smooth, all with the same weights; the first part is RGB and steers the luminance weight.
        The list is emptied: what nobody else needs is let go before the filter takes as much memory again.
    variance : (P,)
        Variance of the luminance of the first part.
    levels : (P,) or a number
        Filter passes that each pixel takes part in, 0..5; the k-th reaches 2**k pixels.
    geometric_levels
        The first passes, which leave luminance out.

    Returns
    -------
    list of (P, C)
        The smoothed parts; pixels with no level or no surface are unchanged.
    """

    def guide_of(layout: PlaneLayout, takes_part: NDArray[np.bool_]) -> _Guide:
        return _Guide.of(gbuffer, camera, layout, takes_part)

    return _filter(gbuffer.shape, guide_of, pixel, parts, variance, levels, threads, geometric_levels)


def filter_points(
    shape: tuple[int, int],
    points: tuple[FloatArray, FloatArray],
    per_footprint: float,
    is_orthographic: bool,
    pixel: IntArray,
    parts: list[FloatArray],
    variance: FloatArray,
    levels: int,
    threads: int | None,
    geometric_levels: int,
) -> list[FloatArray]:
    """Smooth noisy light of points that are laid out as an image, wherever within its pixels they lie.

    Parameters
    ----------
    shape
        Rows and columns.
    points : (3, P) each
        Positions and normals, view space.
    per_footprint
        1 / the size of such a pixel: at depth 1, orthographic at any.
    is_orthographic
        Pixels are as large everywhere.
    pixel, parts, variance, levels, threads, geometric_levels
        As in `filter_light`.
    """

    def guide_of(layout: PlaneLayout, takes_part: NDArray[np.bool_]) -> _Guide:
        places, planes = layout.places(pixel), []
        for values in points:
            planes.append(np.zeros((3, layout.size), dtype=values.dtype))
            planes[-1][:, places] = values
        return _Guide(planes[0], planes[1] * takes_part, per_footprint, is_orthographic)

    return _filter(shape, guide_of, pixel, parts, variance, levels, threads, geometric_levels)


def _filter(
    shape: tuple[int, int],
    guide_of: Callable[[PlaneLayout, NDArray[np.bool_]], _Guide],
    pixel: IntArray,
    parts: list[FloatArray],
    variance: FloatArray,
    levels: NDArray[np.integer[Any]] | int,
    threads: int | None,
    geometric_levels: int,
) -> list[FloatArray]:
    """Lay the parts out as planes, smooth them, and return them as they came."""
    passes = int(np.max(levels, initial=0))
    if not (passes and pixel.size):
        return parts
    takes_part = np.zeros(shape, dtype=np.bool_)
    takes_part.reshape(-1)[pixel] = True
    # The noise around a pixel is a mean over a square that the box must not cut
    box = box_around(takes_part, _NOISE_RADIUS)
    layout = PlaneLayout(shape[1], box, margin=1 << (passes - 1))
    widths = [part.shape[1] for part in parts]
    signal, noise, deepest = _planes(layout, pixel, parts, variance, levels)
    parts.clear()
    guide = guide_of(layout, deepest > 0)
    # Two sets of planes in turn
    smooth, remaining = np.zeros_like(signal), np.zeros_like(noise)
    scratch = threading.local()
    for level in range(passes):
        work = _Pass(layout, guide, (signal, noise), (smooth, remaining), level, level >= geometric_levels)
        if np.ndim(levels):
            work.leave_out(deepest <= level)
        bands = [(band, scratch) for band in layout.bands(_PIXELS_PER_BAND) if work.concerns(band, deepest)]
        parallel.run_chunks(work.filter_band, bands, threads)
        signal, noise, smooth, remaining = smooth, remaining, signal, noise
    del guide, work, smooth, remaining, deepest, noise
    planes, places = iter(signal), layout.places(pixel)
    return [np.stack([next(planes).take(places) for _ in range(width)], axis=-1) for width in widths]


def _planes(
    layout: PlaneLayout,
    pixel: IntArray,
    parts: Sequence[FloatArray],
    variance: FloatArray,
    levels: NDArray[np.integer[Any]] | int,
) -> tuple[FloatArray, FloatArray, NDArray[np.int8]]:
    """Return channels, variance and levels as flat planes."""
    places = layout.places(pixel)
    signal = np.zeros((sum(part.shape[1] for part in parts), layout.size), dtype=variance.dtype)
    noise, deepest = np.zeros_like(signal[0]), np.zeros(layout.size, dtype=np.int8)
    noise[places], deepest[places] = variance, levels
    for plane, values in zip(signal, (channel for part in parts for channel in part.T), strict=True):
        plane[places] = values
    return signal, noise, deepest


@dataclass(frozen=True, eq=False)
class _Guide:
    """What tells surfaces apart, as flat planes.

    Attributes
    ----------
    position, normal : (3, size)
        View space; zero on background.
    per_footprint
        1 / the size of a pixel: at depth 1, orthographic at any.
    is_orthographic
        Pixels are as large everywhere.
    """

    position: FloatArray
    normal: FloatArray
    per_footprint: float
    is_orthographic: bool

    @classmethod
    def of(
        cls, gbuffer: GBuffer, camera: Camera, layout: PlaneLayout, takes_part: NDArray[np.bool_]
    ) -> _Guide:
        """Return the guide of a frame; without a normal nothing is alike, so what takes no part has none."""
        rows, columns = layout.box
        depth = gbuffer.depth[layout.box]
        dtype = depth.dtype
        position, normal = np.zeros((2, 3, layout.size), dtype=dtype)
        layout.image(normal)[:] = np.moveaxis(gbuffer.normal[layout.box], -1, 0)
        normal *= takes_part
        x, y, z = layout.image(position)
        # In place of an endless distance; its normal is zero
        np.copyto(z, depth, where=~np.isinf(depth))
        right = ((np.arange(columns.start, columns.stop) + (0.5 - camera.cx)) / camera.fx).astype(dtype)
        up = ((camera.cy - 0.5 - np.arange(rows.start, rows.stop)) / camera.fy).astype(dtype)[:, None]
        np.multiply(right, 1.0 if camera.is_orthographic else z, out=x)
        np.multiply(up, 1.0 if camera.is_orthographic else z, out=y)
        np.negative(z, out=z)
        return cls(position, normal, max(camera.fx, camera.fy), camera.is_orthographic)

    def scale(self, here: slice, step: int, out: FloatArray) -> None:
        """Set `out` to 1 / the distance from the tangent plane at which pixels no longer count."""
        factor = self.per_footprint / (_PLANE_WIDTH * step)
        if self.is_orthographic:
            out[:] = factor
        else:
            np.divide(-factor, np.minimum(self.position[2, here], -1e-30), out=out)


class _Pass:
    """One à-trous pass: what it reads, and `smooth` and `remaining`, which it fills band by band.

    Both are (signal, variance), as planes.
    """

    def __init__(
        self,
        layout: PlaneLayout,
        guide: _Guide,
        given: tuple[FloatArray, FloatArray],
        out: tuple[FloatArray, FloatArray],
        level: int,
        uses_luminance: bool,
    ) -> None:
        self.guide, self.normal = guide, guide.normal
        (self.signal, self.variance), (self.smooth, self.remaining) = given, out
        self.level, self.step = level, 1 << level
        self.stride, self.uses_luminance = layout.stride, uses_luminance
        if uses_luminance:
            self.brightness = sum(c * plane for c, plane in zip(_LUMINANCE, self.signal[:3], strict=True))
            self.inverse_noise = 1e-6 * self.brightness + _NO_NOISE
            noise = np.sqrt(local_mean(layout.image(self.variance)))
            noise *= _LUMINANCE_WIDTH
            layout.image(self.inverse_noise)[:] += noise
            np.divide(1.0, self.inverse_noise, out=self.inverse_noise)

    def leave_out(self, is_done: NDArray[np.bool_]) -> None:
        """Let pixels neither give nor receive."""
        self.normal = self.guide.normal * ~is_done

    def concerns(self, here: slice, deepest: NDArray[np.int8]) -> bool:
        """Whether pixels of a run of places take part; those of others stay as they are."""
        if (deepest[here] > self.level).any():
            return True
        self.smooth[:, here], self.remaining[here] = self.signal[:, here], self.variance[here]
        return False

    def filter_band(self, task: tuple[slice, threading.local]) -> None:
        """Filter a run of places, with the arrays of this thread."""
        here, local = task
        count, dtype = here.stop - here.start, self.variance.dtype
        if getattr(local, "size", 0) < count:
            local.size, local.arrays = count, np.empty((7, count), dtype=dtype)
        total, weight, product, spare, scale, squared, offset = local.arrays[:, :count]
        self.guide.scale(here, self.step, scale)
        # Distance of each tangent plane from the camera, along its normal
        np.einsum("cn,cn->n", self.guide.normal[:, here], self.guide.position[:, here], out=offset)
        value = self.smooth[:, here]
        np.copyto(value, self.signal[:, here])
        np.copyto(squared, self.variance[here])
        total[:] = 1.0
        for dy, dx, kernel in _TAPS:
            move = (dy * self.stride + dx) * self.step
            there = slice(here.start + move, here.stop + move)
            self._weigh(here, there, scale, offset, weight, product, spare)
            np.multiply(weight, kernel, out=weight)
            np.add(total, weight, out=total)
            for channel, plane in zip(value, self.signal, strict=True):
                np.multiply(weight, plane[there], out=product)
                np.add(channel, product, out=channel)
            np.multiply(weight, weight, out=weight)
            np.multiply(weight, self.variance[there], out=weight)
            np.add(squared, weight, out=squared)
        inverse = np.divide(1.0, total, out=total)
        np.multiply(value, inverse, out=value)
        np.multiply(squared, inverse, out=squared)
        np.multiply(squared, inverse, out=self.remaining[here])

    def _weigh(
        self,
        here: slice,
        there: slice,
        scale: FloatArray,
        offset: FloatArray,
        weight: FloatArray,
        product: FloatArray,
        off_plane: FloatArray,
    ) -> None:
        """Set `weight` to how much the pixels `there` count for those `here`, 0..1."""
        guide = self.guide
        np.multiply(self.normal[0, here], self.normal[0, there], out=weight)
        np.multiply(guide.normal[0, here], guide.position[0, there], out=off_plane)
        for axis in (1, 2):
            np.multiply(self.normal[axis, here], self.normal[axis, there], out=product)
            np.add(weight, product, out=weight)
            np.multiply(guide.normal[axis, here], guide.position[axis, there], out=product)
            np.add(off_plane, product, out=off_plane)
        np.maximum(weight, 0.0, out=weight)
        for _ in range(_NORMAL_SQUARINGS):
            np.multiply(weight, weight, out=weight)
        np.subtract(off_plane, offset, out=off_plane)
        np.multiply(off_plane, scale, out=off_plane)
        _fall_off(off_plane, weight)
        if self.uses_luminance:
            np.subtract(self.brightness[there], self.brightness[here], out=product)
            np.multiply(product, self.inverse_noise[here], out=product)
            _fall_off(product, weight)


def _fall_off(distance: FloatArray, weight: FloatArray) -> None:
    """Multiply `weight` by 1 - |distance|, or by 0 beyond 1; `distance` is used up."""
    np.abs(distance, out=distance)
    np.subtract(1.0, distance, out=distance)
    np.maximum(distance, 0.0, out=distance)
    np.multiply(weight, distance, out=weight)


def local_mean(image: FloatArray) -> FloatArray:
    """Return the mean (H, W) over squares of ``2 * _NOISE_RADIUS + 1`` pixels, edges repeated."""
    side = 2 * _NOISE_RADIUS + 1
    for axis in (0, 1):
        padding = [(_NOISE_RADIUS, _NOISE_RADIUS) if axis == other else (0, 0) for other in (0, 1)]
        padded = np.pad(image, padding, mode="edge")
        length = image.shape[axis]
        image = np.zeros_like(image)
        for shift in range(side):
            window = (slice(None),) * axis + (slice(shift, shift + length),)
            image += padded[window]
        image *= 1.0 / side
    return image
