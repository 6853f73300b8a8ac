# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffuse light of samples at one pixel of every cell: what it keeps of the light of samples everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, Settings, bounces, render_indirect
from ssgi_addon.core.cells import STRIDES, chosen_pixels, grid_shape
from ssgi_addon.core.sample_grid import SampleGrid
from tests.core.synthetic import Plane, Sphere, capture, make_settings, random_gbuffer
from tests.tolerances import (
    FEW_SAMPLES_BOUNCES,
    FEW_SAMPLES_MEAN,
    FEW_SAMPLES_PIXEL,
    FURNACE,
    UPSAMPLED_PLANE,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
GRAY = Environment.constant((0.2, 0.2, 0.2))
SIZE = (61, 37)
CAMERA = Camera.perspective(*SIZE, 1.2)
SUN_AND_SKY = np.full((16, 32, 3), 0.2)
SUN_AND_SKY[2, 8] = 200.0


def settings_of(resolution: str, *, method: str = "hemisphere", **options) -> Settings:
    settings = make_settings(reflections=False, **options)
    return replace(settings, diffuse=replace(settings.diffuse, resolution=resolution, method=method))


def room(camera: Camera = CAMERA, **surface) -> GBuffer:
    """A box around the view axis with a ball in it, open toward the camera."""
    walls = [
        Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), **surface),
        Plane((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), **surface),
        Plane((-1.5, 0.0, 0.0), (1.0, 0.0, 0.0), **surface),
        Plane((1.5, 0.0, 0.0), (1.0, 0.0, 0.0), **surface),
        Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), **surface),
    ]
    return capture(camera, [*walls, Sphere((0.3, -0.4, -3.0), 0.5, **surface)])


def lit_corner(size: tuple[int, int] = (192, 144)) -> tuple[GBuffer, Camera]:
    """A floor before a lit wall."""
    camera = Camera.perspective(*size, 1.0)
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    return capture(camera, [floor, Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), source=1.0)]), camera


def images(light: IndirectLight) -> dict[str, np.ndarray]:
    names = ("diffuse", "environment_diffuse", "visibility", "known_diffuse", "known")
    return {name: getattr(light, name) for name in names}


@pytest.mark.parametrize("resolution", STRIDES)
@pytest.mark.parametrize("method", ["hemisphere", "horizon", "bitmask"])
@pytest.mark.parametrize("filter", [False, True])
def test_white_furnace_is_white(resolution, method, filter):
    gbuffer = room(albedo=1.0, source=1.0)
    settings = settings_of(resolution, method=method, rays=4, filter=filter)
    light = render_indirect(gbuffer, CAMERA, settings, WHITE)
    np.testing.assert_allclose(light.diffuse[~gbuffer.is_background], 1.0, atol=FURNACE)


@pytest.mark.parametrize("resolution", ["half", "quarter"])
@pytest.mark.parametrize("method", ["hemisphere", "ssao"])
def test_light_of_few_samples_is_that_of_samples_everywhere(resolution, method):
    gbuffer, camera = lit_corner()
    full, low = (
        render_indirect(gbuffer, camera, settings_of(name, method=method, rays=64, filter=True), GRAY)
        for name in ("full", resolution)
    )
    is_floor = gbuffer.albedo[..., 0] > 0.0
    for expected, found in zip(images(full).values(), images(low).values(), strict=True):
        error = (found - expected)[is_floor]
        assert abs(error.mean(dtype=np.float64)) <= FEW_SAMPLES_MEAN
        assert np.sqrt((error * error).mean(dtype=np.float64)) <= FEW_SAMPLES_PIXEL


@pytest.mark.parametrize("resolution", ["half", "quarter"])
def test_later_bounces_come_from_pixels_without_samples_too(resolution):
    camera = Camera.perspective(122, 74, 1.2)
    gbuffer = room(camera, albedo=0.5, source=1.0)

    def mean(name: str, bounces: int) -> float:
        light = render_indirect(gbuffer, camera, settings_of(name, rays=32, bounces=bounces))
        return float(light.diffuse.mean(dtype=np.float64))

    expected = mean("full", 6)
    assert mean(resolution, 6) == pytest.approx(expected, rel=FEW_SAMPLES_BOUNCES)
    assert mean(resolution, 1) < (1.0 - 5.0 * FEW_SAMPLES_BOUNCES) * expected


@pytest.mark.parametrize("resolution", ["half", "quarter"])
@pytest.mark.parametrize("filter", [False, True])
def test_wires_take_nothing_from_the_wall_behind_them(resolution, filter):
    camera = Camera.perspective(64, 48, 1.0)
    depth = np.full((48, 64), 8.0, dtype=np.float32)
    depth[:, 30], depth[20, :] = 4.0, 4.0
    normal = np.zeros((48, 64, 3), dtype=np.float32)
    normal[..., 2] = 1.0
    gray = np.full((48, 64, 3), 0.5, dtype=np.float32)
    gbuffer = GBuffer(depth, normal, gray, gray, np.ones_like(depth), gray)
    pixels = np.arange(depth.size)
    grid = SampleGrid.of(gbuffer, camera, pixels, STRIDES[resolution], 1)
    is_wire = (depth == 4.0).reshape(-1)
    values = is_wire.take(grid.pixel).astype(np.float32)[:, None]
    if filter:
        variance = np.ones_like(values[:, 0])
        values = grid.filter(gbuffer, camera, [values], variance, 4, 1, 0)[0]
    (found,) = grid.spread([values], 1)
    np.testing.assert_allclose(found[:, 0], is_wire, atol=FURNACE)


def test_gradient_on_a_plane_is_read_between_the_samples(rng):
    camera = Camera.perspective(64, 48, 1.0)
    gbuffer = capture(camera, [Plane((0.0, 0.0, -5.0), (0.3, 0.2, 1.0), albedo=0.5)])
    pixels = np.flatnonzero(~gbuffer.is_background)
    grid = SampleGrid.of(gbuffer, camera, pixels, 4, 1)
    slope = (pixels % 64).astype(np.float32)
    (found,) = grid.spread([slope.take(np.searchsorted(pixels, grid.pixel))], 1)
    inside = (pixels % 64 > 3) & (pixels % 64 < 60)
    assert np.abs(found - slope)[inside].max() <= UPSAMPLED_PLANE


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_every_cell_has_one_of_its_active_pixels_or_none(stride, rng):
    is_active = rng.random((37, 61)) < 0.2
    rows, columns = grid_shape(is_active.shape, stride)
    cells, pixel = chosen_pixels(is_active, stride, 0, rows)
    assert is_active.reshape(-1)[pixel].all()
    np.testing.assert_array_equal(pixel // 61 // stride * columns + pixel % 61 // stride, cells)
    y, x = np.nonzero(is_active)
    np.testing.assert_array_equal(np.unique(y // stride * columns + x // stride), cells)


def test_number_of_rays_follows_the_resolution():
    gbuffer = capture(CAMERA, [Plane((0.0, 0.0, -5.0), (0.2, 0.1, 1.0), albedo=0.5)])
    for resolution, stride in STRIDES.items():
        rays = render_indirect(gbuffer, CAMERA, settings_of(resolution, rays=3)).rays["diffuse"]
        rows, columns = grid_shape(gbuffer.shape, stride)
        assert rays == 3 * rows * columns


@pytest.mark.parametrize("method", ["horizon", "bitmask"])
def test_slices_have_full_resolution_always(method):
    gbuffer = room(albedo=0.5, source=1.0)
    full, low = (
        render_indirect(gbuffer, CAMERA, settings_of(name, method=method, bounces=3), WHITE)
        for name in ("full", "quarter")
    )
    for expected, found in zip(images(full).values(), images(low).values(), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("resolution", ["half", "quarter"])
def test_shadows_of_a_sun_stay_as_sharp_as_they_are(resolution, monkeypatch):
    gbuffer, sky = room(albedo=0.5), Environment.equirectangular(SUN_AND_SKY, np.eye(4))
    shapes = []
    original = bounces.light_from_bright_sky

    def noted(scene, home, bright, settings, pixel, *rest):
        shapes.append(pixel.size)
        return original(scene, home, bright, settings, pixel, *rest)

    monkeypatch.setattr(bounces, "light_from_bright_sky", noted)
    light = render_indirect(gbuffer, CAMERA, settings_of(resolution, bounces=3, filter=True), sky)
    assert shapes == [int((~gbuffer.is_background).sum())]
    assert (light.environment_diffuse <= light.diffuse * (1.0 + FURNACE) + FURNACE).all()


@pytest.mark.parametrize("resolution", ["half", "quarter"])
@pytest.mark.parametrize("method", ["hemisphere", "ssao"])
@pytest.mark.parametrize("size", [(61, 37), (5, 3), (1, 1), (2, 9)])
def test_noise_of_any_size_gives_light_in_range_for_any_threads(resolution, method, size, rng):
    gbuffer, camera = random_gbuffer(rng, (size[1], size[0])), Camera.perspective(*size, 1.0)
    settings = settings_of(resolution, method=method, rays=2, bounces=3, filter=True)
    settings = replace(
        settings, reflections=replace(settings.reflections, enabled=True, resolution=resolution)
    )
    one, two = (
        render_indirect(gbuffer, camera, replace(settings, threads=threads), WHITE) for threads in (1, 2)
    )
    for name, image in images(one).items():
        assert np.isfinite(image).all(), name
        assert (image >= 0.0).all(), name
        np.testing.assert_array_equal(image, getattr(two, name))
    np.testing.assert_array_equal(one.glossy, two.glossy)
    for name in ("visibility", "known_diffuse"):
        assert getattr(one, name).max() <= 1.0 + FURNACE


def test_views_are_sampled_at_the_same_resolution():
    gbuffer = room(albedo=0.5, source=1.0)
    rays = [
        render_indirect(
            gbuffer, CAMERA, settings_of(name, rays=1, bounces=2), views=[(gbuffer, CAMERA)]
        ).rays["views"]
        for name in STRIDES
    ]
    assert rays[0] > 2 * rays[1] > 4 * rays[2]
