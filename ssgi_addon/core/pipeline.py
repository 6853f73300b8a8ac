# SPDX-License-Identifier: GPL-3.0-or-later
"""From a G-buffer to its indirect light: plan, trace, bounce, smooth."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from . import diffuse, ggx, parallel, reflections
from .bright_sky import light_from_bright_sky
from .camera import Camera
from .denoise import GEOMETRIC_LEVELS, filter_light
from .environment import Environment
from .gbuffer import GBuffer
from .light import IndirectLight, luminance
from .planner import is_colored, plan_passes
from .scene import TraceScene, View
from .settings import Settings
from .types import FloatArray, IntArray

_DIFFUSE_LEVELS = 4
# Not blind to luminance at first, as for other light: that blurs a sun's shadow, for 35 times the error.
_BRIGHT_SKY_GEOMETRIC_LEVELS = 0
# Further views only light others: their noise is averaged by the rays that hit them.
_MOST_VIEW_RAYS = 2
# Width of the part of a lobe that holds most of its light, per unit of distance and of alpha.
_BLUR_PER_ALPHA = 1.0
# Bounces stop when one adds less than this fraction of the light so far.
_LEAST_BOUNCE = 1e-3


def render_indirect(
    gbuffer: GBuffer,
    camera: Camera,
    settings: Settings,
    environment: Environment | None = None,
    views: Sequence[View] = (),
    progress: parallel.Progress | None = None,
) -> IndirectLight:
    """Compute the indirect light of a frame.

    Parameters
    ----------
    gbuffer, camera
        The frame.
    settings
        How to sample; see `Settings.preset`.
    environment
        Radiance that escaping rays bring; None where the direct light already counts it, or there is none.
    views
        Further (GBuffer, Camera) pairs, placed by `Camera.world_from_view`, that rays continue in.
    progress
        Called with the finished fraction and a text, in this thread; may raise to cancel.

    Raises
    ------
    ValueError
        If an argument is of the wrong type, or G-buffer and camera differ in size.
    """
    _check_types(gbuffer, camera, settings, environment, views)
    run = _Run(gbuffer, camera, settings, environment, progress)
    plan = run.plan
    walk = "hierarchical" if plan.diffuse.size else settings.reflections.method
    with run.timed("pyramid"):
        run.scene = TraceScene(gbuffer, camera, views, settings, method=walk)
    with run.timed("diffuse"):
        run.trace_diffuse(plan.diffuse)
    with run.timed("reflections"):
        if settings.reflections.method != walk and plan.reflections.size:
            run.scene = TraceScene(gbuffer, camera, views, settings, method=settings.reflections.method)
        run.trace_reflections(plan.reflections)
    run.report(1.0, "Done")
    return run.result()


def _check_types(
    gbuffer: object, camera: object, settings: object, environment: object, views: object
) -> None:
    expected = (("gbuffer", gbuffer, GBuffer), ("camera", camera, Camera), ("settings", settings, Settings))
    for name, value, kind in expected:
        if not isinstance(value, kind):
            raise ValueError(f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    if environment is not None and not isinstance(environment, Environment):
        raise ValueError(f"environment: expected Environment or None, got {type(environment).__name__}")
    if not isinstance(views, Sequence):
        raise ValueError(f"views: expected a sequence of (GBuffer, Camera), got {type(views).__name__}")
    for view in views:
        if not (isinstance(view, tuple) and len(view) == 2):
            raise ValueError(f"views: expected pairs (GBuffer, Camera), got {type(view).__name__}")
        if not (isinstance(view[0], GBuffer) and isinstance(view[1], Camera)):
            raise ValueError(
                f"views: expected (GBuffer, Camera), got ({type(view[0]).__name__}, {type(view[1]).__name__})"
            )


class _Run:
    """The arrays of one call of `render_indirect`, filled step by step."""

    scene: TraceScene
    earlier_bounces: FloatArray
    bright_light: FloatArray

    def __init__(
        self,
        gbuffer: GBuffer,
        camera: Camera,
        settings: Settings,
        environment: Environment | None,
        progress: parallel.Progress | None,
    ) -> None:
        self.gbuffer, self.camera, self.settings, self.environment = gbuffer, camera, settings, environment
        self.progress = progress
        height, width = gbuffer.shape
        dtype = gbuffer.depth.dtype
        self.diffuse = np.zeros((height * width, 3), dtype=dtype)
        self.environment_diffuse = np.zeros_like(self.diffuse)
        self.glossy = np.zeros_like(self.diffuse)
        self.visibility = np.ones(height * width, dtype=dtype)
        self.known_diffuse = np.ones_like(self.visibility)
        self.known_glossy = np.ones_like(self.visibility)
        self.samples: dict[int, diffuse.HemisphereSamples] = {}  # by view
        self.plan = plan_passes(gbuffer, settings, environment)
        # What rays over the hemisphere look up where they escape
        self.dim_sky = self.plan.bright_sky.rest if self.plan.bright_sky else environment
        self.seconds: dict[str, float] = {}
        self.rays: dict[str, int] = {"diffuse": 0, "reflections": 0}

    def report(self, fraction: float, text: str) -> None:
        if self.progress is not None:
            self.progress(fraction, text)

    def _advance(self, begin: float, share: float, text: str) -> parallel.Advance:
        """Return a callback that fills a part of the whole."""
        return lambda fraction: self.report(begin + share * fraction, text)

    def timed(self, name: str) -> _Timer:
        return _Timer(self.seconds, name)

    def trace_diffuse(self, pixels: IntArray) -> None:
        """Fill diffuse, environment_diffuse, visibility, known_diffuse, earlier_bounces and bright_light."""
        scene, settings = self.scene, self.settings
        # Diffuse light of all bounces but the last, for every texel: what hits hand on with their source
        self.earlier_bounces = np.zeros((scene.texels + 1, 3), dtype=self.diffuse.dtype)
        if not pixels.size:
            return
        source = scene.table("diffuse_source")
        samples = self.samples[0] = diffuse.sample_hemispheres(
            scene, 0, source, self.dim_sky, settings, pixels,
            self._advance(0.05, 0.5, "Diffuse light"),
        )  # fmt: skip
        self.rays["diffuse"] = pixels.size * settings.diffuse.rays
        self.visibility[pixels] = samples.visibility
        self.known_diffuse[pixels] = samples.known
        self.environment_diffuse[pixels] = samples.environment
        self._trace_bright_sky(0, pixels, settings.diffuse.sky_rays)
        self.diffuse[pixels] = self._bounce(source)
        if settings.diffuse.filter:
            self._smooth_diffuse(samples)
        if self.plan.bright_sky is not None:
            bright_light = self.bright_light[scene.front_texels(0)]
            self.diffuse += bright_light
            self.environment_diffuse += bright_light

    def _trace_bright_sky(self, home: int, pixels: IntArray, rays: int) -> None:
        """Fill a view's part of bright_light: what the environment's brightest part brings to each texel.

        Its shadows are as sharp as it is small. So its light is smoothed apart from all other, as far as the
        spread among each pixel's own rays shows noise.
        """
        if self.plan.bright_sky is None:
            return
        scene, settings = self.scene, self.settings
        if home == 0:
            self.bright_light = np.zeros_like(self.earlier_bounces)
        found = light_from_bright_sky(
            scene, home, self.plan.bright_sky, settings, pixels, rays,
            self._advance(0.55, 0.05, "Bright sky") if home == 0 else None,
        )  # fmt: skip
        texels = scene.front_texels(home)
        self.bright_light[texels][pixels] = self._fill(found.radiance, found.known, rays)
        if settings.diffuse.filter and rays > 1:
            self.bright_light[texels] = self._smooth(
                home, self.bright_light[texels], pixels, found.variance, _DIFFUSE_LEVELS,
                _BRIGHT_SKY_GEOMETRIC_LEVELS,
            )  # fmt: skip
        self.rays["bright sky"] = self.rays.get("bright sky", 0) + found.rays

    def _sample_views(self, source: FloatArray) -> None:
        """Sample the hemispheres of the further views: they have bounces of their own to hand on."""
        rays = min(self.settings.diffuse.rays, _MOST_VIEW_RAYS)
        settings = replace(self.settings, diffuse=replace(self.settings.diffuse, rays=rays))
        for home in range(1, len(self.scene.views)):
            front = self.scene.views[home].layers[0]
            pixels = np.flatnonzero(~front.is_background & is_colored(front.albedo))
            if pixels.size:
                self.samples[home] = diffuse.sample_hemispheres(
                    self.scene, home, source, self.dim_sky, settings, pixels
                )
                self._trace_bright_sky(home, pixels, min(settings.diffuse.sky_rays, _MOST_VIEW_RAYS))
                self.rays["views"] = self.rays.get("views", 0) + pixels.size * rays

    def _bounce(self, source: FloatArray) -> FloatArray:
        """Return the frame's light of all bounces, and keep that of all but the last in `earlier_bounces`."""
        frame = self.samples[0]
        lights = {0: self._first_bounce(frame)}
        bounces = self.settings.diffuse.bounces
        if bounces == 1:
            return lights[0]
        albedo = self.scene.table("albedo")
        self._sample_views(source)
        if self.plan.bright_sky is not None:
            source = source + albedo * self.bright_light
        lights = {home: self._first_bounce(samples) for home, samples in self.samples.items()}
        for bounce in range(2, bounces + 1):
            for home, samples in self.samples.items():
                self.earlier_bounces[self.scene.front_texels(home)][samples.pixel] = lights[home]
            handed_on = source + albedo * self.earlier_bounces
            # The last bounce is only for the eye
            homes = self.samples if bounce < bounces else (0,)
            brighter = {home: self._next_bounce(self.samples[home], handed_on) for home in homes}
            added = float((brighter[0] - lights[0]).sum(dtype=np.float64))
            lights |= brighter
            if added <= _LEAST_BOUNCE * float(lights[0].sum(dtype=np.float64)):
                break
        return lights[0]

    def _first_bounce(self, samples: diffuse.HemisphereSamples) -> FloatArray:
        return self._fill(samples.bounce + samples.environment, samples.known, samples.hit.shape[0])

    def _next_bounce(self, samples: diffuse.HemisphereSamples, handed_on: FloatArray) -> FloatArray:
        bounce = diffuse.gather_bounce(samples, handed_on, self.settings.threads)
        return self._fill(bounce + samples.environment, samples.known, samples.hit.shape[0])

    def _fill(self, answered: FloatArray, known: FloatArray, rays: int) -> FloatArray:
        """Give unknown samples the mean of the pixel's answered ones where the settings ask for it.

        The frame's own mean counts as one more answered sample, for pixels with none or few.
        """
        if self.settings.unknown != "mean":
            return answered
        total = float(known.sum(dtype=np.float64))
        overall = answered.sum(axis=0, dtype=np.float64) / total if total else np.zeros(3)
        one = 1.0 / rays
        mean = (answered + (overall * one).astype(answered.dtype)) / (known + one)[:, None]
        return answered + (1.0 - known)[:, None] * mean

    def _smooth_diffuse(self, samples: diffuse.HemisphereSamples) -> None:
        signal = np.concatenate([self.diffuse, self.environment_diffuse, self.visibility[:, None]], axis=1)
        smooth = self._smooth(0, signal, samples.pixel, samples.variance, _DIFFUSE_LEVELS)
        self.diffuse, self.environment_diffuse = smooth[:, :3].copy(), smooth[:, 3:6].copy()
        self.visibility = np.minimum(smooth[:, 6], 1.0)

    def _smooth(
        self,
        home: int,
        signal: FloatArray,
        pixel: IntArray,
        variance: FloatArray,
        levels: NDArray[np.int8] | int,
        geometric_levels: int = GEOMETRIC_LEVELS,
    ) -> FloatArray:
        """Smooth a view's signal (pixels, C); variance and filter levels belong to the listed pixels."""
        view = self.scene.views[home]
        height, width = view.layers[0].shape
        variances = np.zeros(height * width, dtype=signal.dtype)
        variances[pixel] = variance
        level_map = np.zeros(height * width, dtype=np.int8)
        level_map[pixel] = levels
        shape = (height, width)
        smooth = filter_light(
            view.layers[0], view.camera, signal.reshape(*shape, -1), variances.reshape(shape),
            level_map.reshape(shape), self.settings.threads, geometric_levels,
        )  # fmt: skip
        return smooth.reshape(height * width, -1)

    def _smooth_earlier_bounces(self) -> None:
        """Smooth what hits hand on to reflections: mirrors show single pixels of it."""
        for home, samples in self.samples.items():
            texels = self.scene.front_texels(home)
            self.earlier_bounces[texels] = self._smooth(
                home, self.earlier_bounces[texels], samples.pixel, samples.variance, _DIFFUSE_LEVELS
            )

    def trace_reflections(self, pixels: IntArray) -> None:
        """Fill glossy and known_glossy."""
        if not pixels.size:
            return
        if self.settings.diffuse.filter:
            self._smooth_earlier_bounces()
        source = self.scene.table("reflection_source")
        if self.plan.bright_sky is not None and self.settings.diffuse.bounces > 1:
            self.earlier_bounces += self.bright_light
        source += self.scene.table("albedo") * self.earlier_bounces
        found = reflections.reflect_light(
            self.scene, source, self.environment, self.settings, pixels,
            self._advance(0.65, 0.3, "Reflections"),
        )  # fmt: skip
        self.rays["reflections"] = found.rays
        self.known_glossy[pixels] = found.known
        self.glossy[pixels] = self._fill(found.radiance, found.known, self.settings.reflections.rays)
        if self.settings.reflections.filter:
            levels, variance = self._lobe_levels(pixels, found.distance), found.variance
            del source, found  # as large as all that the filter needs
            self.glossy = self._smooth(0, self.glossy, pixels, variance, levels)

    def _lobe_levels(self, pixels: IntArray, distance: FloatArray) -> NDArray[np.int8]:
        """Return how many filter passes lobes take: reflections are blurred less than they are wide.

        What is near to the surface is reflected sharply: a lobe's blur is as wide on the screen as its cone
        is at the distance of what it reflects, seen from as far as the mirror image is.
        """
        roughness = self.gbuffer.roughness.reshape(-1).take(pixels)
        levels = np.searchsorted([ggx.MIRROR_ROUGHNESS, 0.05, 0.12, 0.25, 0.45], roughness, side="right") - 1
        if self.settings.reflections.contact_hardening:
            with np.errstate(invalid="ignore"):
                depth = self.gbuffer.depth.reshape(-1).take(pixels)
                seen_from = 1.0 if self.camera.is_orthographic else depth + distance
                width = np.where(np.isinf(distance), 1.0, distance / seen_from)
            width = width * (_BLUR_PER_ALPHA * roughness * roughness * max(self.camera.fx, self.camera.fy))
            reach = np.floor(np.log2(np.maximum(width, 0.5))).astype(np.int64) + 1
            levels = np.minimum(levels, reach)
        return np.maximum(levels, 0).astype(np.int8)

    def result(self) -> IndirectLight:
        height, width = self.gbuffer.shape
        weight_diffuse = luminance(self.gbuffer.albedo.reshape(-1, 3))
        weight_glossy = luminance(self.gbuffer.specular.reshape(-1, 3))
        total = weight_diffuse + weight_glossy
        known = weight_diffuse * self.known_diffuse + weight_glossy * self.known_glossy
        known = np.where(total > 0.0, known / np.where(total > 0.0, total, 1.0), 1.0)
        known[self.gbuffer.is_background.reshape(-1)] = 1.0
        return IndirectLight(
            diffuse=_image(self.diffuse, (height, width, 3)),
            glossy=_image(self.glossy, (height, width, 3)),
            visibility=_image(self.visibility, (height, width)),
            known_diffuse=_image(self.known_diffuse, (height, width)),
            known_glossy=_image(self.known_glossy, (height, width)),
            known=_image(np.minimum(known, 1.0), (height, width)),
            environment_diffuse=_image(self.environment_diffuse, (height, width, 3)),
            skipped=self.plan.skipped,
            seconds=dict(self.seconds),
            rays=dict(self.rays),
        )


@dataclass
class _Timer:
    seconds: dict[str, float]
    name: str
    begun: float = field(default=0.0)

    def __enter__(self) -> None:
        self.begun = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.seconds[self.name] = time.perf_counter() - self.begun


def _image(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    return np.ascontiguousarray(values, dtype=np.float32).reshape(shape)
