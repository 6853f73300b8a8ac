# SPDX-License-Identifier: GPL-3.0-or-later
"""Silhouettes: found at depth and at folds, and no dots and no holes stay on them."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import Camera
from ssgi_addon.core.silhouettes import find_surface_edges, settle_silhouettes
from tests.core.synthetic import Plane, capture
from tests.tolerances import FILTER_RELATIVE, MIXED_LIGHT

CAMERA = Camera.perspective(48, 32, 1.0)
WALL = Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0))
EDGE = np.zeros((32, 48), bool)
EDGE[:, 20:23] = True


@pytest.mark.parametrize("orthographic", [False, True])
def test_steep_plane_has_no_silhouette_and_a_step_has_one(orthographic):
    camera = Camera.orthographic(48, 32, 8.0) if orthographic else CAMERA
    # One that fills the view, 80 degrees off the viewer
    steep = Plane((0.0, 0.0, -50.0), (-0.9848, 0.0, 0.1736))
    gbuffer = capture(camera, [steep])
    covered = ~gbuffer.is_background
    inside = covered[:, :-2] & covered[:, 1:-1] & covered[:, 2:]
    assert inside.any()
    assert not find_surface_edges(gbuffer, camera)[:, 1:-1][inside].any()
    plate = Plane((0.0, 0.0, -4.5), (0.0, 0.0, 1.0), bounds=lambda points: points[:, 0] < 0.0)
    found = find_surface_edges(capture(camera, [plate, WALL]), camera)
    np.testing.assert_array_equal(found.any(axis=0), np.isin(np.arange(48), (23, 24)))
    assert found[:, 23:25].all()


def test_fold_is_one_and_background_is_none():
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    found = find_surface_edges(capture(CAMERA, [floor, WALL]), CAMERA)
    assert found.any(axis=1).sum() == 2
    lonely = Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), bounds=lambda points: points[:, 0] < 0.0)
    gbuffer = capture(CAMERA, [lonely])
    assert not find_surface_edges(gbuffer, CAMERA)[gbuffer.is_background].any()


def test_mixture_takes_each_light_by_its_own_colour():
    """A mirror in light 9 beside paint in light 1: half of each colour gets the light of its owner."""
    paint, mirror, light = (np.zeros((32, 48, 3), np.float32) for _ in range(3))
    paint[:, :21], paint[:, 21], mirror[:, 21], mirror[:, 22:] = 0.8, 0.4, 0.5, 1.0
    is_mixed = np.zeros_like(EDGE)
    is_mixed[:, 21] = True
    for color, expected in ((paint, 1.0), (mirror, 9.0)):
        light[:, :21], light[:, 21], light[:, 22:] = 1.0, 4.0, 9.0
        found = settle_silhouettes(light, color, is_mixed)[:, 21]
        assert np.abs(found - expected).max() < MIXED_LIGHT * abs(4.0 - expected)
        np.testing.assert_array_equal(settle_silhouettes(light, color, is_mixed)[:, :21], 1.0)


def test_dots_and_holes_vanish_at_silhouettes_alone():
    """A dotted line one pixel wide between a dark and a bright side, as mixtures of their passes draw it."""
    light = np.ones((32, 48, 3), np.float32)
    light[:, 22:] = 3.0
    clean = light.copy()
    light[::2, 21], light[1::2, 22] = 40.0, 0.01
    light[7, 40] = 40.0
    found = settle_silhouettes(light, np.full_like(light, 0.5), EDGE)
    assert np.ptp(found[2:-2, 21]) < 0.1 * np.ptp(light[2:-2, 21])
    assert found[2:-2, 22].min() >= 1.0
    np.testing.assert_array_equal(found[:, :20], clean[:, :20])
    assert found[7, 40, 0] == 40.0


def test_even_light_stays_whatever_the_colours(rng):
    light = np.full((32, 48, 3), 2.0, np.float32)
    color = rng.gamma(1.0, 1.0, (1, 1, 3)).astype(np.float32) * np.ones((32, 48, 1), np.float32)
    color[:, 24:] = 0.0
    found = settle_silhouettes(light, color, np.ones_like(EDGE))
    np.testing.assert_allclose(found, light, rtol=FILTER_RELATIVE)
