# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffuse indirect light and visibility: against a brute-force gather, closed forms and conservation."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, diffuse, render_indirect
from ssgi_addon.core.depth_field import DepthField
from tests.core.synthetic import Plane, Sphere, capture, make_settings, random_gbuffer, uniform_gbuffer
from tests.reference.hemisphere_gather import gather
from tests.tolerances import (
    CLOSED_FORM_RELATIVE,
    FURNACE,
    GATHERED_MEAN,
    GATHERED_PIXEL,
    REPEATED_SUM,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))


def light_of(
    gbuffer: GBuffer, camera: Camera, environment: Environment | None = None, **options
) -> IndirectLight:
    return render_indirect(gbuffer, camera, make_settings(reflections=False, **options), environment)


def room(**surface) -> list[Plane]:
    """Five walls of a box around the view axis, open toward the camera."""
    return [
        Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), **surface),
        Plane((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), **surface),
        Plane((-1.5, 0.0, 0.0), (1.0, 0.0, 0.0), **surface),
        Plane((1.5, 0.0, 0.0), (1.0, 0.0, 0.0), **surface),
        Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), **surface),
    ]


def scenes(**surface) -> dict[str, tuple[GBuffer, Camera]]:
    """Convex and concave, with and without background, perspective and parallel."""
    wide, parallel = Camera.perspective(32, 24, 1.2), Camera.orthographic(32, 24, 6.0)
    ball = Sphere((0.2, -0.1, -5.0), 1.5, **surface)
    floor = Plane((0.0, -1.6, 0.0), (0.0, 1.0, 0.0), **surface)
    return {
        "ball": (capture(wide, [ball]), wide),
        "ball, parallel": (capture(parallel, [ball]), parallel),
        "ball over a floor": (capture(wide, [ball, floor]), wide),
        "inside a ball": (capture(wide, [Sphere((0.0, 0.0, -1.0), 4.0, **surface)]), wide),
        "room": (capture(wide, room(**surface)), wide),
    }


SCENES = list(scenes())


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("filter", [False, True])
def test_white_furnace_is_white(name, filter):
    gbuffer, camera = scenes(albedo=1.0, source=1.0)[name]
    light = light_of(gbuffer, camera, WHITE, filter=filter)
    np.testing.assert_allclose(light.diffuse[~gbuffer.is_background], 1.0, atol=FURNACE)
    assert (light.diffuse[gbuffer.is_background] == 0.0).all()


@pytest.mark.parametrize("name", SCENES)
def test_bounces_in_the_white_furnace_rise_toward_white_and_never_past_it(name):
    gbuffer, camera = scenes(albedo=1.0)[name]  # dark surfaces: all light is the environment's
    means, surface = [], ~gbuffer.is_background
    for bounces in (1, 2, 4, 16, 64):
        diffuse = light_of(gbuffer, camera, WHITE, bounces=bounces).diffuse
        assert diffuse.max() <= 1.0 + FURNACE
        means.append(float(diffuse[surface].mean(dtype=np.float64)))
    assert means == sorted(means)
    assert means[-1] > 0.95


@pytest.mark.parametrize("name", SCENES)
def test_the_pass_is_the_brute_force_gather(name, rng):
    gbuffer, camera = scenes(albedo=0.5, source=lambda p: 1.0 + np.sin(3.0 * p))[name]
    sky = Environment.constant((0.5, 1.0, 2.0))
    rays = 1024
    light = light_of(gbuffer, camera, sky, rays=rays, unknown="nothing")
    field = DepthField.build(gbuffer, camera, 0.1)
    rows, columns = np.nonzero(~gbuffer.is_background)
    chosen = rng.permutation(rows.size)[:16]
    errors = []
    for pixel in zip(rows[chosen].tolist(), columns[chosen].tolist(), strict=True):
        truth = gather(
            gbuffer, camera, pixel, gbuffer.diffuse_source,
            thickness=0.1, environment=sky, unknown="nothing", steps=12, field=field,
        )  # fmt: skip
        found = (
            light.diffuse[pixel] - truth.bounce - truth.environment,
            light.environment_diffuse[pixel] - truth.environment,
            light.visibility[pixel] - truth.visibility,
            light.known_diffuse[pixel] - truth.known,
        )
        errors.append([np.abs(error).max() for error in found])
    assert np.max(errors) < GATHERED_PIXEL
    assert np.mean(errors) < GATHERED_MEAN


def corner() -> tuple[GBuffer, Camera, np.ndarray]:
    """A bright wall over a dark floor that meet at a right angle, and where the floor is."""
    camera = Camera.perspective(40, 32, 1.0)
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    wall = Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), albedo=0.5, source=(1.0, 2.0, 4.0))
    gbuffer = capture(camera, [floor, wall])
    return gbuffer, camera, gbuffer.normal[..., 1] > 0.5


def patch_integral(
    gbuffer: GBuffer,
    camera: Camera,
    receivers: np.ndarray,
    emitters: np.ndarray,
    radiance: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Return what emitting pixels bring to each receiving one: sum of radiance cos cos dA / pi r^2."""
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    depth = gbuffer.depth.astype(np.float64)
    position = camera.pixel_to_view(x, y, depth)
    normal = gbuffer.normal.astype(np.float64)
    # A pixel covers depth^2 / (fx fy) facing the camera, more where its surface is askew
    area = radiance * depth**2 / (camera.fx * camera.fy) / np.abs((normal * position).sum(axis=-1) / depth)
    total = np.zeros(int(receivers.sum()))
    for p, n, a in zip(position[emitters], normal[emitters], area[emitters], strict=True):
        offset = p - position[receivers]
        square = (offset**2).sum(axis=1)
        cosines = (offset * normal[receivers]).sum(axis=1) * -(offset * n).sum(axis=1)
        total += np.maximum(cosines, 0.0) * a / (np.pi * square**2)
    return total


def test_bounce_between_perpendicular_planes_is_the_patch_integral():
    gbuffer, camera, is_floor = corner()
    light = light_of(gbuffer, camera, rays=512)
    form_factor = patch_integral(gbuffer, camera, is_floor, ~is_floor)
    # Where a patch is no small thing seen from the floor, the sum over patches is no integral
    rows = np.nonzero(is_floor)[0]
    away = rows > rows.min() + 2
    found = light.diffuse[is_floor][away]
    expected = form_factor[away, None] * np.array([1.0, 2.0, 4.0])
    assert expected.max() > 0.3
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), rtol=CLOSED_FORM_RELATIVE)
    per_row = [slice(None)] if away.sum() < 10 else [rows[away] == row for row in np.unique(rows[away])]
    for row in per_row:
        np.testing.assert_allclose(
            found[row].mean(axis=0), expected[row].mean(axis=0), rtol=3 * CLOSED_FORM_RELATIVE
        )
    # The wall alone closes the floor's hemisphere
    closed = 1.0 - light.visibility[is_floor][away]
    np.testing.assert_allclose(closed.mean(), form_factor[away].mean(), rtol=CLOSED_FORM_RELATIVE)
    assert (light.diffuse[~is_floor] == 0.0).all()  # the floor is dark


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("tilt", [0.0, 45.0, 75.0, 85.0, 89.0])
def test_lone_plane_is_open_and_receives_no_bounce(tilt, parallel):
    camera = (Camera.orthographic if parallel else Camera.perspective)(48, 36, 0.7)
    for azimuth in np.radians([0.0, 90.0, 215.0]):
        lean = np.sin(np.radians(tilt))
        normal = (lean * np.cos(azimuth), lean * np.sin(azimuth), np.cos(np.radians(tilt)))
        gbuffer = capture(camera, [Plane((0.0, 0.0, -10.0), normal, albedo=1.0, source=1.0)])
        light = light_of(gbuffer, camera, rays=64)
        assert (light.visibility == 1.0).all()
        assert (light.diffuse == 0.0).all()


@pytest.mark.parametrize("tilt", [0.0, 50.0, 100.0, 180.0])
def test_light_of_a_sky_gradient_has_its_closed_form(tilt):
    """Under radiance (1 + cos) / 2 about "up" a surface that leans by t receives 1/2 + cos t / 3."""
    up_is_z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # view +Y becomes world +Z
    polar = (np.arange(64) + 0.5) / 64 * np.pi
    image = np.broadcast_to(0.5 * (1.0 + np.cos(polar))[:, None, None], (64, 8, 3))
    sky = Environment.equirectangular(image, up_is_z)
    normal = (0.0, np.cos(np.radians(tilt)), np.sin(np.radians(tilt)))
    shape = (16, 16)
    gbuffer = uniform_gbuffer(shape, 4.0, normal=np.broadcast_to(normal, (*shape, 3)), direct=0.0)
    light = light_of(gbuffer, Camera.perspective(16, 16, 1.0), sky, rays=64)
    expected = 0.5 + np.cos(np.radians(tilt)) / 3.0
    np.testing.assert_allclose(light.diffuse.mean(axis=(0, 1)), expected, rtol=CLOSED_FORM_RELATIVE)


def test_second_bounce_is_the_first_bounce_of_what_the_first_lit():
    gbuffer, camera = scenes(albedo=(0.9, 0.5, 0.2), source=lambda p: 1.0 + np.sin(3.0 * p))["room"]
    once = light_of(gbuffer, camera, rays=8)
    twice = light_of(gbuffer, camera, rays=8, bounces=2)
    lit = replace(gbuffer, source=gbuffer.diffuse_source + gbuffer.albedo * once.diffuse)
    np.testing.assert_allclose(twice.diffuse, light_of(lit, camera, rays=8).diffuse, rtol=REPEATED_SUM)


def test_bounces_fall_at_least_as_fast_as_the_albedo_and_sum_to_less_than_the_series():
    albedo = 0.6
    gbuffer, camera = scenes(albedo=albedo, source=1.0)["room"]
    lights = [light_of(gbuffer, camera, rays=32, bounces=n).diffuse.astype(np.float64) for n in range(1, 6)]
    assert (lights[-1] > 0.0).any()
    for n, light in enumerate(lights, start=1):
        assert light.max() <= sum(albedo**k for k in range(n)) * (1.0 + REPEATED_SUM)
    added = [lights[0], *(after - before for before, after in itertools.pairwise(lights))]
    for before, after in itertools.pairwise(added):
        assert after.max() <= albedo * before.max() * (1.0 + REPEATED_SUM)
        assert after.min() >= -REPEATED_SUM


def test_bounced_energy_is_at_most_what_surfaces_reflect():
    """In an open room with bright walls the mean light falls short of that of a closed one."""
    gbuffer, camera = scenes(albedo=0.5, source=1.0)["inside a ball"]
    light = light_of(gbuffer, camera, rays=32, bounces=64)
    assert light.diffuse.max() <= 2.0 * (1.0 + REPEATED_SUM)  # source / (1 - albedo)


def test_no_albedo_means_no_rays_and_no_light():
    gbuffer, camera = scenes(source=1.0)["room"]
    light = light_of(gbuffer, camera, WHITE)
    assert (light.diffuse == 0.0).all()
    assert light.rays["diffuse"] == 0
    assert (light.visibility == 1.0).all()
    assert (light.known_diffuse == 1.0).all()


def test_unknown_directions_bring_what_the_settings_say():
    camera = Camera.perspective(24, 16, 1.0)
    gbuffer = capture(camera, [Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=1.0)])
    sky = Environment.constant((2.0, 2.0, 2.0))
    seen = ~gbuffer.is_background
    found = {
        name: light_of(gbuffer, camera, sky, rays=64, unknown=name)
        for name in ("environment", "nothing", "mean")
    }
    known = found["nothing"].known_diffuse[seen]
    assert 0.0 < known.mean() < 0.9
    np.testing.assert_allclose(found["environment"].diffuse[seen], 2.0, rtol=REPEATED_SUM)
    np.testing.assert_allclose(
        found["nothing"].diffuse[seen], 2.0 * known[:, None] * np.ones(3), rtol=REPEATED_SUM
    )
    np.testing.assert_allclose(found["mean"].diffuse[seen], 2.0, rtol=REPEATED_SUM)
    for light in found.values():
        np.testing.assert_array_equal(light.known_diffuse[seen], known)
        assert (light.visibility == 1.0).all()


def test_mean_of_no_answers_is_nothing():
    gbuffer = uniform_gbuffer((6, 8), 3.0)  # all rays go back past the camera
    light = light_of(gbuffer, Camera.perspective(8, 6, 1.0), WHITE, unknown="mean")
    assert (light.known_diffuse == 0.0).all()
    assert (light.diffuse == 0.0).all()


def test_environment_part_is_what_no_surface_handed_on():
    gbuffer, camera = scenes(albedo=0.5, source=1.0)["ball over a floor"]
    lit, dark = (
        light_of(gbuffer, camera, WHITE),
        light_of(replace(gbuffer, source=0 * gbuffer.direct), camera, WHITE),
    )
    np.testing.assert_array_equal(lit.environment_diffuse, dark.diffuse)
    np.testing.assert_allclose(
        lit.diffuse - lit.environment_diffuse, light_of(gbuffer, camera).diffuse, atol=REPEATED_SUM
    )
    assert (light_of(gbuffer, camera).environment_diffuse == 0.0).all()


def test_more_rays_are_less_noise(rng):
    gbuffer, camera = scenes(albedo=0.5, source=1.0)["room"]
    truth = light_of(gbuffer, camera, rays=1024, seed=99).diffuse
    errors = [
        float(((light_of(gbuffer, camera, rays=rays).diffuse - truth) ** 2).mean()) for rays in (4, 16, 64)
    ]
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]


def test_filter_brings_few_rays_nearer_to_many():
    gbuffer, camera = scenes(albedo=0.5, source=1.0)["room"]
    truth = light_of(gbuffer, camera, rays=1024, seed=99).diffuse
    raw, smooth = (light_of(gbuffer, camera, rays=4, filter=is_smooth).diffuse for is_smooth in (False, True))
    assert ((smooth - truth) ** 2).mean() < 0.5 * ((raw - truth) ** 2).mean()


def test_seed_changes_the_noise_and_not_the_mean():
    gbuffer, camera = scenes(albedo=0.5, source=1.0)["room"]
    one, other = (light_of(gbuffer, camera, rays=64, seed=seed).diffuse for seed in (1, 2))
    assert (one != other).any()
    assert one.mean() == pytest.approx(float(other.mean()), rel=CLOSED_FORM_RELATIVE)


def test_depth_and_colour_of_noise_give_light_in_range(rng):
    gbuffer = random_gbuffer(rng, (21, 33))
    light = light_of(gbuffer, Camera.perspective(33, 21, 1.0), WHITE, bounces=3, filter=True)
    assert np.isfinite(light.diffuse).all()
    for image in (light.visibility, light.known_diffuse, light.known):
        assert image.min() >= 0.0
        assert image.max() <= 1.0
    assert (light.environment_diffuse <= light.diffuse + REPEATED_SUM).all()


def test_variance_is_that_of_the_mean_of_independent_samples(rng):
    values = rng.gamma(0.5, 2.0, (7, 50))
    expected = values.var(axis=0, ddof=1) / 7
    np.testing.assert_allclose(diffuse.variance_of_mean(values), expected, rtol=REPEATED_SUM)
    # One sample says nothing of its own noise
    np.testing.assert_array_equal(diffuse.variance_of_mean(values[:1]), values[0] ** 2)
