# SPDX-License-Identifier: GPL-3.0-or-later
"""Screen-space directional occlusion by rays over the hemisphere.

After Ritschel, Grosch and Seidel 2009, "Approximating Dynamic Global Illumination in Image Space": open
directions bring the environment, blocked ones the bounce. Where the paper tests one point per direction,
these directions are walked to the first surface, so occlusion and bounce reach across the whole frame.
Bounces after the first gather over the hits of the first and trace nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import parallel, tracer
from .environment import Environment
from .frame_points import surface_points
from .light import luminance
from .sampling import cosine_directions, sample_square
from .scene import TraceScene
from .settings import Settings
from .types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class HemisphereSamples:
    """Per-pixel sums over the diffuse rays, and the hits that later bounces read.

    Attributes
    ----------
    pixel : (P,) int64
        The traced pixels.
    hit : (rays, P) int32
        Texel that each ray met, as in `scene.Answers`.
    bounce, environment : (P, 3) float32
        Mean over all rays of the light that hits hand on, and of the environment's.
    visibility, known : (P,) float32
        Fraction of open and of answered rays.
    variance : (P,) float32
        Variance of the mean's luminance.
    """

    pixel: IntArray
    hit: np.ndarray
    bounce: FloatArray
    environment: FloatArray
    visibility: FloatArray
    known: FloatArray
    variance: FloatArray


def sample_hemispheres(
    scene: TraceScene,
    home: int,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    pixel: IntArray,
    advance: parallel.Advance | None = None,
) -> HemisphereSamples:
    """Trace cosine-distributed rays from the given pixels and sum what they bring.

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
        Rays per pixel, what unknown samples bring, seed, threads.
    pixel : (P,)
        Flat indices of the view's pixels to sample.
    advance
        Called with the finished fraction.
    """
    gbuffer, camera = scene.views[home].layers[0], scene.views[home].camera
    environment = scene.environment_for(home, environment)
    rays, count, dtype = settings.diffuse.rays, pixel.shape[0], gbuffer.depth.dtype
    samples = HemisphereSamples(
        pixel,
        np.empty((rays, count), dtype=np.int32),
        np.zeros((count, 3), dtype=dtype),
        np.zeros((count, 3), dtype=dtype),
        np.zeros(count, dtype=dtype),
        np.zeros(count, dtype=dtype),
        np.zeros(count, dtype=dtype),
    )

    def work(slots: IntArray) -> None:
        part = pixel.take(slots)
        origin, normal = surface_points(gbuffer, camera, part)
        u, v = sample_square(part, camera.width, rays, settings.seed, dtype)
        direction = cosine_directions(u, v, normal).reshape(3, -1)
        answers = scene.answer(np.tile(origin, rays), direction, home)
        where = slice(slots[0], slots[-1] + 1)
        samples.hit[:, where] = answers.texel.reshape(rays, -1)
        status = answers.status
        radiance = source.take(answers.texel, axis=0)
        samples.bounce[where] = radiance.reshape(rays, -1, 3).mean(axis=0)
        if environment is not None:
            lit = answers.lit_by_environment(settings.unknown)
            sky = np.zeros_like(radiance)
            sky[lit] = environment.radiance(*direction.take(lit, axis=1))
            samples.environment[where] = sky.reshape(rays, -1, 3).mean(axis=0)
        samples.known[where] = (status >= tracer.ESCAPED).reshape(rays, -1).mean(axis=0)
        is_open = (status == tracer.ESCAPED) | (status == tracer.UNKNOWN)
        samples.visibility[where] = is_open.reshape(rays, -1).mean(axis=0)
        brightness = luminance(radiance if environment is None else radiance + sky)
        samples.variance[where] = _variance_of_mean(brightness.reshape(rays, -1))

    per_chunk = max(1, parallel.RAYS_PER_TASK // rays)
    chunks = parallel.split(np.arange(count), per_chunk)
    parallel.run_chunks(work, chunks, settings.threads, advance)
    return samples


def gather_bounce(samples: HemisphereSamples, handed_on: FloatArray, threads: int | None) -> FloatArray:
    """Return the mean ``(P, 3)`` over each pixel's hits of what texels hand on, ``(texels + 1, 3)``."""
    bounce = np.empty_like(samples.bounce)
    rays = samples.hit.shape[0]

    def work(slots: IntArray) -> None:
        where = slice(slots[0], slots[-1] + 1)
        total = handed_on.take(samples.hit[0, where], axis=0)
        for ray in range(1, rays):
            total += handed_on.take(samples.hit[ray, where], axis=0)
        bounce[where] = total * (1.0 / rays)

    parallel.run_chunks(work, parallel.split(np.arange(samples.pixel.shape[0]), 65536), threads)
    return bounce


def _variance_of_mean(values: FloatArray) -> FloatArray:
    """Return the variance ``(N,)`` of the mean of ``(rays, N)`` values."""
    rays = values.shape[0]
    mean: FloatArray = values.mean(axis=0)
    if rays == 1:
        return mean * mean  # nothing is known of it: as large as the value
    spread: FloatArray = (values * values).mean(axis=0) - mean * mean
    variance: FloatArray = np.maximum(spread, 0.0) / (rays - 1)
    return variance
