# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed forms of the diffuse pass as users run it: at the preset "final", with the filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, Settings, bounces, render_indirect
from tests.core.synthetic import Plane, Sphere, capture, look_at
from tests.core.test_diffuse import patch_integral, scenes
from tests.tolerances import (
    BALL_BELOW_HORIZON,
    BALL_BOUNCE,
    CLOSED_FORM_RELATIVE,
    CLOSED_FORM_RMS,
    CONTACT_BIAS,
    CONTACT_ERROR_LEFT,
    FILTERED_BEFORE_WALL,
    FURNACE_BOUNCED,
    LONE_PLANE,
    REPEATED_SUM,
    SUN_IN_UMBRA,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
METHODS = {
    "hemisphere": {},
    "bitmask": {"method": "bitmask", "slices": 8, "steps": 48},
    "horizon": {"method": "horizon", "slices": 8, "steps": 48},
}
# World +Z, an image's zenith, is +Y of these scenes.
UP_IS_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def final(*, reflections: bool = False, unknown: str = "environment", **diffuse) -> Settings:
    base = Settings.preset("final")
    return replace(
        base,
        unknown=unknown,
        diffuse=replace(base.diffuse, **diffuse),
        reflections=replace(base.reflections, enabled=reflections),
    )


def light_of(
    gbuffer: GBuffer, camera: Camera, environment: Environment | None = None, views=(), **options
) -> IndirectLight:
    return render_indirect(gbuffer, camera, final(**options), environment, views)


def errors(found: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Return bias and root mean square error, relative to the mean."""
    off = found.astype(np.float64) - expected
    return abs(off.mean()) / expected.mean(), np.sqrt((off**2).mean()) / expected.mean()


def world_points(gbuffer: GBuffer, camera: Camera) -> np.ndarray:
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    depth = np.where(gbuffer.is_background, 1.0, gbuffer.depth).astype(np.float64)
    pose = camera.world_from_view
    return camera.pixel_to_view(x, y, depth) @ pose[:3, :3].T + pose[:3, 3]


def corner(size: tuple[int, int], every: int = 1) -> tuple[GBuffer, Camera, np.ndarray, np.ndarray]:
    """A lit wall on a dark floor, some of the floor's pixels, and what the wall's pixels bring to them."""
    camera = Camera.perspective(*size, 1.0, world_from_view=look_at((0.0, 3.0, 5.0), (0.0, 0.6, 0.0)))
    floor = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    wall = Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), source=1.0)
    gbuffer = capture(camera, [floor, wall])
    is_floor = gbuffer.albedo[..., 0] > 0.0
    # Where a patch is no small thing seen from the floor, the sum over patches is no integral
    first = int(np.nonzero(is_floor)[0].min()) + 3
    chosen = np.zeros_like(is_floor)
    chosen[first::every, ::every] = True
    return gbuffer, camera, chosen, patch_integral(gbuffer, camera, chosen, ~is_floor)


@pytest.fixture(scope="module")
def small_corner():
    return corner((96, 72))


@pytest.fixture(scope="module")
def large_corner():
    return corner((192, 144), every=3)


@pytest.mark.parametrize("method", METHODS)
def test_bounce_between_perpendicular_planes_is_the_patch_integral(method, large_corner):
    gbuffer, camera, chosen, expected = large_corner
    light = light_of(gbuffer, camera, **METHODS[method])
    # The wall alone closes the floor's hemisphere, and its light is 1
    for found in (light.diffuse[chosen][:, 0], 1.0 - light.visibility[chosen]):
        bias, rms = errors(found, expected)
        assert bias <= CLOSED_FORM_RELATIVE
        assert rms <= CLOSED_FORM_RMS


@pytest.mark.parametrize("method", METHODS)
def test_filter_brightens_what_stands_a_few_pixels_before_a_wall(method, small_corner):
    gbuffer, camera, chosen, expected = small_corner
    raw, smooth = (light_of(gbuffer, camera, filter=f, **METHODS[method]) for f in (False, True))
    assert errors(raw.diffuse[chosen][:, 0], expected)[0] <= CLOSED_FORM_RELATIVE
    for found in (smooth.diffuse[chosen][:, 0], 1.0 - smooth.visibility[chosen]):
        bias, rms = errors(found, expected)
        assert bias <= FILTERED_BEFORE_WALL[0]
        assert rms <= FILTERED_BEFORE_WALL[1]
    bias, rms = errors(smooth.visibility[chosen], 1.0 - expected)
    assert bias <= CLOSED_FORM_RELATIVE
    assert rms <= CLOSED_FORM_RMS


EYE, CENTRE, RADIUS = np.array([0.0, 2.6, 3.4]), np.array([0.0, 1.1, 0.0]), 0.8


def lit_from_the_camera(points: np.ndarray) -> np.ndarray:
    """Fade toward the ball's rim, whose far side nobody sees."""
    toward = EYE - points
    cosine = ((points - CENTRE) * toward).sum(axis=1) / (RADIUS * np.linalg.norm(toward, axis=1))
    return np.maximum(cosine, 0.0)[:, None] * np.ones(3)


@pytest.fixture(scope="module")
def ball() -> tuple[GBuffer, Camera, np.ndarray]:
    """A lit ball over a dark floor with its own thickness per pixel, and where the ball is."""
    camera = Camera.perspective(160, 120, 0.9, world_from_view=look_at(EYE, (0.0, 0.5, 0.0)))
    sphere = Sphere(CENTRE, RADIUS, source=lit_from_the_camera)
    gbuffer = capture(camera, [Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5), sphere])
    alone = capture(camera, [sphere], layers=2)
    is_ball = ~alone.is_background
    with np.errstate(invalid="ignore"):
        thickness = np.where(is_ball, alone.behind.depth - alone.depth, np.inf)
    return replace(gbuffer, thickness=thickness), camera, is_ball


@pytest.fixture(scope="module")
def light_of_ball(ball) -> np.ndarray:
    """What the ball's pixels bring to the floor's."""
    gbuffer, camera, is_ball = ball
    radiance = gbuffer.direct[..., 0].astype(np.float64)
    return patch_integral(gbuffer, camera, ~is_ball & ~gbuffer.is_background, is_ball, radiance)


@pytest.mark.parametrize("method", METHODS)
def test_floor_under_a_ball_is_as_open_as_its_closed_form(method, ball):
    """A whole ball of radius r at distance d closes (r / d)² cos t, t from the normal to its centre."""
    gbuffer, camera, is_ball = ball
    is_floor = ~is_ball & ~gbuffer.is_background
    offset = CENTRE - world_points(gbuffer, camera)[is_floor]
    distance = np.linalg.norm(offset, axis=1)
    expected = 1.0 - (RADIUS / distance) ** 2 * offset[:, 1] / distance
    assert expected.min() < 0.6
    found = light_of(gbuffer, camera, **METHODS[method]).visibility[is_floor]
    bounds = (CLOSED_FORM_RELATIVE, CLOSED_FORM_RMS) if method != "horizon" else BALL_BELOW_HORIZON
    bias, rms = errors(found, expected)
    assert bias <= bounds[0]
    assert rms <= bounds[1]


@pytest.mark.parametrize("method", METHODS)
def test_light_of_a_ball_is_the_patch_integral_of_what_is_seen_of_it(method, ball, light_of_ball):
    gbuffer, camera, is_ball = ball
    is_floor, expected = ~is_ball & ~gbuffer.is_background, light_of_ball
    lit = expected > 0.1 * expected.max()
    found = light_of(gbuffer, camera, **METHODS[method]).diffuse[is_floor][:, 0]
    bias, rms = errors(found[lit], expected[lit])
    assert bias <= BALL_BOUNCE[method][0]
    assert rms <= BALL_BOUNCE[method][1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("tilt", [0.0, 45.0, 80.0, 88.0])
def test_lone_plane_is_open_and_dark(tilt, parallel, method):
    camera = (Camera.orthographic if parallel else Camera.perspective)(48, 36, 0.7)
    normal = (np.sin(np.radians(tilt)) * 0.6, np.sin(np.radians(tilt)) * 0.8, np.cos(np.radians(tilt)))
    gbuffer = capture(camera, [Plane((0.0, 0.0, -10.0), normal, albedo=1.0, source=1.0)])
    light = light_of(gbuffer, camera, **METHODS[method])
    assert np.abs(light.visibility - 1.0).max() <= LONE_PLANE
    assert light.diffuse.max() <= LONE_PLANE


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", list(scenes()))
def test_furnace_is_white_for_paint_and_metal(name, method):
    """Each surface hands on 1: half of it its own, half of it reflected. All that is seen is 1."""
    for roughness in (0.0, 0.1, 1.0) if method == "hemisphere" else (0.4,):
        gbuffer, camera = scenes(albedo=0.5, specular=1.0, source=0.5, roughness=roughness)[name]
        light = light_of(gbuffer, camera, WHITE, reflections=True, **METHODS[method])
        surface = ~gbuffer.is_background
        np.testing.assert_allclose(light.diffuse[surface], 1.0, atol=FURNACE_BOUNCED)
        np.testing.assert_allclose(light.glossy[surface], 1.0, atol=FURNACE_BOUNCED)


SUN_POLAR = np.radians(30.0)


def sun_over(camera: Camera, radiance: float = 1e4) -> tuple[Environment, float, np.ndarray]:
    """Return a black sky with a sun of one pixel, radiance times solid angle, and its direction (+Y up)."""
    height, width = 180, 360
    image = np.zeros((height, width, 3))
    row, column = int(SUN_POLAR / np.pi * height), 40
    image[row, column] = radiance
    polar = (row + 0.5) / height * np.pi
    azimuth = np.pi - (column + 0.5) / width * 2.0 * np.pi
    world = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    power = radiance * 2.0 * np.pi**2 / (height * width) * np.sin(polar)
    sky = Environment.equirectangular(image, UP_IS_Z @ camera.world_from_view[:3, :3])
    return sky, power, UP_IS_Z.T @ world


@pytest.mark.parametrize("method", METHODS)
def test_sun_lights_a_floor_by_its_cosine_and_leaves_the_umbra_dark(method):
    camera = Camera.perspective(96, 72, 0.9, world_from_view=look_at((0.0, 4.0, 5.0), (0.0, 0.0, 0.0)))
    centre, radius = np.array([0.0, 1.0, 0.0]), 0.6
    floor = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    sky, power, toward = sun_over(camera)
    full = power * toward[1] / np.pi
    open_light = light_of(capture(camera, [floor]), camera, sky, **METHODS[method]).diffuse
    bias, rms = errors(open_light, np.full_like(open_light, full))
    assert bias <= CLOSED_FORM_RELATIVE
    assert rms <= CLOSED_FORM_RMS
    gbuffer = capture(camera, [floor, Sphere(centre, radius)], thickness=2.0 * radius)
    offset = centre - world_points(gbuffer, camera)
    off_axis = np.linalg.norm(np.cross(offset, toward), axis=-1)
    umbra = (off_axis < 0.7 * radius) & (gbuffer.albedo[..., 0] > 0.0)
    assert umbra.sum() > 50
    light = light_of(gbuffer, camera, sky, **METHODS[method])
    assert light.diffuse[umbra].max() <= SUN_IN_UMBRA * full


@pytest.mark.parametrize("albedo", [0.3, 0.5, 0.8, 0.9])
def test_many_bounces_reach_the_series_but_for_what_ends_it(albedo):
    """Inside a ball all light is source / (1 - albedo). Of a geometric series that stops at a term of
    LEAST_BOUNCE of the sum, at most albedo / (1 - albedo) such terms are missing."""
    source, views = 2.0, []
    for target in np.vstack([-np.eye(3)[::-1], np.eye(3)]):
        camera = Camera.perspective(
            24, 24, np.pi / 2, world_from_view=look_at((0.0, 0.0, 0.0), tuple(target))
        )
        views.append((capture(camera, [Sphere((0.0, 0.0, 0.0), 3.0, albedo=albedo, source=source)]), camera))
    light = light_of(*views[0], views=views[1:], bounces=64)
    expected = source / (1.0 - albedo)
    assert light.known_diffuse.min() == 1.0
    missing = 1.0 - light.diffuse / expected
    assert missing.min() >= -REPEATED_SUM
    assert missing.max() <= bounces.LEAST_BOUNCE * albedo / (1.0 - albedo)


def contact(kind: str) -> tuple[GBuffer, Camera, np.ndarray]:
    """A thing on a floor, and the floor within six pixels of it, where it touches."""
    camera = Camera.perspective(96, 72, 0.8, world_from_view=look_at((0.0, 2.0, 3.4), (0.0, 0.3, 0.0)))
    floor = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    things = {
        "ball": [Sphere((0.0, 0.6, 0.0), 0.6)],
        "box": [
            Plane(
                (0.0, 0.0, 0.5),
                (0.0, 0.0, 1.0),
                bounds=lambda p: (np.abs(p[:, 0]) < 0.7) & (p[:, 1] > 0.0) & (p[:, 1] < 0.8),
            ),
            Plane(
                (0.0, 0.8, 0.0),
                (0.0, 1.0, 0.0),
                bounds=lambda p: (np.abs(p[:, 0]) < 0.7) & (np.abs(p[:, 2]) < 0.5),
            ),
        ],
    }
    gbuffer = capture(camera, [floor, *things[kind]])
    is_floor = gbuffer.albedo[..., 0] > 0.0
    rows, columns = np.nonzero(~is_floor & ~gbuffer.is_background)
    y, x = np.mgrid[0 : camera.height, 0 : camera.width]
    distance = np.hypot(y[..., None] - rows, x[..., None] - columns).min(axis=-1)
    return gbuffer, camera, is_floor & (distance <= 6.0) & (y > rows.max() - 8)


@pytest.mark.parametrize("kind", ["ball", "box"])
def test_filter_keeps_a_contact_shadow(kind):
    gbuffer, camera, near = contact(kind)
    truth = light_of(gbuffer, camera, WHITE, rays=512, filter=False).visibility[near].astype(np.float64)
    assert truth.max() - truth.min() > 0.25
    raw, smooth = (
        light_of(gbuffer, camera, WHITE, rays=4, filter=is_smooth).visibility[near] - truth
        for is_smooth in (False, True)
    )
    assert (smooth**2).mean() <= CONTACT_ERROR_LEFT[kind] * (raw**2).mean()
    assert abs(smooth.mean()) <= CONTACT_BIAS[kind]
