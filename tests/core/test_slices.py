# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffuse light by slices of the hemisphere, and by points: closed forms, rays as the truth, conservation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, render_indirect
from ssgi_addon.core.arcs import SECTORS, Receivers, SliceSide, arc
from ssgi_addon.core.interleave import merge_phases, split_phases
from tests.core.synthetic import (
    Plane,
    Sphere,
    capture,
    look_at,
    make_settings,
    random_gbuffer,
    uniform_gbuffer,
)
from tests.core.test_diffuse import corner, patch_integral, room, scenes
from tests.tolerances import (
    ARC_POLYNOMIAL,
    CLOSED_FORM_RELATIVE,
    DRAWN_SECTOR,
    FURNACE,
    LONE_PLANE,
    REPEATED_SUM,
    SLICED_AS_TRACED,
    SLICED_BEYOND,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
SLICED = ("horizon", "bitmask")
WITHOUT_RAYS = [{"method": method} for method in (*SLICED, "ssao")] + [{"traced": False}]


def light_of(
    gbuffer: GBuffer, camera: Camera, environment: Environment | None = None, views=(), **options
) -> IndirectLight:
    names = ("method", "slices", "steps", "traced", "radius", "sky_rays")
    diffuse = {name: options.pop(name) for name in names if name in options}
    settings = make_settings(reflections=False, **options)
    settings = replace(settings, diffuse=replace(settings.diffuse, **diffuse))
    return render_indirect(gbuffer, camera, settings, environment, views)


def sides(camera: Camera, normals: np.ndarray) -> list[tuple[Receivers, SliceSide]]:
    """Sides of slices in eight directions on the screen, through pixels with the given normals (H, W, 3)."""
    gbuffer = uniform_gbuffer(normals.shape[:2], 3.0, normal=normals)
    receivers = Receivers.of(gbuffer, camera, (slice(None), slice(None)))
    angles = np.arange(8) * math.pi / 4.0
    return [(receivers, SliceSide.of(receivers, math.cos(a), math.sin(a))) for a in angles]


@pytest.fixture(params=["perspective", "orthographic"])
def camera(request) -> Camera:
    return (
        Camera.perspective(12, 9, 1.3) if request.param == "perspective" else Camera.orthographic(12, 9, 4.0)
    )


def normals_toward(camera: Camera, rng: np.random.Generator) -> np.ndarray:
    normals = rng.normal(size=(camera.height, camera.width, 3))
    normals[..., 2] = np.abs(normals[..., 2]) + 0.2
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def test_arc_is_its_polynomial():
    theta = np.linspace(0.0, math.pi, 2001)
    off = arc(np.cos(theta)) - (theta - np.sin(theta) * np.cos(theta))
    assert np.abs(off).max() <= ARC_POLYNOMIAL


def test_equal_sectors_carry_equal_light(camera, rng):
    """Against the integral of sin(theta) cos(angle to the normal), by quadrature within the slice."""
    for receivers, side in sides(camera, normals_toward(camera, rng)):
        theta = (np.arange(4000) + 0.5) / 4000 * math.pi
        normal = receivers.normal.astype(np.float64)
        toward, beside = (normal * receivers.view).sum(axis=0), (normal * side.axis).sum(axis=0)
        cosine = toward[:, None] * np.cos(theta) + beside[:, None] * np.sin(theta)
        light = np.maximum(cosine, 0.0) * np.sin(theta)
        total = light.cumsum(axis=1)
        chosen = np.array([400, 1200, 2000, 2600])
        expected = SECTORS * total[:, chosen] / total[:, -1:]
        cotangent = np.repeat(
            1.0 / np.tan(theta[chosen] + 0.5 / 4000 * math.pi)[:, None], normal.shape[1], axis=1
        )
        found = side.sectors(cotangent, np.empty_like(cotangent))
        lit = toward > 0.1
        # Relative to an even hemisphere: a side that holds little light has it in wide sectors
        off = (found.T - expected) * (total[:, -1:] * (math.pi / 4000))
        assert np.abs(off)[lit].max() <= SECTORS * ARC_POLYNOMIAL


def test_direction_of_a_sector_has_passed_as_many(camera, rng):
    for receivers, side in sides(camera, normals_toward(camera, rng)):
        passed = rng.uniform(0.0, SECTORS, receivers.q.size)
        direction = side.direction(passed, receivers.view)
        np.testing.assert_allclose(np.linalg.norm(direction, axis=0), 1.0, atol=REPEATED_SUM)
        along, across = (direction * receivers.view).sum(axis=0), (direction * side.axis).sum(axis=0)
        again = side.sectors((along / np.maximum(across, 1e-9))[None], np.empty((1, passed.size)))[0]
        toward = (receivers.normal * receivers.view).sum(axis=0)
        lit = (toward > 0.1) & (side.weight > 0.2 * side.weight.max())
        assert np.abs(again - passed)[lit].max() <= DRAWN_SECTOR


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 5), (4, 8), (13, 7)])
def test_phases_merge_to_the_image(shape, rng):
    image = rng.random((*shape, 3))
    np.testing.assert_array_equal(merge_phases(split_phases(image), shape), image)


@pytest.mark.parametrize("options", WITHOUT_RAYS, ids=str)
@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("tilt", [0.0, 45.0, 75.0, 85.0, 89.0])
def test_lone_plane_is_open_and_receives_no_bounce(tilt, parallel, options):
    camera = (Camera.orthographic if parallel else Camera.perspective)(48, 36, 0.7)
    for azimuth in np.radians([0.0, 90.0, 215.0]):
        lean = np.sin(np.radians(tilt))
        normal = (lean * np.cos(azimuth), lean * np.sin(azimuth), np.cos(np.radians(tilt)))
        gbuffer = capture(camera, [Plane((0.0, 0.0, -10.0), normal, albedo=1.0, source=1.0)])
        light = light_of(gbuffer, camera, **options)
        assert np.abs(light.visibility - 1.0).max() <= LONE_PLANE
        assert light.diffuse.max() <= LONE_PLANE


@pytest.mark.parametrize("options", WITHOUT_RAYS, ids=str)
@pytest.mark.parametrize("name", list(scenes()))
def test_white_furnace_is_white(name, options):
    """SSAO brings no bounce: there white is what is open."""
    gbuffer, camera = scenes(albedo=1.0, source=1.0)[name]
    light = light_of(gbuffer, camera, WHITE, **options)
    surface = ~gbuffer.is_background
    expected = light.visibility[surface, None] if options.get("method") == "ssao" else 1.0
    if options.get("method") == "ssao":
        assert (light.diffuse[surface] >= expected - FURNACE).all()
    else:
        np.testing.assert_allclose(light.diffuse[surface], expected, atol=FURNACE)


@pytest.mark.parametrize("method", SLICED)
def test_bounce_between_perpendicular_planes_is_the_patch_integral(method):
    gbuffer, camera, is_floor = corner()
    light = light_of(gbuffer, camera, method=method, slices=16, steps=64)
    form_factor = patch_integral(gbuffer, camera, is_floor, ~is_floor)
    rows = np.nonzero(is_floor)[0]
    away = rows > rows.min() + 2
    found = light.diffuse[is_floor][away]
    expected = form_factor[away, None] * np.array([1.0, 2.0, 4.0])
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), rtol=CLOSED_FORM_RELATIVE)
    closed = 1.0 - light.visibility[is_floor][away]
    np.testing.assert_allclose(closed.mean(), form_factor[away].mean(), rtol=CLOSED_FORM_RELATIVE)
    assert (light.diffuse[~is_floor] == 0.0).all()


@pytest.mark.parametrize("name", list(scenes()))
def test_sectors_are_what_rays_find(name):
    """Means over the frame; one pixel's patches are not quite another's."""
    gbuffer, camera = scenes(albedo=0.5, source=lambda p: 1.0 + np.sin(3.0 * p))[name]
    sky = Environment.constant((0.5, 1.0, 2.0))
    truth = light_of(gbuffer, camera, sky, rays=512, unknown="nothing")
    found = light_of(gbuffer, camera, sky, method="bitmask", slices=16, steps=64, unknown="nothing")
    surface = ~gbuffer.is_background
    for values in ("diffuse", "environment_diffuse", "visibility", "known_diffuse"):
        mean, expected = (getattr(light, values)[surface].mean(dtype=float) for light in (found, truth))
        assert mean == pytest.approx(expected, abs=SLICED_AS_TRACED), values


@pytest.mark.parametrize("method", SLICED)
def test_second_bounce_is_the_first_bounce_of_what_the_first_lit(method):
    gbuffer, camera = scenes(albedo=(0.9, 0.5, 0.2), source=lambda p: 1.0 + np.sin(3.0 * p))["room"]
    once = light_of(gbuffer, camera, method=method)
    twice = light_of(gbuffer, camera, method=method, bounces=2)
    lit = replace(gbuffer, source=gbuffer.diffuse_source + gbuffer.albedo * once.diffuse)
    expected = light_of(lit, camera, method=method).diffuse
    np.testing.assert_allclose(twice.diffuse, expected, rtol=REPEATED_SUM, atol=REPEATED_SUM)


def test_more_slices_and_steps_bring_sectors_nearer_to_rays():
    gbuffer, camera = scenes(albedo=0.5, source=lambda p: 1.0 + np.sin(3.0 * p))["room"]
    truth = light_of(gbuffer, camera, rays=512).diffuse
    errors = [
        float(
            ((light_of(gbuffer, camera, method="bitmask", slices=n, steps=8 * n).diffuse - truth) ** 2).mean()
        )
        for n in (1, 2, 4)
    ]
    assert errors == sorted(errors, reverse=True)


def test_horizon_closes_what_sectors_see_behind_a_thin_thing():
    """A bar before a wall: rays pass behind it, a horizon does not."""
    camera = Camera.perspective(64, 48, 1.0)
    bar = Plane((0.0, 0.0, -2.0), (0.0, 0.0, 1.0), bounds=lambda p: np.abs(p[:, 0]) < 0.15)
    wall = Plane((0.0, 0.0, -8.0), (0.0, 0.0, 1.0), albedo=1.0)
    gbuffer = capture(camera, [bar, wall])
    beside = gbuffer.albedo[..., 0] > 0.0
    open_to = {
        method: light_of(gbuffer, camera, method=method, slices=4).visibility[beside].mean()
        for method in ("hemisphere", *SLICED)
    }
    assert open_to["bitmask"] == pytest.approx(open_to["hemisphere"], abs=SLICED_AS_TRACED)
    assert open_to["horizon"] < open_to["bitmask"] - 2.0 * SLICED_AS_TRACED


@pytest.mark.parametrize("method", SLICED)
def test_open_sectors_bring_what_further_views_show(method):
    """A floor below the camera, and the ceiling that only a view upward sees."""
    camera = Camera.perspective(32, 24, 1.2, world_from_view=look_at((0.0, 0.0, 0.0), (0.0, -3.0, -0.1)))
    up = Camera.perspective(32, 32, 2.4, world_from_view=look_at((0.0, 0.0, 0.0), (0.0, 3.0, -0.1)))
    surfaces = [
        Plane((0.0, -2.0, 0.0), (0.0, 1.0, 0.0), albedo=0.8),
        Plane((0.0, 2.0, 0.0), (0.0, 1.0, 0.0), albedo=0.8, source=(1.0, 2.0, 3.0)),
    ]
    gbuffer, views = capture(camera, surfaces), [(capture(up, surfaces), up)]
    traced, sliced = (
        light_of(gbuffer, camera, views=views, rays=64, **options)
        for options in ({}, {"method": method, "slices": 4})
    )
    for values in ("diffuse", "visibility", "known_diffuse"):
        mean, expected = (getattr(light, values).mean(dtype=float) for light in (sliced, traced))
        assert expected > 0.2
        assert mean == pytest.approx(expected, rel=SLICED_BEYOND), values
    further = (
        light_of(gbuffer, camera, views=views, rays=64, bounces=3, **options).diffuse.mean(dtype=float)
        for options in ({}, {"method": method, "slices": 4})
    )
    first, second = further
    assert second == pytest.approx(first, rel=SLICED_BEYOND)


@pytest.mark.parametrize("method", SLICED)
def test_sky_over_open_sectors_has_its_closed_form(method):
    """Under radiance (1 + cos) / 2 about "up" a surface that leans by t receives 1/2 + cos t / 3."""
    up_is_z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    polar = (np.arange(64) + 0.5) / 64 * np.pi
    image = np.broadcast_to(0.5 * (1.0 + np.cos(polar))[:, None, None], (64, 8, 3))
    sky = Environment.equirectangular(image, up_is_z)
    for tilt in (0.0, 50.0):
        normal = (0.0, np.cos(np.radians(tilt)), np.sin(np.radians(tilt)))
        shape = (32, 32)
        gbuffer = uniform_gbuffer(shape, 4.0, normal=np.broadcast_to(normal, (*shape, 3)), direct=0.0)
        light = light_of(gbuffer, Camera.perspective(32, 32, 0.2), sky, method=method, slices=4)
        expected = 0.5 + np.cos(np.radians(tilt)) / 3.0
        np.testing.assert_allclose(light.diffuse.mean(), expected, rtol=2.0 * CLOSED_FORM_RELATIVE)


def test_nothing_beyond_the_largest_distance_covers():
    gbuffer, camera = scenes(albedo=0.5, source=1.0)["room"]
    for method in SLICED:
        light = light_of(gbuffer, camera, method=method, max_distance=1e-3)
        assert np.abs(light.visibility - 1.0).max() <= REPEATED_SUM
        assert (light.diffuse == 0.0).all()
        near = light_of(gbuffer, camera, method=method, max_distance=1.0).visibility.mean()
        assert light_of(gbuffer, camera, method=method).visibility.mean() < near < 1.0


def test_points_darken_corners_and_bring_no_light_without_rays():
    camera = Camera.perspective(48, 36, 1.0)
    gbuffer = capture(camera, room(albedo=0.5, source=1.0))
    light = light_of(gbuffer, camera, WHITE, method="ssao", rays=64, radius=0.3, unknown="nothing")
    assert (light.diffuse == light.environment_diffuse).all()
    depth = gbuffer.depth
    corner_distance = np.minimum(np.abs(depth - 5.0), 10.0)
    floor = gbuffer.normal[..., 1] > 0.5
    near, far = floor & (corner_distance < 0.4), floor & (corner_distance > 1.5)
    assert light.visibility[far].mean() > 0.9
    assert light.visibility[near].mean() < light.visibility[far].mean() - 0.1


def test_untraced_hemisphere_brings_coloured_light_from_blocked_points():
    """As SSDO was published: a red wall makes the floor beside it red, the sky lights the rest."""
    camera = Camera.perspective(48, 36, 1.0)
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    wall = Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), albedo=0.5, source=(1.0, 0.0, 0.0))
    gbuffer = capture(camera, [floor, wall])
    light = light_of(
        gbuffer, camera, Environment.constant((0.0, 0.0, 1.0)), traced=False, rays=256, radius=0.2
    )
    is_floor = gbuffer.normal[..., 1] > 0.5
    by_depth = [is_floor & (np.abs(gbuffer.depth - 5.0) < 0.7), is_floor & (gbuffer.depth < 3.0)]
    near, far = (light.diffuse[where].mean(axis=0) for where in by_depth)
    assert near[0] > 0.1
    assert far[0] == 0.0
    assert near[2] < far[2]
    assert light.rays["diffuse"] == 0


@pytest.mark.parametrize("options", WITHOUT_RAYS, ids=str)
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (13, 21)])
def test_threads_and_odd_sizes_change_no_bit(shape, options, rng, monkeypatch):
    from ssgi_addon.core import slices

    gbuffer = random_gbuffer(rng, shape)
    camera = Camera.perspective(shape[1], shape[0], 1.1)
    one = light_of(gbuffer, camera, WHITE, bounces=3, filter=True, threads=1, **options)
    monkeypatch.setattr(slices, "_PIXELS_PER_TASK", 8)
    many = light_of(gbuffer, camera, WHITE, bounces=3, filter=True, threads=8, **options)
    for values in ("diffuse", "visibility", "known_diffuse", "environment_diffuse"):
        first = getattr(one, values)
        np.testing.assert_array_equal(getattr(many, values), first)
        assert np.isfinite(first).all()
        assert (first >= 0.0).all()


@pytest.mark.parametrize("method", SLICED)
def test_bad_pixels_stay_local(method, rng):
    gbuffer, camera = scenes(albedo=0.5, source=1.0)["room"]
    depth = gbuffer.depth.copy()
    depth[5, 7] = np.nan
    broken = replace(gbuffer, depth=depth)
    before, after = (light_of(g, camera, method=method, slices=2).diffuse for g in (gbuffer, broken))
    assert np.isfinite(after).all()
    assert (after[5, 7] == 0.0).all()
    changed = (np.abs(after - before).max(axis=-1) > 0.05).mean()
    assert changed < 0.05


def test_ball_shades_the_floor_under_it():
    camera = Camera.perspective(64, 48, 1.0, world_from_view=look_at((0.0, 1.5, 3.0), (0.0, 0.0, 0.0)))
    surfaces = [Plane((0, 0, 0), (0, 1, 0), albedo=0.5), Sphere((0.0, 0.5, 0.0), 0.5, albedo=0.5)]
    gbuffer = capture(camera, surfaces)
    for method in SLICED:
        visibility = light_of(gbuffer, camera, method=method, slices=4).visibility
        assert visibility[:, :6].mean() > 0.95
        assert visibility[28:32, 28:36].min() < 0.7
