# SPDX-License-Identifier: GPL-3.0-or-later
"""Stochastic screen-space reflections.

After Stachowiak and Uludag 2015, "Stochastic Screen-Space Reflections": GGX visible-normal sampling, one
exact ray for mirrors. The estimate is Σ w L / Σ w with w = f cos / pdf, so that its normalisation is the
lobe's own integral; rays without an answer keep their weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import ggx, parallel, tracer
from .environment import Environment
from .frame_points import surface_points, toward_camera
from .light import luminance
from .sampling import sample_square, tangent_frame, to_frame
from .scene import TraceScene
from .settings import Settings
from .types import FloatArray, IntArray

# A shading normal may turn away from the camera; the lobe is then that of a grazing view.
_LEAST_VIEW_COSINE = 1e-3
# Reflection rays have another shift of the sequence than diffuse rays.
_SEED_OFFSET = 0x5351


@dataclass(frozen=True, eq=False)
class LobeSamples:
    """Per-pixel means over the reflection rays.

    Attributes
    ----------
    pixel : (P,) int64
        The traced pixels.
    radiance : (P, 3) float32
        ∫ L f cos / ∫ f cos over what was answered.
    known : (P,) float32
        Weighted fraction of the answered rays.
    variance : (P,) float32
        Variance of the mean's luminance.
    """

    pixel: IntArray
    radiance: FloatArray
    known: FloatArray
    variance: FloatArray


def sample_lobes(
    scene: TraceScene,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    pixel: IntArray,
    rays: int,
    advance: parallel.Advance | None = None,
) -> LobeSamples:
    """Trace reflection rays from the given pixels and average what they bring.

    Parameters
    ----------
    scene, environment, settings, advance
        As in `diffuse.sample_hemispheres`.
    pixel : (P,)
        Flat indices of the frame's pixels to sample.
    source : (texels + 1, 3)
        Radiance that each texel hands on to reflections, black in the last row.
    rays
        Rays per pixel; pixels below `ggx.MIRROR_ROUGHNESS` want one.
    """
    gbuffer, camera = scene.views[0].layers[0], scene.views[0].camera
    count, dtype = pixel.shape[0], gbuffer.depth.dtype
    samples = LobeSamples(
        pixel, np.zeros((count, 3), dtype=dtype), np.zeros(count, dtype=dtype), np.zeros(count, dtype=dtype)
    )
    roughness = gbuffer.roughness.reshape(-1)

    def work(slots: IntArray) -> None:
        part = pixel.take(slots)
        origin, normal = surface_points(gbuffer, camera, part)
        u, v = sample_square(part, camera.width, rays, settings.seed + _SEED_OFFSET, dtype)
        direction, weight = reflect(normal, toward_camera(camera, origin), roughness.take(part), u, v)
        direction = direction.reshape(3, -1)
        answers = scene.answer(np.tile(origin, rays), direction, threads=1)
        radiance = source.take(answers.texel, axis=0)
        if environment is not None:
            lit = np.flatnonzero(answers.brings_environment(settings.unknown))
            radiance[lit] = environment.radiance(*direction.take(lit, axis=1))
        is_known = (answers.status >= tracer.ESCAPED).reshape(rays, -1)
        radiance = radiance.reshape(rays, -1, 3)
        total = weight.sum(axis=0)
        inverse = 1.0 / np.maximum(total, 1e-20)
        known = (weight * is_known).sum(axis=0) * inverse
        mean = (weight[..., None] * radiance).sum(axis=0) * inverse[:, None]
        where = slice(slots[0], slots[-1] + 1)
        samples.known[where] = np.minimum(known, 1.0)
        samples.radiance[where] = mean
        deviation = luminance(radiance) - luminance(mean)
        if rays == 1:
            samples.variance[where] = luminance(mean) ** 2
        else:
            samples.variance[where] = (weight * deviation * deviation).sum(axis=0) * inverse / (rays - 1)

    per_chunk = max(1, parallel.RAYS_PER_TASK // rays)
    parallel.run_chunks(work, parallel.split(np.arange(count), per_chunk), settings.threads, advance)
    return samples


def reflect(
    normal: FloatArray, view: FloatArray, roughness: FloatArray, u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Draw reflection directions about shading normals.

    Parameters
    ----------
    normal, view : (3, N)
        Unit shading normals and unit vectors toward the camera.
    roughness : (N,)
        As on the Principled BSDF; below `ggx.MIRROR_ROUGHNESS` all rays are the mirror direction.
    u, v : (rays, N)
        Sample points of [0, 1)².

    Returns
    -------
    direction : (3, rays, N)
        Unit directions.
    weight : (rays, N)
        f cos / pdf without Fresnel; 0 for directions below the surface.
    """
    tangent, bitangent = tangent_frame(normal)
    local = [(view * axis).sum(axis=0) for axis in (tangent, bitangent, normal)]
    cosine_view = np.maximum(local[2], _LEAST_VIEW_COSINE)
    scale = np.sqrt(np.maximum(1.0 - cosine_view * cosine_view, 0.0))
    scale /= np.sqrt(np.maximum(local[0] ** 2 + local[1] ** 2, 1e-20))
    local_view = np.stack([local[0] * scale, local[1] * scale, cosine_view])
    alpha = np.maximum(roughness * roughness, 1e-6)
    hx, hy, hz = ggx.sample_visible_normal(local_view, alpha, u, v)
    is_mirror = roughness < ggx.MIRROR_ROUGHNESS
    hx, hy, hz = np.where(is_mirror, 0.0, hx), np.where(is_mirror, 0.0, hy), np.where(is_mirror, 1.0, hz)
    twice = 2.0 * (local_view[0] * hx + local_view[1] * hy + local_view[2] * hz)
    lx, ly, lz = twice * hx - local_view[0], twice * hy - local_view[1], twice * hz - local_view[2]
    weight = ggx.sample_weight(cosine_view, lz, alpha)
    direction = to_frame(lx, ly, lz, tangent, bitangent, normal)
    return direction.astype(normal.dtype), weight.astype(normal.dtype)
