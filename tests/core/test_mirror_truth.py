# SPDX-License-Identifier: GPL-3.0-or-later
"""Mirrors before a textured wall against their reflections in closed form, through the whole pass."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ssgi_addon.core import Settings, render_indirect
from tests.core.mirror_scenes import LENSES, SCENES
from tests.core.synthetic import capture
from tests.reference.mirror_truth import Mirrored, mirror_at
from tests.tolerances import MIRROR_EDGE_LIGHT, MIRROR_LIGHT_OF_CONTRAST, MIRROR_VISIBLE_KNOWN

WIDTH, HEIGHT = 480, 270


@dataclass(frozen=True)
class Shown:
    """What a mirror's pixels show (N, 3), how much of it is known (N,), and what they should show."""

    radiance: np.ndarray
    known: np.ndarray
    truth: Mirrored
    contrast: np.ndarray  # (3,) of what is textured

    @property
    def error(self) -> float:
        """Mean absolute error of the known visible reflections, relative to the contrast."""
        counts = self.truth.is_visible & (self.known == 1.0)
        return float((np.abs(self.radiance - self.truth.radiance) / self.contrast)[counts].mean())

    @property
    def visible_known(self) -> float:
        """Share of the reflections that the camera could see elsewhere in the frame and that are known."""
        return float(self.known[self.truth.is_visible].mean())


@functools.cache
def show(scene: str, lens: str) -> Shown:
    """Render a scene's mirror with default settings, without diffuse light."""
    build, mirror = SCENES[scene]
    camera, surfaces = LENSES[lens](WIDTH, HEIGHT), build()
    gbuffer = capture(camera, surfaces)
    settings = Settings()
    settings = replace(settings, diffuse=replace(settings.diffuse, enabled=False))
    light = render_indirect(gbuffer, camera, settings)
    is_mirror = gbuffer.specular[..., 0] > 0.0
    pixel = np.flatnonzero(is_mirror)
    truth = mirror_at(camera, surfaces, pixel)
    mine = np.flatnonzero(truth.owner == mirror)
    return Shown(
        light.glossy.reshape(-1, 3)[pixel[mine]],
        light.known_glossy.reshape(-1)[pixel[mine]],
        truth.only(mine),
        np.ptp(gbuffer.direct[~is_mirror & ~gbuffer.is_background], axis=0),
    )


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("scene", ["mirror floor", "bumped wall", "mirror ball"])
def test_mirror_shows_the_wall_where_and_as_it_is(scene, lens):
    shown = show(scene, lens)
    assert shown.truth.is_visible.sum() > 3000
    assert shown.visible_known >= MIRROR_VISIBLE_KNOWN
    assert shown.error <= MIRROR_LIGHT_OF_CONTRAST


@pytest.mark.parametrize("lens", LENSES)
def test_mirror_floor_shows_nothing_where_there_is_nothing(lens):
    shown = show("mirror floor", lens)
    is_sky = shown.truth.surface < 0
    assert is_sky.sum() > 5000
    assert (shown.radiance[is_sky].max(axis=1) > 0.0).mean() <= MIRROR_EDGE_LIGHT
