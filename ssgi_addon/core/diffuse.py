# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of the hemisphere above each pixel, by whichever method: screen-space directional occlusion.

After Ritschel, Grosch and Seidel 2009, "Approximating Dynamic Global Illumination in Image Space": open
directions bring the environment, blocked ones the bounce. Where the paper tests one point per direction
(`points`), these directions are walked to the first surface, so occlusion and bounce reach across the whole
frame; `slices` covers the arcs of slices of the hemisphere instead of sampling directions. Bounces after the
first gather over what the first one met and trace nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from . import parallel, points, tracer
from .environment import Environment
from .frame_points import surface_points
from .light import luminance
from .sampling import cosine_directions, sample_square
from .scene import TraceScene
from .settings import Settings
from .slice_samples import SLICED, sample_slices
from .types import BoolArray, FloatArray, IntArray


class DiffuseSamples(Protocol):
    """What every method tells of the hemispheres above P pixels.

    Attributes
    ----------
    pixel : (P,) int64
        The sampled pixels.
    bounce, environment : (P, 3) float32
        Mean over the hemisphere of the light that hits hand on, and of the environment's.
    visibility, known : (P,) float32
        Open and answered fraction.
    variance : (P,) float32
        Variance of the mean's luminance.
    count
        Samples per pixel.
    traced
        Rays that were traced for them.
    most_own
        Rays of its own that a pixel's variance is that of, at most; 0 where it is that of its neighbours.
    brings_light
        False for methods that tell visibility alone.
    """

    @property
    def pixel(self) -> IntArray: ...
    @property
    def bounce(self) -> FloatArray: ...
    @property
    def environment(self) -> FloatArray: ...
    @property
    def visibility(self) -> FloatArray: ...
    @property
    def known(self) -> FloatArray: ...
    @property
    def variance(self) -> FloatArray: ...
    @property
    def count(self) -> int: ...
    @property
    def traced(self) -> int: ...
    @property
    def most_own(self) -> int: ...
    @property
    def brings_light(self) -> bool: ...

    def gather(self, handed_on: FloatArray, threads: int | None) -> FloatArray:
        """Return the mean (P, 3) over the hemisphere of what texels hand on, (texels + 1, 3)."""
        ...


@dataclass(frozen=True, eq=False)
class HemisphereSamples:
    """`DiffuseSamples` of rays: ``hit`` (rays, P) int32 is the texel that each met, as in `scene.Answers`."""

    pixel: IntArray
    hit: np.ndarray
    bounce: FloatArray
    environment: FloatArray
    visibility: FloatArray
    known: FloatArray
    variance: FloatArray
    traced: int
    brings_light: bool

    @property
    def count(self) -> int:
        """Rays per pixel."""
        return int(self.hit.shape[0])

    @property
    def most_own(self) -> int:
        """As in `DiffuseSamples`; none for directions that are not followed."""
        return self.count if self.traced else 0

    def gather(self, handed_on: FloatArray, threads: int | None) -> FloatArray:
        """As `DiffuseSamples.gather`."""
        bounce = np.empty_like(self.bounce)

        def work(slots: IntArray) -> None:
            where = slice(slots[0], slots[-1] + 1)
            total = handed_on.take(self.hit[0, where], axis=0)
            for ray in range(1, self.count):
                total += handed_on.take(self.hit[ray, where], axis=0)
            bounce[where] = total * (1.0 / self.count)

        parallel.run_chunks(work, parallel.split(np.arange(self.pixel.shape[0]), 65536), threads)
        return bounce


def sample_hemispheres(
    scene: TraceScene,
    home: int,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    pixel: IntArray,
    advance: parallel.Advance | None = None,
    pattern: IntArray | None = None,
) -> DiffuseSamples:
    """Sample the hemispheres above the given pixels and sum what they bring.

    Parameters
    ----------
    scene
        All views.
    home
        The view whose pixels are sampled.
    source : (texels + 1, 3)
        Radiance that each texel hands on, black in the last row.
    environment
        What escapes bring, for directions in the space of view 0; None brings nothing.
    settings
        Method, samples per pixel, what unknown ones bring, seed, threads.
    pixel : (P,)
        Flat indices of the view's pixels to sample.
    advance
        Called with the finished fraction.
    pattern : (P,)
        Pixels whose directions each takes; None means its own. Slices always take their own.
    """
    environment = scene.environment_for(home, environment)
    if settings.diffuse.method in SLICED:
        return sample_slices(scene, home, source, environment, settings, pixel, advance)
    rays, count, dtype = settings.diffuse.rays, pixel.shape[0], scene.dtype
    samples = HemisphereSamples(
        pixel,
        np.empty((rays, count), dtype=np.int32),
        np.zeros((count, 3), dtype=dtype),
        np.zeros((count, 3), dtype=dtype),
        np.zeros(count, dtype=dtype),
        np.zeros(count, dtype=dtype),
        np.zeros(count, dtype=dtype),
        traced=rays * count if has_rays(settings) else 0,
        brings_light=settings.diffuse.method != "ssao",
    )

    def advanced(fraction: float) -> None:
        if advance is not None:
            advance((block[0] + fraction * block.size) / count)

    pattern = pixel if pattern is None else pattern
    blocks = parallel.split(np.arange(count), max(1, parallel.RAYS_AT_ONCE // 2 // rays))
    for block in blocks:
        _sample_block(scene, home, source, environment, settings, samples, pattern, block, advanced)
    return samples


@dataclass(frozen=True, eq=False)
class HemisphereRays:
    """Rays over the hemispheres above N pixels, and what they met.

    Attributes
    ----------
    direction : (3, rays, N)
        Unit directions in the space of the pixels' view.
    status, texel, is_lit : (rays, N)
        As in `scene.Answers`; whether the environment is what a ray brings.
    """

    direction: FloatArray
    status: np.ndarray
    texel: np.ndarray
    is_lit: BoolArray

    @classmethod
    def trace(
        cls,
        scene: TraceScene,
        home: int,
        settings: Settings,
        pixel: IntArray,
        advance: parallel.Advance,
        chosen: slice = slice(None),
        pattern: IntArray | None = None,
    ) -> HemisphereRays:
        """Draw the chosen ones of `DiffuseSettings.rays` per pixel, and follow or test them.

        Directions are those of the pixels in `pattern`; None means each pixel's own.
        """
        pattern = pixel if pattern is None else pattern
        gbuffer, camera = scene.views[home].layers[0], scene.views[home].camera
        options, dtype, threads = settings.diffuse, gbuffer.depth.dtype, settings.threads
        rays = len(range(options.rays)[chosen])
        origin, direction = np.empty((2, 3, rays, pixel.size), dtype=dtype)

        def draw(slots: IntArray) -> None:
            where, part = slice(slots[0], slots[-1] + 1), pixel.take(slots)
            point, normal = surface_points(gbuffer, camera, part)
            u, v = sample_square(
                pattern.take(slots), camera.width, options.rays, settings.seed, dtype, chosen
            )
            direction[:, :, where] = cosine_directions(u, v, normal)
            origin[:, :, where] = point[:, None]

        chunks = parallel.split(np.arange(pixel.size), max(1, parallel.RAYS_PER_TASK // rays))
        parallel.run_chunks(draw, chunks, threads)
        if has_rays(settings):
            answers = scene.answer(origin.reshape(3, -1), direction.reshape(3, -1), home, threads, advance)
        else:
            answers = points.test_points(scene, home, origin, direction, pixel, settings)
        shape = (rays, pixel.size)
        is_lit = answers.brings_environment(settings.unknown).reshape(shape)
        return cls(direction, answers.status.reshape(shape), answers.texel.reshape(shape), is_lit)

    def light(
        self, where: slice, source: FloatArray, environment: Environment | None
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return what rays of a run of pixels bring (rays, N, 3): by hits, and from the environment."""
        bounce = source.take(self.texel[:, where], axis=0)
        if environment is None:
            return bounce, None
        sky, is_lit = np.zeros_like(bounce), self.is_lit[:, where]
        sky[is_lit] = environment.radiance(*(part[is_lit] for part in self.direction[:, :, where]))
        return bounce, sky

    def is_known(self, where: slice) -> BoolArray:
        """Return which rays of a run of pixels were answered, (rays, N)."""
        known: BoolArray = self.status[:, where] >= tracer.ESCAPED
        return known

    def is_open(self, where: slice) -> BoolArray:
        """Return which rays of a run of pixels met nothing, (rays, N)."""
        status = self.status[:, where]
        is_open: BoolArray = (status == tracer.ESCAPED) | (status == tracer.UNKNOWN)
        return is_open


def has_rays(settings: Settings) -> bool:
    """Whether directions over the hemisphere are followed."""
    return settings.diffuse.method == "hemisphere" and settings.diffuse.traced


def _sample_block(
    scene: TraceScene,
    home: int,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    samples: HemisphereSamples,
    pattern: IntArray,
    block: IntArray,
    advance: parallel.Advance,
) -> None:
    """Draw, trace and sum the rays of a run of sampled pixels."""
    rays = HemisphereRays.trace(
        scene, home, settings, samples.pixel.take(block), advance, pattern=pattern.take(block)
    )

    def shade(slots: IntArray) -> None:
        where = slice(slots[0], slots[-1] + 1)
        to = slice(block[0] + where.start, block[0] + where.stop)
        samples.hit[:, to] = rays.texel[:, where]
        radiance, sky = rays.light(where, source, environment)
        radiance *= samples.brings_light
        samples.bounce[to] = radiance.mean(axis=0)
        if sky is not None:
            samples.environment[to] = sky.mean(axis=0)
            radiance += sky
        samples.known[to] = rays.is_known(where).mean(axis=0)
        samples.visibility[to] = rays.is_open(where).mean(axis=0)
        samples.variance[to] = variance_of_mean(luminance(radiance))

    chunks = parallel.split(np.arange(block.size), max(1, parallel.RAYS_PER_TASK // samples.count))
    parallel.run_chunks(shade, chunks, settings.threads)


def variance_of_mean(values: FloatArray) -> FloatArray:
    """Return the variance ``(N,)`` of the mean of ``(rays, N)`` values."""
    rays = values.shape[0]
    mean: FloatArray = values.mean(axis=0)
    if rays == 1:
        return mean * mean  # nothing is known of it: as large as the value
    spread: FloatArray = (values * values).mean(axis=0) - mean * mean
    variance: FloatArray = np.maximum(spread, 0.0) / (rays - 1)
    return variance
