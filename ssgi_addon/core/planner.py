# SPDX-License-Identifier: GPL-3.0-or-later
"""What a frame needs, and what it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bright_sky import BrightSky
from .environment import Environment
from .gbuffer import GBuffer
from .settings import Settings
from .types import BoolArray, IntArray

# Colours below this change no pixel of an 8-bit picture, whatever light they receive within its range.
BLACK = 1e-4


@dataclass(frozen=True, eq=False)
class Plan:
    """The pixels that take diffuse and reflection rays, and what is left out as (what, why).

    `bright_sky` is the part of the environment that diffuse light samples with rays of its own, if any.
    """

    diffuse: IntArray
    reflections: IntArray
    skipped: tuple[tuple[str, str], ...]
    bright_sky: BrightSky | None = None


def plan_passes(gbuffer: GBuffer, settings: Settings, environment: Environment | None) -> Plan:
    """Decide which pixels of a frame need which rays, and say what is left out."""
    is_surface = ~gbuffer.is_background
    surfaces = int(is_surface.sum())
    skipped: list[tuple[str, str]] = []
    chosen = {}
    # Later bounces are handed on by gloss, too
    diffuse_color = gbuffer.albedo if settings.diffuse.bounces == 1 else gbuffer.bounce_albedo
    for name, color, is_enabled in (
        ("diffuse", diffuse_color, settings.diffuse.enabled),
        ("reflections", gbuffer.specular, settings.reflections.enabled),
    ):
        chosen[name] = np.flatnonzero(is_surface & is_colored(color) & is_enabled)
        left_out = surfaces - chosen[name].size
        if not is_enabled:
            skipped.append((name, "switched off"))
        elif not surfaces:
            skipped.append((name, "no surface in the frame"))
        elif not chosen[name].size:
            skipped.append((name, "no surface in the frame has such a colour"))
        elif left_out:
            skipped.append((f"{name} of {left_out} pixels", "their colour is black"))
    if surfaces < is_surface.size:
        skipped.append((f"{is_surface.size - surfaces} pixels", "background"))
    if environment is None:
        skipped.append(("environment light", "none given, or the direct light already holds it"))
    bright_sky = None
    if environment is not None and chosen["diffuse"].size:
        bright_sky = BrightSky.of(environment) if settings.diffuse.sky_rays else None
        if not settings.diffuse.sky_rays:
            skipped.append(("bright sky rays", "switched off"))
        elif bright_sky is None:
            skipped.append(("bright sky rays", "no part of the environment is much brighter than its mean"))
    return Plan(chosen["diffuse"], chosen["reflections"], tuple(skipped), bright_sky)


def is_colored(color: np.ndarray) -> BoolArray:
    """Return where a colour ``(H, W, 3)`` is not as good as black."""
    return color.max(axis=-1) > BLACK
