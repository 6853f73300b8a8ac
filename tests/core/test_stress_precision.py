# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes in float32 beside the same code in float64: rounding must not show."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.inputs import analytic_room
from benchmarks.stability import METHODS, compare_precisions, in_double, settings_by_name
from ssgi_addon.core import Camera, Environment, GBuffer, Settings, ggx, render_indirect
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.lobes import Lobes
from tests.core.synthetic import Plane, capture, make_settings, uniform_gbuffer
from tests.core.test_pipeline import IMAGES
from tests.tolerances import (
    FLOAT32_LARGEST,
    FLOAT32_LIGHT,
    FLOAT32_MIRROR_ANGLE,
    FLOAT32_RAYS_CHANGED,
    FLOAT32_RAYS_MOVED,
    FLOAT32_SECTORS,
    FLOAT32_THIN_SLAB,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))


def assert_alike(found: dict, light: float = FLOAT32_LIGHT, largest: float = FLOAT32_LARGEST) -> None:
    assert found["changed"] <= FLOAT32_RAYS_CHANGED
    assert found["moved"] <= FLOAT32_RAYS_MOVED
    assert found["rays"] > 1000
    for name, image in found["images"].items():
        assert image["percentile"] <= light, name
        assert image["largest"] <= largest, name


@functools.cache
def room_by(name: str) -> dict:
    frame = analytic_room(160, 120)
    return compare_precisions(frame.gbuffer, frame.camera, settings_by_name()[name], WHITE)


@pytest.mark.parametrize("method", [*METHODS, "cones"])
def test_light_of_an_interior_is_that_of_double_precision(method):
    assert_alike(room_by(method), *FLOAT32_SECTORS.get(method, ()))


def test_passes_as_they_are_used_are_those_of_double_precision():
    """With neighbours' rays, six bounces and filters, away from what rays changed."""
    assert_alike(room_by("balanced"))


@pytest.mark.parametrize("distance", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("is_orthographic", [False, True])
def test_light_on_planes_at_any_tilt_and_distance_is_that_of_double_precision(distance, is_orthographic):
    make = Camera.orthographic if is_orthographic else Camera.perspective
    camera = make(96, 64, 5.0 * distance if is_orthographic else 0.9)
    lean = np.radians(85.0)
    look = {"albedo": 0.5, "specular": 0.5, "roughness": 0.3, "source": lambda p: 1.0 + np.sin(p / distance)}
    surfaces = [
        Plane((0.0, -distance, -6.0 * distance), (0.0, np.sin(lean), np.cos(lean)), **look),
        Plane((0.0, 0.0, -9.0 * distance), (0.2, 0.0, 1.0), **look),
    ]
    settings = settings_by_name()["hemisphere"]
    assert_alike(compare_precisions(capture(camera, surfaces), camera, settings, WHITE))


@pytest.mark.parametrize("roughness", [0.0, 0.031, 0.1, 0.5, 1.0])
def test_lobes_of_any_roughness_are_those_of_double_precision(roughness):
    camera = Camera.perspective(96, 64, 0.9)
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), specular=1.0, roughness=roughness)
    wall = Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), source=lambda p: 1.5 + np.sin(2.0 * p))
    settings = make_settings(rays=8, diffuse=False, glossy={"reuse": 4, "subpixel": True})
    assert_alike(compare_precisions(capture(camera, [floor, wall]), camera, settings, WHITE))


def test_double_precision_stays_double():
    frame = analytic_room(24, 18)
    light = render_indirect(in_double(frame.gbuffer), frame.camera, Settings(), WHITE)
    for name in IMAGES:
        assert getattr(light, name).dtype == np.float64, name


def test_mirror_that_faces_the_camera_reflects_straight_back():
    """The cosine of a small angle holds nothing of it in single precision."""
    angle = np.geomspace(1e-5, 0.5, 200)
    normal = np.stack([np.zeros_like(angle), np.zeros_like(angle), np.ones_like(angle)])
    view = np.stack([np.sin(angle) * 0.6, np.sin(angle) * 0.8, np.cos(angle)])
    lobes = Lobes.at(*(part.astype(np.float32) for part in (normal, view)), np.zeros(200, np.float32))
    zero = np.zeros((1, 200), np.float32)
    direction, _ = lobes.draw(zero, zero, True)
    expected = np.stack([-view[0], -view[1], view[2]])
    assert np.abs(direction[:, 0] - expected).max() <= FLOAT32_MIRROR_ANGLE


@pytest.mark.parametrize("roughness", [0.01, 0.03, 0.2, 1.0])
def test_drawn_directions_and_densities_are_those_of_double_precision(roughness, rng):
    u, v = rng.random((2, 64, 500)).astype(np.float32)
    v[0], v[1] = 0.0, 1.0 - 2.0**-24  # the lobe's middle and its end
    angle = rng.uniform(0.0, 1.57, 500)
    view = np.stack([np.sin(angle), np.zeros(500), np.cos(angle)]).astype(np.float32)
    alpha = np.full(500, max(roughness**2, 1e-4), np.float32)
    found = ggx.sample_visible_normal(view, alpha, u, v)
    exact = ggx.sample_visible_normal(*(part.astype(np.float64) for part in (view, alpha, u, v)))
    # Beside the normal, in units of the lobe's width
    off = np.abs(found - exact)[:2] / np.maximum(alpha, np.abs(exact[:2]))
    assert off.max() <= FLOAT32_LIGHT


@pytest.mark.parametrize("depth", [0.01, 10.0, 1e4])
@pytest.mark.parametrize("share", [1e-7, 1e-5, 1e-2, 10.0, np.inf])
def test_captured_thickness_keeps_its_digits_however_thin(depth, share):
    thickness = np.full((3, 4), depth * share)
    gbuffer = replace(uniform_gbuffer((3, 4), depth), thickness=thickness)
    field = DepthField.build(gbuffer, Camera.perspective(4, 3, 1.0), 0.1)
    z, t = np.float64(np.float32(depth)), np.float64(np.float32(depth * share))
    expected = 1.0 / z if np.isinf(t) else t / (z * (z + t))
    np.testing.assert_allclose(field.slab, expected, rtol=FLOAT32_THIN_SLAB)


def test_normals_of_any_length_are_as_good_as_unit_ones():
    """Passes that average normals at silhouettes hold short ones; directions alone count."""
    rng = np.random.default_rng(2)
    frame = analytic_room(48, 36)
    length = rng.uniform(0.01, 1.0, frame.gbuffer.shape)[..., None]
    names = ("depth", "albedo", "specular", "roughness", "direct")
    passes = {name: getattr(frame.gbuffer, name) for name in names}
    short = GBuffer(normal=frame.gbuffer.normal.astype(np.float64) * length, **passes)
    settings = make_settings(rays=4, bounces=2, filter=True)
    lights = [render_indirect(of, frame.camera, settings, WHITE) for of in (frame.gbuffer, short)]
    for name in ("diffuse", "glossy", "visibility"):
        mean = getattr(lights[0], name).mean(dtype=np.float64)
        assert getattr(lights[1], name).mean(dtype=np.float64) == pytest.approx(mean, rel=FLOAT32_LIGHT), name
