# SPDX-License-Identifier: GPL-3.0-or-later
"""What a frame needs, and what it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bright_sky import BrightSky
from .environment import Environment
from .gbuffer import GBuffer
from .light import luminance
from .settings import Settings
from .types import BoolArray, IntArray

# Colours below this change no pixel of an 8-bit picture, whatever light they receive within its range.
BLACK = 1e-4


@dataclass(frozen=True, eq=False)
class Plan:
    """Which pixels take which rays, and what is left out.

    Attributes
    ----------
    diffuse, reflections : (P,) int64
        The pixels that take diffuse rays, and those that take reflection rays.
    rough : (P,) int64
        Pixels whose glossy light is their diffuse light, or the fill's where that brings the light.
    skipped
        What is left out, as (what, why).
    bright_sky
        The part of the environment that diffuse light samples with rays of its own, if any.
    is_filled
        A fill brings the light, and diffuse rays tell the visibility at most.
    """

    diffuse: IntArray
    reflections: IntArray
    rough: IntArray
    skipped: tuple[tuple[str, str], ...]
    bright_sky: BrightSky | None = None
    is_filled: bool = False

    @property
    def glossy(self) -> IntArray:
        """(P,) the pixels that have glossy light, in the image's order."""
        if not self.rough.size:
            return self.reflections
        # Both are in order and share no pixel
        return np.sort(np.concatenate([self.reflections, self.rough]), kind="stable")


def plan_passes(
    gbuffer: GBuffer, settings: Settings, environment: Environment | None, *, has_clean_fill: bool = False
) -> Plan:
    """Decide which pixels of a frame need which rays, and say what is left out.

    A clean fill is a denoised one: only that brings light in place of rays.
    """
    is_filled = has_clean_fill and settings.fill_mode == "replace"
    is_surface = ~gbuffer.is_background
    surfaces = int(np.count_nonzero(is_surface))
    skipped: list[tuple[str, str]] = []
    # Later bounces are handed on by gloss, too
    diffuse_color = gbuffer.albedo if settings.diffuse.bounces == 1 else gbuffer.bounce_albedo
    chosen = {}
    for name, color, is_enabled in (
        ("diffuse", diffuse_color, settings.diffuse.enabled),
        ("reflections", gbuffer.specular, settings.reflections.enabled),
    ):
        needed = is_surface & is_colored(color) if is_enabled else np.zeros_like(is_surface)
        chosen[name] = needed
        left_out = surfaces - int(np.count_nonzero(needed))
        if not is_enabled:
            skipped.append((name, "switched off"))
        elif not surfaces:
            skipped.append((name, "no surface in the frame"))
        elif left_out == surfaces:
            skipped.append((name, "no surface in the frame has such a colour"))
        elif left_out:
            skipped.append((f"{name} of {left_out} pixels", "their colour is black"))
    if is_filled:
        is_rough = chosen["reflections"] & (gbuffer.roughness > settings.filled_roughness)
        if not settings.visibility:
            skipped.append(("diffuse rays, visibility", "switched off, and the fill brings the light"))
    else:
        is_rough = _is_rough(gbuffer, settings, chosen["diffuse"], chosen["reflections"])
    reflections, rough = np.flatnonzero(chosen["reflections"] & ~is_rough), np.flatnonzero(is_rough)
    if rough.size:
        what = f"reflections of {rough.size} pixels" if reflections.size else "reflections"
        light = "the fill's" if is_filled else "the diffuse"
        skipped.append((what, f"rougher than the cutoff: they take {light} light"))
    if surfaces < is_surface.size:
        skipped.append((f"{is_surface.size - surfaces} pixels", "background"))
    if environment is None:
        skipped.append(("environment light", "none given, or the direct light already holds it"))
    diffuse, bright_sky = np.flatnonzero(chosen["diffuse"]), None
    if environment is not None and diffuse.size and not is_filled:
        bright_sky = BrightSky.of(environment) if settings.diffuse.sky_rays else None
        if not settings.diffuse.sky_rays:
            skipped.append(("bright sky rays", "switched off"))
        elif bright_sky is None:
            skipped.append(("bright sky rays", "no part of the environment is much brighter than its mean"))
    return Plan(diffuse, reflections, rough, tuple(skipped), bright_sky, is_filled)


def _is_rough(gbuffer: GBuffer, settings: Settings, is_diffuse: BoolArray, is_glossy: BoolArray) -> BoolArray:
    """Return where (H, W) diffuse light stands for glossy light.

    Rays stay where there is no diffuse light, and on rough metals: what is near to the truth on paint, where
    gloss is a small part of the picture, is far from it where gloss is all of it.
    """
    cutoff = settings.reflections.roughness_cutoff
    if cutoff >= 1.0 or settings.diffuse.method == "ssao":
        return np.zeros_like(is_glossy)
    rough: BoolArray = (gbuffer.roughness > cutoff) & is_glossy & is_diffuse
    rough &= luminance(gbuffer.specular) <= luminance(gbuffer.albedo)
    return rough


def is_colored(color: np.ndarray) -> BoolArray:
    """Return where a colour ``(H, W, 3)`` is not as good as black."""
    # Channel by channel: a reduction over three is ten times slower
    colored: BoolArray = color[..., 0] > BLACK
    for channel in (1, 2):
        colored |= color[..., channel] > BLACK
    return colored
