# SPDX-License-Identifier: GPL-3.0-or-later
"""The brightest part of an environment, sampled by rays of its own.

Hardly any ray over the hemisphere meets the sun of an image of a sky, and the few that do are noise. So the
radiance L is split at a limit l on its luminance Y, in the same colour: L = L min(1, l / Y) + the excess.
Escaping rays of every method look the first part up. Directions to the second are drawn from its luminance x
solid angle (Pharr, Jakob and Humphreys 2023, "Physically Based Rendering", section 12.5.2) and traced as
shadow rays. Both are bilinear images: their sum is the environment exactly, whatever the limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import parallel, tracer
from .diffuse import variance_of_mean
from .environment import Environment
from .frame_points import surface_points
from .light import luminance
from .sampling import sample_square
from .scene import TraceScene
from .settings import Settings
from .types import FloatArray, IntArray

# Luminance at which the two parts meet, in units of the mean over the sphere. Measured: 2 to 8 make no
# difference for a sun, and little for the windows of an interior.
_LIMIT = 4.0
# Rays to the bright sky have another shift of the sequence than diffuse and reflection rays.
_SEED_OFFSET = 0x534B


@dataclass(frozen=True, eq=False)
class BrightSky:
    """What an environment has beyond a limit, as K bright pixels in R rows to draw directions from.

    A direction is drawn in three steps: a row, one of its bright pixels, and a place in the tent over that
    pixel by which it counts in the bilinear image. What it brings is then L / pdf of that pixel alone.

    Attributes
    ----------
    rest : Environment
        The environment without it.
    size : (width, height)
        Of the image.
    row : (R,) float32
        Rows that hold bright pixels, at their centres, pixels.
    row_end : (R + 1,) float64
        Sum of the pixels' luminance x solid angle up to each row's end, from 0.
    pixel_end : (K + 1,) float64
        The same up to each pixel's end, row by row.
    column : (K,) float32
        The pixels' columns, at their centres, pixels.
    per_sine : (K, 3) float32
        What a direction brings to the mean over the cosine hemisphere, per sine of its polar angle and cosine
        at the surface.
    """

    rest: Environment
    size: tuple[int, int]
    row: FloatArray
    row_end: FloatArray
    pixel_end: FloatArray
    column: FloatArray
    per_sine: FloatArray

    @classmethod
    def of(cls, environment: Environment) -> BrightSky | None:
        """Return what is much brighter than the mean of an environment; None where nothing is."""
        if environment.is_constant:
            return None
        image = environment.image
        height, width = image.shape[:2]
        brightness = luminance(image).astype(np.float64)
        sine = np.sin((np.arange(height) + 0.5) * (np.pi / height))
        limit = _LIMIT * float((brightness.mean(axis=1) * sine).sum() / sine.sum())
        bright = np.flatnonzero(brightness > limit)
        if not bright.size:
            return None
        row, column = bright // width, bright % width
        excess = brightness.reshape(-1)[bright] - limit
        rows, first = np.unique(row, return_index=True)
        pixel_end = np.concatenate([[0.0], np.cumsum(excess * sine[row])])
        # L_excess / Y_excess is L / Y; a pixel's solid angle is 2 pi^2 / (W H) times its sine
        colour = image.reshape(-1, 3)[bright] / brightness.reshape(-1)[bright, None]
        per_sine = colour * (pixel_end[-1] / sine[row] * (2.0 * np.pi / (width * height)))[:, None]
        kept = np.ones_like(brightness)
        kept.reshape(-1)[bright] = limit / brightness.reshape(-1)[bright]
        return cls(
            replace(environment, image=image * kept[..., None].astype(image.dtype)),
            (width, height),
            (rows + 0.5).astype(image.dtype),
            pixel_end[np.append(first, bright.size)],
            pixel_end,
            (column + 0.5).astype(image.dtype),
            per_sine.astype(image.dtype),
        )

    def draw(
        self, u: FloatArray, v: FloatArray, world_from_view: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Draw directions with density luminance x solid angle.

        Parameters
        ----------
        u, v : (...)
            Sample points of [0, 1)².
        world_from_view : (3, 3)
            Rotation of the space to draw in.

        Returns
        -------
        direction : (3, ...)
            Unit directions.
        light : (..., 3)
            Excess radiance / (pi pdf): times the cosine, what each brings to the mean over the cosine
            hemisphere.
        """
        row, row_part = _invert(self.row_end, v.astype(np.float64))
        begin = self.row_end[row]
        # Inside a row the sum goes on, so that one search through all pixels finds those of each row
        along = begin + u * (self.row_end[row + 1] - begin)
        pixel, column_part = _invert(self.pixel_end, along / self.pixel_end[-1])
        dtype = u.dtype
        y = self.row.take(row) + _tent(row_part.astype(dtype))
        x = self.column.take(pixel) + _tent(column_part.astype(dtype))
        width, height = self.size
        # Above the first row's and below the last row's centre the image is as there: their tents fold back
        polar = (height - np.abs(height - np.abs(y))) * (np.pi / height)
        azimuth = np.pi - x * (2.0 * np.pi / width)
        sine = np.sin(polar)
        world = (sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar))
        direction = np.empty((3, *u.shape), dtype=dtype)
        for axis in range(3):
            turn = [float(value) for value in world_from_view[:, axis]]
            direction[axis] = turn[0] * world[0] + turn[1] * world[1] + turn[2] * world[2]
        return direction, self.per_sine.take(pixel, axis=0) * sine[..., None]


def _invert(end: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return which interval of a running sum holds each fraction of it, and how far inside, 0..1."""
    at = at * end[-1]
    # Rounding may lead past the last one, or a step past the end of another
    found = np.minimum(np.searchsorted(end, at, side="right") - 1, end.shape[0] - 2)
    begin = end.take(found)
    length = np.maximum(end.take(found + 1) - begin, 1e-300)
    return found, np.clip((at - begin) / length, 0.0, 1.0)


def _tent(part: FloatArray) -> FloatArray:
    """Return the offset, -1..1, below which a fraction of the tent 1 - |offset| lies."""
    rise, fall = np.sqrt(2.0 * part) - 1.0, 1.0 - np.sqrt(np.maximum(2.0 - 2.0 * part, 0.0))
    offset: FloatArray = np.where(part < 0.5, rise, fall)
    return offset


@dataclass(frozen=True, eq=False)
class BrightLight:
    """What the bright sky brings to P pixels.

    Attributes
    ----------
    radiance : (P, 3) float32
        Mean incoming radiance over the cosine hemisphere.
    known : (P,) float32
        Fraction of answered rays; those below the surface's horizon need no answer, and blocked ones are
        one: shadow.
    variance : (P,) float32
        Variance of the mean's luminance; 0 for a single ray, of which nothing is known.
    rays
        Number of traced rays.
    """

    radiance: FloatArray
    known: FloatArray
    variance: FloatArray
    rays: int


def light_from_bright_sky(
    scene: TraceScene,
    home: int,
    sky: BrightSky,
    settings: Settings,
    pixel: IntArray,
    rays: int,
    advance: parallel.Advance | None = None,
) -> BrightLight:
    """Trace shadow rays from the given pixels toward the bright sky and sum what they bring.

    Parameters
    ----------
    scene, home, settings, pixel, advance
        As in `diffuse.sample_hemispheres`.
    sky
        For directions in the space of view 0.
    rays
        Per pixel.
    """
    dtype, count = scene.views[home].layers[0].depth.dtype, pixel.shape[0]
    light = BrightLight(
        np.empty((count, 3), dtype=dtype), np.empty(count, dtype=dtype), np.empty(count, dtype=dtype), 0
    )
    traced = 0

    def advanced(fraction: float) -> None:
        if advance is not None:
            advance((block[0] + fraction * block.size) / count)

    for block in parallel.split(np.arange(count), max(1, parallel.RAYS_AT_ONCE // rays)):
        traced += _light_block(scene, home, sky, settings, pixel, rays, light, block, advanced)
    return replace(light, rays=traced)


def _light_block(
    scene: TraceScene,
    home: int,
    sky: BrightSky,
    settings: Settings,
    pixel: IntArray,
    rays: int,
    light: BrightLight,
    block: IntArray,
    advance: parallel.Advance,
) -> int:
    """Draw, trace and sum the rays of a run of pixels; return how many were traced."""
    gbuffer, camera = scene.views[home].layers[0], scene.views[home].camera
    dtype, threads = gbuffer.depth.dtype, settings.threads
    turned = scene.environment_for(home, sky.rest)
    assert turned is not None
    point = np.empty((3, block.size), dtype=dtype)
    shape = (rays, block.size)
    direction = np.empty((3, *shape), dtype=dtype)
    brought = np.empty((*shape, 3), dtype=dtype)
    is_lit, is_known = np.zeros(shape, dtype=np.bool_), np.ones(shape, dtype=np.bool_)

    def draw(slots: IntArray) -> None:
        where, part = slice(slots[0], slots[-1] + 1), pixel.take(block[slots])
        point[:, where], normal = surface_points(gbuffer, camera, part)
        u, v = sample_square(part, camera.width, rays, settings.seed + _SEED_OFFSET, dtype)
        drawn, radiance = sky.draw(u, v, turned.world_from_view)
        cosine = drawn[0] * normal[0] + drawn[1] * normal[1] + drawn[2] * normal[2]
        is_lit[:, where] = cosine > 0.0
        direction[:, :, where] = drawn
        brought[:, where] = radiance * np.maximum(cosine, 0.0)[..., None]

    def shade(slots: IntArray) -> None:
        where = slice(slots[0], slots[-1] + 1)
        to = slice(block[0] + where.start, block[0] + where.stop)
        radiance = brought[:, where] * is_lit[:, where, None]
        light.radiance[to] = radiance.mean(axis=0)
        light.known[to] = is_known[:, where].mean(axis=0)
        light.variance[to] = variance_of_mean(luminance(radiance)) if rays > 1 else 0.0

    chunks = parallel.split(np.arange(block.size), max(1, parallel.RAYS_PER_TASK // rays))
    parallel.run_chunks(draw, chunks, threads)
    # Rays below the horizon bring nothing, and none of them is traced
    above = np.flatnonzero(is_lit)
    origin = point.take(above % block.size, axis=1)
    answers = scene.answer(origin, direction.reshape(3, -1).take(above, axis=1), home, threads, advance)
    # A blocked ray may meet what is as bright as the sky, but nothing as bright as the sun: it lies in shadow
    is_unknown = answers.status == tracer.UNKNOWN
    is_lit.reshape(-1)[above] = answers.brings_environment(settings.unknown) & (
        is_unknown | (answers.status == tracer.ESCAPED)
    )
    is_known.reshape(-1)[above] = ~is_unknown
    parallel.run_chunks(shade, chunks, threads)
    return int(above.size)
