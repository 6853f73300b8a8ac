# SPDX-License-Identifier: GPL-3.0-or-later
"""From a G-buffer to its indirect light: plan, trace, bounce, smooth."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import parallel, reflections
from .bounces import DiffuseLight, DiffusePass
from .camera import Camera
from .denoise import filter_light
from .environment import Environment
from .fill import Fill
from .fill_level import Answered, handed_on_by_fill, light_of_fill, set_level
from .gbuffer import LARGEST, GBuffer
from .light import IndirectLight, fill_unknown, luminance
from .planner import Plan, plan_passes
from .scene import TraceScene, View
from .settings import Settings
from .silhouettes import find_surface_edges, settle_silhouettes
from .types import FloatArray, IntArray

# Shares of light that are left out are told from here on.
_TOLD = 5e-5
# How diffuse rays are taken where a fill brings the light.
_FOR_VISIBILITY: dict[str, Any] = {"resolution": "quarter", "rays": 4, "bounces": 1, "adaptive": 0.0}
# Width of the part of a lobe that holds most of its light, per unit of distance and of alpha.
_BLUR_PER_ALPHA = 1.0
# In place of an endless width.
_WIDE = 1e30
# Roughness from which lobes take one filter pass, two, and so on.
_LOBE_STEPS = (0.05, 0.12, 0.25, 0.45)


def render_indirect(
    gbuffer: GBuffer,
    camera: Camera,
    settings: Settings,
    environment: Environment | None = None,
    views: Sequence[View] = (),
    progress: parallel.Progress | None = None,
    fill: Fill | None = None,
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
    fill
        Path-traced light of a small image: it brings the light or sets the level of what rays answered, as
        `Settings.fill_mode` says. It does not count as known.

    Returns
    -------
    IndirectLight
        Of the frame's size, float32, without NaN, infinite or negative values; the same for any number of
        threads.

    Raises
    ------
    ValueError
        If an argument is of the wrong type, or G-buffer and camera differ in size.
    """
    _check_types(gbuffer, camera, settings, environment, views, fill)
    with parallel.saturating():
        run = _Run(gbuffer, camera, settings, environment, progress, fill)
        if run.plan.is_filled:
            run.take_fill(views)
        else:
            run.take_rays(views)
        run.report(1.0, "Done")
        return run.result()


def _check_types(
    gbuffer: object, camera: object, settings: object, environment: object, views: object, fill: object
) -> None:
    expected = (("gbuffer", gbuffer, GBuffer), ("camera", camera, Camera), ("settings", settings, Settings))
    for name, value, kind in expected:
        if not isinstance(value, kind):
            raise ValueError(f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    if environment is not None and not isinstance(environment, Environment):
        raise ValueError(f"environment: expected Environment or None, got {type(environment).__name__}")
    if fill is not None and not isinstance(fill, Fill):
        raise ValueError(f"fill: expected Fill or None, got {type(fill).__name__}")
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
    # The method that `scene` is made for
    walked_by = ""

    def __init__(
        self,
        gbuffer: GBuffer,
        camera: Camera,
        settings: Settings,
        environment: Environment | None,
        progress: parallel.Progress | None,
        fill: Fill | None,
    ) -> None:
        self.gbuffer, self.camera, self.settings, self.environment = gbuffer, camera, settings, environment
        self.progress, self.fill, self.dtype = progress, fill, gbuffer.depth.dtype
        # Images of the result by name, each made once there is light for it
        self.images: dict[str, FloatArray] = {}
        is_clean = fill is not None and fill.is_denoised
        self.plan = plan_passes(gbuffer, settings, environment, has_clean_fill=is_clean)
        # Light that was left out of the fill, as (what, why)
        self.dimmed: list[tuple[str, str]] = []
        # What the pixels of all views hand on to mirrors beside their source
        self.handed_on: FloatArray | None = None
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

    def take_rays(self, views: Sequence[View]) -> None:
        """Find the light by rays; a fill sets its level."""
        plan, method = self.plan, self.settings.reflections.method
        self._see(views, "hierarchical" if plan.diffuse.size else method)
        with self.timed("diffuse"):
            self._trace_diffuse(plan.diffuse)
        if plan.reflections.size:
            self._see(views, method)
        with self.timed("reflections"):
            self._keep_rough()
            self._trace_reflections(plan.reflections)
        if self.fill is not None:
            with self.timed("fill"):
                self._level(self.fill)

    def take_fill(self, views: Sequence[View]) -> None:
        """Take the light of the fill, and trace what is reflected more sharply."""
        assert self.fill is not None
        seen, mirrors = self.plan.diffuse, self.plan.reflections
        with self.timed("fill"):
            self._spread(self.fill)
        if seen.size and self.settings.visibility:
            self._see(views, "hierarchical")
            with self.timed("diffuse"):
                self._trace_visibility(seen)
        if mirrors.size:
            self._see(views, self.settings.reflections.method)
            with self.timed("reflections"):
                self.handed_on = handed_on_by_fill(self.fill, self.scene, self.images, self.settings.threads)
                self._trace_reflections(mirrors)
        with self.timed("fill"):
            is_silhouette = find_surface_edges(self.gbuffer, self.camera)
            for name, color in (("diffuse", self.gbuffer.albedo), ("glossy", self.gbuffer.specular)):
                self.images[name] = settle_silhouettes(self.images[name], color, is_silhouette)

    def _see(self, views: Sequence[View], method: str) -> None:
        """Make the scene that rays walk by a method, unless it is there already."""
        if method == self.walked_by:
            return
        with self.timed("pyramid"):
            self.scene = TraceScene(self.gbuffer, self.camera, views, self.settings, method=method)
        self.walked_by = method

    def _trace_diffuse(self, pixels: IntArray) -> None:
        """Make diffuse, environment_diffuse, visibility and known_diffuse, and keep what mirrors show."""
        if not pixels.size:
            return
        work = DiffusePass(
            self.scene, self.settings, self.dim_sky, self.plan.bright_sky, self._advance,
            is_reflected=self.plan.reflections.size > 0,
        )  # fmt: skip
        light = self._trace_hemispheres(work, pixels)
        self._keep("diffuse", pixels, light.radiance)
        self._keep("environment_diffuse", pixels, light.environment)
        if self.plan.reflections.size:
            self.handed_on = self.scene.table("bounce_albedo") * work.handed_on()

    def _trace_visibility(self, pixels: IntArray) -> None:
        """Make visibility and known_diffuse by rays that bring no light: few are enough for both."""
        diffuse = replace(self.settings.diffuse, **_FOR_VISIBILITY)
        settings = replace(self.settings, diffuse=diffuse)
        work = DiffusePass(self.scene, settings, None, None, self._advance, is_reflected=False)
        self._trace_hemispheres(work, pixels)
        # Lobes so wide know about as much as the hemisphere
        known = self.images["known_diffuse"].reshape(-1).take(self.plan.glossy)
        self._keep("known_glossy", self.plan.glossy, known, elsewhere=1.0)

    def _trace_hemispheres(self, work: DiffusePass, pixels: IntArray) -> DiffuseLight:
        """Trace diffuse rays; keep what they tell beside light."""
        light = work.trace(pixels)
        self.rays |= work.rays
        self._keep("visibility", pixels, light.visibility, elsewhere=1.0)
        self._keep("known_diffuse", pixels, light.known, elsewhere=1.0)
        return light

    def _trace_reflections(self, pixels: IntArray) -> None:
        """Make glossy and known_glossy."""
        if not pixels.size:
            return
        settings = self.settings
        source = self.scene.table("reflection_source")
        if self.handed_on is not None:
            source += self.handed_on
            np.minimum(source, LARGEST, out=source)
            self.handed_on = None
        found = reflections.reflect_light(
            self.scene, source, self.environment, settings, pixels,
            self._advance(0.65, 0.3, "Reflections"),
        )  # fmt: skip
        self.rays["reflections"] = found.rays
        self._keep("known_glossy", pixels, found.known, elsewhere=1.0)
        if self.plan.is_filled:
            around = self.images["glossy"].reshape(-1, 3).take(pixels, axis=0)
            parts = [found.radiance + np.maximum(1.0 - found.known, 0.0)[:, None] * around]
        else:
            parts = [fill_unknown(found.radiance, found.known, settings.reflections.rays, settings.unknown)]
        if settings.reflections.filter:
            levels, variance = self._lobe_levels(pixels, found.distance), found.variance
            del source, found  # as large as all that the filter needs
            parts = filter_light(self.gbuffer, self.camera, pixels, parts, variance, levels, settings.threads)
        self._keep("glossy", pixels, parts[0])

    def _keep_rough(self) -> None:
        """Let surfaces that are too rough for rays of their own have their diffuse light as glossy light."""
        pixels = self.plan.rough
        if not pixels.size:
            return
        diffuse, known = self.images["diffuse"], self.images["known_diffuse"]
        self._keep("glossy", pixels, diffuse.reshape(-1, 3).take(pixels, axis=0))
        self._keep("known_glossy", pixels, known.reshape(-1).take(pixels), elsewhere=1.0)

    def _spread(self, fill: Fill) -> None:
        """Make diffuse and glossy of a fill alone; no ray knows of it."""
        self.report(0.05, "Fill")
        kinds = {"diffuse": self.plan.diffuse, "glossy": self.plan.glossy}
        needed = np.union1d(*kinds.values())
        frame, threads = (self.gbuffer, self.camera), self.settings.threads
        *lights, _ = light_of_fill(fill, frame, needed, threads, is_loose=True)
        for (name, pixels), light in zip(kinds.items(), lights, strict=True):
            slots = slice(None) if pixels.size == needed.size else np.searchsorted(needed, pixels)
            self._keep(name, pixels, light[slots])
            self._keep(f"known_{name}", pixels, np.zeros(pixels.size, self.dtype), elsewhere=1.0)

    def _level(self, fill: Fill) -> None:
        """Bring diffuse and glossy light to the level of a fill."""
        self.report(0.95, "Fill")
        frame = self.gbuffer, self.camera
        dimmed: dict[str, float] = {}
        levelled = level_by_fill(self.images, self.plan, frame, fill, self.settings.threads, dimmed)
        for name, pixel, light in levelled:
            self._keep(name, pixel, light)
        self.dimmed = [
            (f"{share:.2%} of the fill's {name} light", "of single pixels that outshine all around them")
            for name, share in dimmed.items()
            if share >= _TOLD
        ]

    def _keep(self, name: str, pixels: IntArray, values: FloatArray, elsewhere: float = 0.0) -> None:
        """Write values (P, ...) of some pixels into an image of the result."""
        height, width = self.gbuffer.shape
        shape = (height, width, *values.shape[1:])
        if name not in self.images:
            self.images[name] = np.full(shape, elsewhere, dtype=self.dtype)
        self.images[name].reshape(height * width, *shape[2:])[pixels] = values

    def _image(self, name: str) -> FloatArray:
        """Return an image of the result; black, open and known where there is no light to tell of."""
        if name not in self.images:
            is_light = name in ("diffuse", "environment_diffuse", "glossy")
            nothing = np.zeros((0, 3) if is_light else 0, dtype=self.dtype)
            self._keep(name, np.empty(0, np.int64), nothing, elsewhere=0.0 if is_light else 1.0)
        return self.images[name]

    def _lobe_levels(self, pixels: IntArray, distance: FloatArray) -> NDArray[np.int8]:
        """Return how many filter passes lobes take: reflections are blurred less than they are wide.

        What is near to the surface is reflected sharply: a lobe's blur is as wide on the screen as its cone
        is at the distance of what it reflects, seen from as far as the mirror image is.
        """
        roughness = self.gbuffer.roughness.reshape(-1).take(pixels)
        levels = lobe_passes(self.gbuffer, pixels)
        if self.settings.reflections.contact_hardening:
            if self.camera.is_orthographic:
                width = np.minimum(distance, _WIDE)
            else:
                depth = self.gbuffer.depth.reshape(-1).take(pixels)
                with np.errstate(invalid="ignore"):
                    width = np.where(np.isinf(distance), 1.0, distance / (depth + distance))
            width = width * (_BLUR_PER_ALPHA * roughness * roughness * max(self.camera.fx, self.camera.fy))
            reach = np.floor(np.log2(np.clip(width, 0.5, _WIDE))).astype(np.int64) + 1
            levels = np.minimum(levels, reach)
        return np.maximum(levels, 0).astype(np.int8)

    def result(self) -> IndirectLight:
        """Return all images."""
        weight_diffuse, weight_glossy = luminance(self.gbuffer.albedo), luminance(self.gbuffer.specular)
        total = weight_diffuse + weight_glossy
        known = weight_diffuse * self._image("known_diffuse") + weight_glossy * self._image("known_glossy")
        known = np.where(total > 0.0, known / np.where(total > 0.0, total, 1.0), 1.0)
        known[self.gbuffer.is_background] = 1.0
        names = ("diffuse", "glossy", "visibility", "known_diffuse", "known_glossy", "environment_diffuse")
        return IndirectLight(
            **{name: self._image(name) for name in names},
            known=np.minimum(known, 1.0).astype(self.dtype),
            skipped=(*self.plan.skipped, *self.dimmed),
            seconds=dict(self.seconds),
            rays=dict(self.rays),
        )


def level_by_fill(
    images: Mapping[str, FloatArray],
    plan: Plan,
    frame: tuple[GBuffer, Camera],
    fill: Fill,
    threads: int | None,
    dimmed: dict[str, float] | None = None,
) -> list[tuple[str, IntArray, FloatArray]]:
    """Return pixels (P,) and light (P, 3) at the level of a fill, by the names of the images.

    Parameters
    ----------
    images
        Those of `IndirectLight` before there was a fill, by name.
    plan, frame
        That they were made by and for.
    fill, threads
        As in `set_level`.
    dimmed
        Receives the shares that `set_level` tells, by name.
    """
    kinds = {"diffuse": plan.diffuse, "glossy": plan.glossy}
    kinds = {name: pixel for name, pixel in kinds.items() if pixel.size}
    if not kinds:
        return []
    lights = [
        Answered(
            images[name].reshape(-1, 3).take(pixel, axis=0),
            images[f"known_{name}"].reshape(-1).take(pixel),
            pixel,
            getattr(fill, name),
            lobe_passes(frame[0], pixel) if name == "glossy" else len(_LOBE_STEPS),
        )
        for name, pixel in kinds.items()
    ]
    shares: list[float] = []
    levelled = set_level(lights, frame, fill, threads, shares)
    if dimmed is not None:
        dimmed.update(zip(kinds, shares, strict=True))
    return [(name, pixel, light) for (name, pixel), light in zip(kinds.items(), levelled, strict=True)]


def lobe_passes(gbuffer: GBuffer, pixel: IntArray) -> NDArray[np.int64]:
    """Return how many passes of the filter the lobes of pixels (P,) are wide, 0 for mirrors."""
    return np.searchsorted(_LOBE_STEPS, gbuffer.roughness.reshape(-1).take(pixel), side="right")


@dataclass
class _Timer:
    seconds: dict[str, float]
    name: str
    begun: float = field(default=0.0)

    def __enter__(self) -> None:
        self.begun = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        spent = time.perf_counter() - self.begun
        self.seconds[self.name] = self.seconds.get(self.name, 0.0) + spent
