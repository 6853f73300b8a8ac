# SPDX-License-Identifier: GPL-3.0-or-later
"""Stochastic screen-space reflections.

After Stachowiak and Uludag 2015, "Stochastic Screen-Space Reflections": GGX visible-normal sampling, one
exact ray for mirrors, rays that neighbours reuse, cones that read a pyramid of means. The estimate is
Σ w L / Σ w with w = f cos / pdf, so that its normalisation is the lobe's own integral; rays without an answer
keep their weight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import ggx, parallel, tracer
from .answers import Answers
from .cells import STRIDES, grid_shape
from .environment import Environment
from .frame_points import surface_points, toward_camera
from .hit_colors import HitColors
from .light import luminance
from .lobes import Lobes
from .resolve import LobeSums, RayGrid, keep, resolve
from .sampling import sample_square
from .scene import TraceScene
from .settings import ReflectionSettings, Settings
from .types import BoolArray, FloatArray, IntArray

# Reflection rays have another shift of the sequence than diffuse rays.
_SEED_OFFSET = 0x5351
# Rougher lobes are so wide that a pixel's neighbours see the same: a ray for every 2 x 2 pixels.
ROUGH = 0.4
# Where not every pixel has rays, each takes those of its own cell and of at least so many others.
_LEAST_REUSE = 3
# A ray stands for no wider a cone than one of this share of the lobe's largest density: in the far tail of a
# lobe 1 / density has no bound, and such cones would widen the lobe.
_LEAST_DENSITY = 0.1
# A pixel whose neighbours' rays weigh less than this has rays of its own traced.
_LEAST_WEIGHT = 0.05


@dataclass(frozen=True, eq=False)
class GlossyLight:
    """What reflection rays bring to the pixels of a frame.

    Attributes
    ----------
    radiance : (P, 3) float32
        ∫ L f cos / ∫ f cos over what was answered.
    known : (P,) float32
        Weighted fraction of the answered rays.
    variance : (P,) float32
        Variance of the mean's luminance.
    distance : (P,) float32
        Harmonic mean distance to what is reflected, +inf for the sky.
    rays
        Number of traced rays.
    """

    radiance: FloatArray
    known: FloatArray
    variance: FloatArray
    distance: FloatArray
    rays: int


def reflect_light(
    scene: TraceScene,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    pixel: IntArray,
    advance: parallel.Advance,
) -> GlossyLight:
    """Trace reflection rays from the given pixels and resolve what they bring.

    Parameters
    ----------
    scene, environment, settings
        As in `diffuse.sample_hemispheres`.
    source : (texels + 1, 3)
        Radiance that each texel hands on to reflections, black in the last row.
    pixel : (P,)
        Flat indices of the frame's pixels to sample.
    advance
        Called with the finished fraction.
    """
    return _Reflection(scene, source, environment, settings, advance).light(pixel)


class _Reflection:
    """One frame's reflections: tiers of pixels by roughness, each traced on a grid of its own."""

    def __init__(
        self,
        scene: TraceScene,
        source: FloatArray,
        environment: Environment | None,
        settings: Settings,
        advance: parallel.Advance,
    ) -> None:
        self.scene, self.environment, self.settings, self.advance = scene, environment, settings, advance
        self.options: ReflectionSettings = settings.reflections
        self.gbuffer, self.camera = scene.views[0].layers[0], scene.views[0].camera
        self.colors = HitColors(
            scene,
            source,
            is_subpixel=self.options.subpixel,
            has_levels=self.options.color_pyramid,
        )
        self.sums = LobeSums.zero(self.gbuffer.shape, self.gbuffer.depth.dtype)
        self.rays = self.planned = 0

    def light(self, pixel: IntArray) -> GlossyLight:
        """Return the light of the given pixels."""
        is_active = np.zeros(self.gbuffer.shape, dtype=np.bool_)
        is_active.reshape(-1)[pixel] = True
        tiers = list(_tiers(self.gbuffer.roughness, is_active, self.options))
        self.planned = sum(-(-int(tier.mask.sum()) // tier.stride**2) * tier.rays for tier in tiers)
        self._trace(tiers)
        # Thin things may have no ray near them
        self._trace(
            [
                replace(
                    tier, mask=tier.mask & (self.sums.weight < _LEAST_WEIGHT * tier.rays), stride=1, reuse=0
                )
                for tier in tiers
                if tier.stride > 1
            ]
        )
        return self._result(pixel)

    def _trace(self, tiers: Sequence[_Tier]) -> None:
        """Trace the rays of some pixels, as many at a time as memory is meant for, and resolve them.

        Few rays of several tiers walk together: a walk's last steps cost calls, not arithmetic.
        """
        batch: list[_Band] = []
        waiting = 0
        for band in (band for tier in tiers for band in _bands(tier)):
            if waiting + band.most_rays > _rays_at_once():
                self._trace_bands(batch)
                batch, waiting = [], 0
            batch.append(band)
            waiting += band.most_rays
        self._trace_bands(batch)

    def _trace_bands(self, bands: Sequence[_Band]) -> None:
        """Trace the rays of some bands together, and resolve them band by band."""
        drawn = [rays for rays in map(self._draw, bands) if rays is not None]
        if not drawn:
            return
        origin, direction = (
            of[0] if len(of) == 1 else np.concatenate(of, axis=1)
            for of in ([rays.origin for rays in drawn], [rays.direction for rays in drawn])
        )
        answers = self.scene.answer(origin, direction, threads=self.settings.threads, advance=self._advance)
        begin = 0
        for rays in drawn:
            self._shade_grid(rays, answers, begin)
            begin += rays.spread.size
            tier = rays.tier
            if tier.is_mirror:
                keep(rays.grid, self.sums)
            else:
                resolve(
                    rays.grid, self.gbuffer, self.camera, tier.mask, tier.reuse, self.options.elongation,
                    self.sums, self.settings.threads,
                )  # fmt: skip
        self.rays += begin

    def _draw(self, band: _Band) -> _Rays | None:
        """Draw the rays of a band; None where it has none."""
        tier, chosen = band.tier, band.chosen
        count, dtype = chosen.stop - chosen.start, self.gbuffer.depth.dtype
        grid = RayGrid(tier.mask, tier.stride, count, band.top, band.bottom, dtype)
        cells = grid.cells
        if not cells.size:
            return None
        origin, direction = np.empty((2, 3, count, cells.size), dtype=dtype)
        spread = np.empty((count, cells.size), dtype=dtype)

        def draw(slots: IntArray) -> None:
            where, own = slice(slots[0], slots[-1] + 1), cells.take(slots)
            pixel = grid.pixel.take(slots)
            point, normal = surface_points(self.gbuffer, self.camera, pixel)
            roughness = self.gbuffer.roughness.reshape(-1).take(pixel)
            lobes = Lobes.at(normal, toward_camera(self.camera, point), roughness, self.options.elongation)
            seed = self.settings.seed + _SEED_OFFSET
            u, v = sample_square(own, grid.columns, tier.rays, seed, dtype, chosen)
            drawn, pdf = lobes.draw(u, v, tier.is_mirror)
            direction[:, :, where], origin[:, :, where] = drawn, point[:, None]
            if tier.is_mirror:
                spread[:, where] = 0.0
            else:
                dense = np.maximum(pdf, _LEAST_DENSITY * lobes.peak())
                spread[:, where] = _spread(dense, tier.rays * (1 + tier.reuse))
            grid.set_rays(grid.places(own), point, normal, drawn, pdf)

        parallel.run_chunks(draw, _chunks(cells.size, count), self.settings.threads)
        return _Rays(tier, grid, origin.reshape(3, -1), direction.reshape(3, -1), spread)

    def _shade_grid(self, rays: _Rays, answers: Answers, begin: int) -> None:
        """Store what the rays of a grid found; the first is number `begin` of all that were traced."""
        grid, (count, size) = rays.grid, rays.spread.shape

        def shade(slots: IntArray) -> None:
            places = grid.places(grid.cells.take(slots))
            for ray in range(count):
                own = slice(ray * size + slots[0], ray * size + slots[-1] + 1)
                run = slice(begin + own.start, begin + own.stop)
                way, wide = rays.direction[:, own], rays.spread.reshape(-1)[own]
                radiance, known = self._shade(answers, run, way, wide)
                near = 1.0 / np.maximum(answers.distance[run], 1e-20)
                grid.set_answers(ray, places, near, radiance, known, answers.status[run] == tracer.BLOCKED)

        parallel.run_chunks(shade, _chunks(size, count), self.settings.threads)

    def _shade(
        self, answers: Answers, run: slice, direction: FloatArray, spread: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return what a run of rays brings (N, 3), and how far each was answered (N,)."""
        radiance = self.colors.radiance(answers, run, spread)
        known = (answers.status[run] >= tracer.ESCAPED).astype(radiance.dtype)
        is_lit = answers.brings_environment(self.settings.unknown)[run]
        if self.options.edge_fade > 0.0 and len(self.scene.views) == 1:
            kept = np.where(answers.status[run] == tracer.HIT, self._distance_to_edge(answers, run), 1.0)
            radiance *= kept[:, None]
            known *= kept
        else:
            kept = np.ones_like(known)
        if self.environment is not None:
            share = is_lit.astype(known.dtype)
            if self.settings.unknown == "environment":
                share += 1.0 - kept
            lit = np.flatnonzero(share)
            sky = self.environment.radiance(*direction.take(lit, axis=1))
            radiance[lit] += share.take(lit)[:, None] * sky
        return radiance, known

    def _distance_to_edge(self, answers: Answers, run: slice) -> FloatArray:
        """Return how far inside the frame hits lie: 0 at its edge to 1 where fading ends."""
        width, height = self.camera.width, self.camera.height
        x, y = answers.x_px[run], answers.y_px[run]
        inside = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
        inside = np.clip(inside / (self.options.edge_fade * width), 0.0, 1.0)
        smooth: FloatArray = inside * inside * (3.0 - 2.0 * inside)
        return smooth

    def _advance(self, fraction: float) -> None:
        self.advance(min(1.0, self.rays / max(self.planned, 1)))

    def _result(self, pixel: IntArray) -> GlossyLight:
        sums = self.sums
        weight = sums.weight.reshape(-1).take(pixel)
        inverse = 1.0 / np.maximum(weight, 1e-20)
        radiance = sums.radiance.reshape(3, -1).take(pixel, axis=1) * inverse
        hidden = sums.hidden.reshape(-1).take(pixel) * inverse
        # Rays behind something find, for all that is known, a share of what the others do
        radiance *= 1.0 + self.options.hidden_light * hidden / np.maximum(1.0 - hidden, 0.1)
        known = np.minimum(sums.known.reshape(-1).take(pixel) * inverse, 1.0)
        mean = luminance(radiance.T)
        squared, first, second = (
            part.reshape(-1).take(pixel) * inverse * inverse
            for part in (sums.squared, sums.first, sums.second)
        )
        spread = np.maximum(second - 2.0 * mean * first + mean * mean * squared, 0.0)
        # `squared` is 1 / the number of rays that count; of a single one nothing is known
        variance = np.where(squared < 0.9, spread / np.maximum(1.0 - squared, 0.1), mean * mean)
        # Neighbours that share rays err alike: what a filter gains on them is what their own rays are worth
        variance *= 1.0 + self.options.reuse
        with np.errstate(divide="ignore", over="ignore"):
            distance = 1.0 / (sums.nearness.reshape(-1).take(pixel) * inverse)
        return GlossyLight(np.ascontiguousarray(radiance.T), known, variance, distance, self.rays)


@dataclass(frozen=True, eq=False)
class _Tier:
    """Pixels that are traced alike: a ray set for every ``stride`` x ``stride`` of them."""

    mask: BoolArray
    stride: int
    rays: int
    reuse: int
    is_mirror: bool = False


@dataclass(frozen=True, eq=False)
class _Band:
    """Rows of a tier's cells, and which of their rays are traced at a time, at most so many together."""

    tier: _Tier
    chosen: slice
    top: int
    bottom: int
    most_rays: int


@dataclass(frozen=True, eq=False)
class _Rays:
    """The rays of a band: their grid, where they start (3, N), go (3, N), and their cones (rays, cells)."""

    tier: _Tier
    grid: RayGrid
    origin: FloatArray
    direction: FloatArray
    spread: FloatArray


def _bands(tier: _Tier) -> Iterator[_Band]:
    """Cut the rays of a tier into bands that each fit into memory."""
    if not tier.mask.any():
        return
    rows, columns = grid_shape(tier.mask.shape, tier.stride)
    at_once = min(tier.rays, max(1, _rays_at_once() // (rows * columns)))
    bands = parallel.split(np.arange(rows), max(1, _rays_at_once() // (at_once * columns)))
    for begin in range(0, tier.rays, at_once):
        chosen = slice(begin, min(begin + at_once, tier.rays))
        for band in bands:
            most_rays = band.size * columns * (chosen.stop - chosen.start)
            yield _Band(tier, chosen, int(band[0]), int(band[-1]) + 1, most_rays)


def _rays_at_once() -> int:
    return parallel.RAYS_AT_ONCE // 2  # one that waits to be resolved takes as much memory again


def _chunks(cells: int, rays: int) -> list[IntArray]:
    return parallel.split(np.arange(cells), max(1, parallel.RAYS_PER_TASK // rays))


def _tiers(roughness: FloatArray, is_active: BoolArray, options: ReflectionSettings) -> Iterator[_Tier]:
    """Sort pixels by roughness: the rougher, the fewer rays."""
    is_mirror = (roughness < ggx.MIRROR_ROUGHNESS) & options.exact_mirrors
    is_rough = (roughness >= ROUGH) & options.roughness_tiers
    stride = STRIDES[options.resolution]
    yield _Tier(is_active & is_mirror, 1, 1, 0, is_mirror=True)
    reuse = options.reuse if stride == 1 else max(options.reuse, _LEAST_REUSE)
    yield _Tier(is_active & ~is_mirror & ~is_rough, stride, options.rays, reuse)
    reuse = max(options.reuse, _LEAST_REUSE)
    yield _Tier(is_active & ~is_mirror & is_rough, min(2 * stride, 4), options.rays, reuse)


def _spread(pdf: FloatArray, samples: int) -> FloatArray:
    """Return the diameter, at distance 1, of the cone that one of some samples stands for.

    Its solid angle is 1 / (samples x pdf) (Křivánek and Colbert 2008, equation 6).
    """
    diameter: FloatArray = 2.0 * np.sqrt(1.0 / (np.pi * samples * pdf))
    return diameter
