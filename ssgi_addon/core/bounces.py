# SPDX-License-Identifier: GPL-3.0-or-later
"""The diffuse pass: the first bounce from samples, later ones from what the samples met, then the filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from . import parallel
from .adaptive import is_adaptive, sample_adaptively
from .bright_sky import BrightSky, light_from_bright_sky
from .cells import STRIDES
from .denoise import GEOMETRIC_LEVELS, filter_light
from .diffuse import DiffuseSamples, sample_hemispheres
from .environment import Environment
from .gbuffer import LARGEST
from .light import fill_unknown
from .planner import is_colored
from .sample_grid import SampleGrid
from .scene import TraceScene
from .settings import Settings
from .slice_samples import SLICED
from .types import FloatArray, IntArray

_LEVELS = 4
# Not blind to luminance at first, as for other light: that blurs a sun's shadow, for 35 times the error.
_BRIGHT_SKY_GEOMETRIC_LEVELS = 0
# Rays per pixel from which one, and from which two more of the filter's passes look at luminance.
_SOME_RAYS, _MANY_RAYS = 8, 16
# Further views only light others: their noise is averaged by the rays that hit them.
_MOST_VIEW_RAYS = 2
# Bounces stop when one adds less than this fraction of the light so far.
LEAST_BOUNCE = 1e-3

Part = Callable[[float, float, str], parallel.Advance]


@dataclass(frozen=True, eq=False)
class DiffuseLight:
    """Diffuse light of P pixels.

    Attributes
    ----------
    radiance, environment : (P, 3)
        Mean over the cosine hemisphere, and the environment's part of it.
    visibility, known : (P,)
        Fraction of open and of answered directions.
    """

    radiance: FloatArray
    environment: FloatArray
    visibility: FloatArray
    known: FloatArray


def geometric_levels(samples: DiffuseSamples) -> int:
    """Return how many of the filter's first passes leave luminance out.

    The more rays of its own a pixel has, the better their spread tells noise from an edge: at contacts, whose
    shadows are narrow, luminance then keeps what geometry cannot see (ADR 3).
    """
    rays = samples.most_own
    return GEOMETRIC_LEVELS - int(rays >= _SOME_RAYS) - int(rays >= _MANY_RAYS)


class DiffusePass:
    """The diffuse light of a frame and of all further views, bounce by bounce.

    Parameters
    ----------
    scene
        All views.
    settings
        How to sample.
    environment
        What escaping directions bring; None brings nothing.
    bright_sky
        What was taken out of the environment to be sampled by rays of its own; None for nothing.
    part
        Makes a callback for a part of the pass: where it begins, its share of the whole, and a text.
    is_reflected
        Keep what `handed_on` returns.
    """

    def __init__(
        self,
        scene: TraceScene,
        settings: Settings,
        environment: Environment | None,
        bright_sky: BrightSky | None,
        part: Part,
        *,
        is_reflected: bool,
    ) -> None:
        self.scene, self.settings, self.environment = scene, settings, environment
        self.bright_sky, self.part, self.is_reflected = bright_sky, part, is_reflected
        self.rays: dict[str, int] = {}
        # By view: the pixels that need light, and where samples are if not at all of them; samples, their
        # variance, light of the bright sky and of all bounces but the last
        self.pixels: dict[int, IntArray] = {}
        self.grids: dict[int, SampleGrid] = {}
        self.samples: dict[int, DiffuseSamples] = {}
        self.variance: dict[int, FloatArray] = {}
        self.bright: dict[int, FloatArray] = {}
        self.earlier: dict[int, FloatArray] = {}

    def trace(self, pixel: IntArray) -> DiffuseLight:
        """Return the light of the frame's given pixels (P,)."""
        settings = self.settings
        source = self.scene.table("diffuse_source")
        samples = self._sample(0, source, settings, pixel, self.part(0.05, 0.5, "Diffuse light"))
        self.rays["diffuse"] = samples.traced
        self._trace_bright_sky(0, pixel, settings.diffuse.sky_rays)
        parts = [self._bounce(source), samples.visibility[:, None]]
        if self.environment is not None:
            parts.append(samples.environment)
        known = np.minimum(self._spread(0, [samples.known])[0], 1.0)
        dark = np.zeros((pixel.size, 3), dtype=self.scene.dtype)
        blind = geometric_levels(samples)
        self.variance = {home: of.variance for home, of in self.samples.items()}
        # What nobody needs any more makes room for the filter
        del source, samples
        self.samples.clear()
        parts = self._smooth(0, parts, blind)
        radiance, visibility = parts[:2]
        environment = parts[2] if len(parts) > 2 else dark
        if self.bright_sky is not None:
            radiance, environment = radiance + self.bright[0], environment + self.bright[0]
        # Shares of slices are rounded up or down by chance: what is lit may pass the whole, and what is left
        # to the sky is less than nothing. Only their sum is right, so nothing is cut off before it.
        radiance, environment = np.maximum(radiance, 0.0), np.maximum(environment, 0.0)
        return DiffuseLight(radiance, environment, np.minimum(visibility[:, 0], 1.0), known)

    def handed_on(self) -> FloatArray:
        """Return the diffuse light (texels + 1, 3) of all bounces but the last, smoothed: mirrors show it."""
        table = np.zeros((self.scene.texels + 1, 3), dtype=self.scene.dtype)
        for home, light in self.earlier.items():
            (light,) = self._smooth(home, [light], GEOMETRIC_LEVELS)
            if self.bright_sky is not None:
                light = light + self.bright[home]
            light = np.maximum(light, 0.0)
            table[self.scene.front_texels(home)][self.pixels[home]] = light
        return table

    def _sample(
        self,
        home: int,
        source: FloatArray,
        settings: Settings,
        pixel: IntArray,
        advance: parallel.Advance | None = None,
    ) -> DiffuseSamples:
        self.pixels[home] = pixel
        stride, pattern, sampled = STRIDES[settings.diffuse.resolution], None, pixel
        if stride > 1 and self.settings.diffuse.method not in SLICED:
            view = self.scene.views[home]
            grid = SampleGrid.of(view.layers[0], view.camera, pixel, stride, settings.threads)
            self.grids[home], sampled, pattern = grid, grid.pixel, grid.pattern
        given = (source, self.environment, settings, sampled, advance)
        samples: DiffuseSamples
        if home == 0 and stride == 1 and is_adaptive(settings):
            samples = sample_adaptively(self.scene, *given)
        else:
            samples = sample_hemispheres(self.scene, home, *given, pattern)
        self.samples[home] = samples
        return samples

    def _sample_views(self, source: FloatArray) -> None:
        """Sample the hemispheres of the further views: they have bounces of their own to hand on."""
        options = self.settings.diffuse
        options = replace(options, method="hemisphere", rays=min(options.rays, _MOST_VIEW_RAYS))
        settings = replace(self.settings, diffuse=options)
        for home in range(1, len(self.scene.views)):
            front = self.scene.views[home].layers[0]
            pixel = np.flatnonzero(~front.is_background & is_colored(front.bounce_albedo))
            if pixel.size:
                samples = self._sample(home, source, settings, pixel)
                self._trace_bright_sky(home, pixel, min(options.sky_rays, _MOST_VIEW_RAYS))
                self.rays["views"] = self.rays.get("views", 0) + samples.traced

    def _bounce(self, source: FloatArray) -> FloatArray:
        """Return the frame's light (P, 3) of all bounces, and keep that of all but the last."""
        frame = self.samples[0]
        first = self._filled(frame, frame.bounce)
        bounces = self.settings.diffuse.bounces if frame.brings_light else 1
        if bounces == 1:
            return first
        self._sample_views(source)
        lights = {home: self._filled(samples, samples.bounce) for home, samples in self.samples.items()}
        handed_on = source.copy()
        for bounce in range(2, bounces + 1):
            for home in self.samples:
                self._hand_on(home, lights[home], source, handed_on)
            before = float(lights[0].sum(dtype=np.float64))
            if self.is_reflected:
                self.earlier = dict(lights)
            # The last bounce is only for the eye
            for home in tuple(self.samples) if bounce < bounces else (0,):
                samples = self.samples[home]
                lights[home] = self._filled(samples, samples.gather(handed_on, self.settings.threads))
            after = float(lights[0].sum(dtype=np.float64))
            if after - before <= LEAST_BOUNCE * after:
                break
        return lights[0]

    def _hand_on(self, home: int, light: FloatArray, source: FloatArray, handed_on: FloatArray) -> None:
        """Write what a view's pixels hand on once its samples have their light: source + albedo x light."""
        texels = self.scene.front_texels(home)
        albedo = self.scene.views[home].layers[0].bounce_albedo.reshape(-1, 3)
        source, handed_on = source[texels], handed_on[texels]
        bright, grid, pixels = self.bright.get(home), self.grids.get(home), self.pixels[home]

        def work(slots: IntArray) -> None:
            where = slice(slots[0], slots[-1] + 1)
            pixel = pixels[where]
            received = light[where] if grid is None else light.take(grid.nearest[where], axis=0)
            if bright is not None:
                received = received + bright[where]
            brighter = source.take(pixel, axis=0) + albedo.take(pixel, axis=0) * received
            # Colours above 1 let light grow from bounce to bounce
            handed_on[pixel] = np.clip(brighter, 0.0, LARGEST, out=brighter)

        parallel.run_chunks(
            work, parallel.split(np.arange(pixels.size), parallel.RAYS_PER_TASK), self.settings.threads
        )

    def _filled(self, samples: DiffuseSamples, bounce: FloatArray) -> FloatArray:
        answered = bounce + samples.environment
        return fill_unknown(answered, samples.known, samples.count, self.settings.unknown)

    def _trace_bright_sky(self, home: int, pixel: IntArray, rays: int) -> None:
        """Find what the environment's brightest part brings to the pixels of a view.

        Its shadows are as sharp as it is small. So its light is smoothed apart from all other, as far as the
        spread among each pixel's own rays shows noise.
        """
        if self.bright_sky is None:
            return
        found = light_from_bright_sky(
            self.scene, home, self.bright_sky, self.settings, pixel, rays,
            self.part(0.55, 0.05, "Bright sky") if home == 0 else None,
        )  # fmt: skip
        light = fill_unknown(found.radiance, found.known, rays, self.settings.unknown)
        if self.settings.diffuse.filter and rays > 1:
            (light,) = self._filter(home, [light], pixel, found.variance, _BRIGHT_SKY_GEOMETRIC_LEVELS)
        self.bright[home] = light
        self.rays["bright sky"] = self.rays.get("bright sky", 0) + found.rays

    def _smooth(self, home: int, parts: list[FloatArray], geometric_levels: int) -> list[FloatArray]:
        """Return the light of all pixels of a view from that of its samples, smoothed if it is to be."""
        variance, view = self.variance[home], self.scene.views[home]
        if home not in self.grids:
            if not self.settings.diffuse.filter:
                return parts
            return self._filter(home, parts, self.pixels[home], variance, geometric_levels)
        if self.settings.diffuse.filter:
            parts = self.grids[home].filter(
                view.layers[0],
                view.camera,
                parts,
                variance,
                _LEVELS,
                self.settings.threads,
                GEOMETRIC_LEVELS - geometric_levels,
            )
        return self._spread(home, parts)

    def _spread(self, home: int, parts: list[FloatArray]) -> list[FloatArray]:
        """Return values of all pixels of a view from those of its samples."""
        grid = self.grids.get(home)
        return parts if grid is None else grid.spread(parts, self.settings.threads)

    def _filter(
        self,
        home: int,
        parts: list[FloatArray],
        pixel: IntArray,
        variance: FloatArray,
        geometric_levels: int,
    ) -> list[FloatArray]:
        view = self.scene.views[home]
        return filter_light(
            view.layers[0],
            view.camera,
            pixel,
            parts,
            variance,
            _LEVELS,
            self.settings.threads,
            geometric_levels,
        )
