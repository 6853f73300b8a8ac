# SPDX-License-Identifier: GPL-3.0-or-later
"""The brightest part of an environment: the light of rays over the hemisphere, without their noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, parallel, render_indirect, tracer
from ssgi_addon.core.bright_sky import BrightSky, light_from_bright_sky
from ssgi_addon.core.frame_points import surface_points
from ssgi_addon.core.light import luminance
from ssgi_addon.core.sampling import sample_square
from ssgi_addon.core.scene import TraceScene
from tests.core.synthetic import Plane, Sphere, capture, look_at, make_settings
from tests.tolerances import (
    CLOSED_FORM_RELATIVE,
    FURNACE,
    REPEATED_SUM,
    SKY_AS_BY_HEMISPHERE,
    SKY_MOMENT,
    TURNED_VIEW_RELATIVE,
)

# World +Z is view +Y of a camera that is not turned: the sky of an image is above.
UP_IS_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def sunny(height: int = 16, width: int = 32, sun: float = 200.0, row: int = 3, column: int = 7) -> np.ndarray:
    """A dim sky of changing colour with a sun of 1 x 2 pixels of two colours."""
    y, x = np.mgrid[0:height, 0:width]
    image = np.stack([1.0 + 0.2 * np.sin(x), 1.0 + 0.5 * y / height, 1.0 + 0.0 * x], axis=-1)
    image[row % height, column % width] = (sun, 0.8 * sun, 0.5 * sun)
    image[row % height, (column + 1) % width] = (0.5 * sun, sun, 0.9 * sun)
    return image


def sky_of(image: np.ndarray, camera: Camera | None = None) -> Environment:
    pose = np.eye(3) if camera is None else camera.world_from_view[:3, :3]
    return Environment.equirectangular(image, UP_IS_Z @ pose)


def light_of(gbuffer: GBuffer, camera: Camera, environment: Environment | None, **options) -> IndirectLight:
    options = {"reflections": False, "rays": 4, **options}
    return render_indirect(gbuffer, camera, make_settings(**options), environment)


def sphere_of_directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (3, N) evenly in polar angle and azimuth, and the solid angle (N,) of each."""
    polar, azimuth = np.meshgrid(
        (np.arange(count) + 0.5) * np.pi / count, (np.arange(2 * count) + 0.5) * np.pi / count
    )
    sine = np.sin(polar)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)]).reshape(3, -1)
    return directions, sine.ravel() * (np.pi / count) ** 2


def cosine_integral(environment: Environment, normal: np.ndarray) -> np.ndarray:
    """Return the mean radiance over the cosine hemisphere about a view-space normal."""
    directions, solid_angle = sphere_of_directions(1024)
    cosine = np.maximum(np.asarray(normal) @ directions, 0.0)
    above = cosine > 0.0
    radiance = environment.radiance(*directions[:, above])
    return (radiance * (cosine * solid_angle)[above, None]).sum(axis=0) / np.pi


@pytest.mark.parametrize("size", [(16, 32), (7, 13), (1, 9), (9, 1), (2, 9), (5, 3), (64, 128)])
@pytest.mark.parametrize("row", [0, 3, -1])
def test_drawn_directions_bring_what_the_rest_lacks(size, row):
    environment = Environment.equirectangular(sunny(*size, sun=1e4, row=row, column=size[1] - 1), np.eye(3))
    sky = BrightSky.of(environment)
    directions, solid_angle = sphere_of_directions(768)
    lacking = environment.radiance(*directions) - sky.rest.radiance(*directions)
    u, v = (part.ravel() for part in np.meshgrid(*2 * [(np.arange(256.0) + 0.5) / 256.0]))
    drawn, light = sky.draw(u, v, environment.world_from_view)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=0), 1.0, atol=REPEATED_SUM)
    expected = lacking * (solid_angle / np.pi)[:, None]
    atol = SKY_MOMENT * light.mean()
    np.testing.assert_allclose(light.mean(axis=0), expected.sum(axis=0), atol=atol)
    # Not only as much, but from there, too
    for from_drawn, from_all in zip(drawn, directions, strict=True):
        found = (light * from_drawn[:, None]).mean(axis=0)
        np.testing.assert_allclose(found, (expected * from_all[:, None]).sum(axis=0), atol=atol)


def test_the_rest_keeps_colours_and_is_no_brighter_than_a_few_means():
    image = sunny()
    environment = sky_of(image)
    rest = BrightSky.of(environment).rest
    is_kept = (rest.image == environment.image).all(axis=-1)
    assert np.argwhere(~is_kept).tolist() == [[3, 7], [3, 8]]
    np.testing.assert_allclose(
        rest.image / rest.image.sum(axis=-1, keepdims=True),
        environment.image / environment.image.sum(axis=-1, keepdims=True),
        rtol=REPEATED_SUM,
    )
    dimmed = luminance(rest.image)[~is_kept]
    assert (dimmed > luminance(environment.image)[is_kept].max()).all()
    np.testing.assert_allclose(dimmed, dimmed[0], rtol=REPEATED_SUM)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((8, 16, 3)),
        np.ones((5, 7, 3)),
        np.full((1, 1, 3), 1e5),
        np.zeros((1, 1, 3)),
        np.ones((1, 9, 3)),
    ],
)
def test_an_even_sky_has_no_bright_part(image):
    assert BrightSky.of(sky_of(image)) is None


def floor_and_ball(camera: Camera) -> GBuffer:
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=(0.9, 0.6, 0.3))
    return capture(camera, [floor, Sphere((0.0, -0.2, -6.0), 0.8, albedo=0.5)])


CAMERA = Camera.perspective(32, 24, 1.0)


@pytest.mark.parametrize("tilt", [0.0, 40.0, 80.0])
@pytest.mark.parametrize("pose", [np.eye(4), look_at((3.0, 1.0, -2.0), (0.0, 0.0, 0.0))])
def test_a_lone_plane_receives_the_cosine_integral_by_few_rays(tilt, pose):
    camera = Camera.orthographic(16, 16, 2.0, world_from_view=pose)
    lean = np.radians(tilt)
    normal = np.array([0.0, np.sin(lean), np.cos(lean)])
    gbuffer = capture(Camera.orthographic(16, 16, 2.0), [Plane((0.0, 0.0, -9.0), normal, albedo=1.0)])
    environment = sky_of(sunny(sun=2000.0, column=22), camera)
    light = light_of(gbuffer, camera, environment, rays=8)
    expected = cosine_integral(environment, normal)
    np.testing.assert_allclose(light.diffuse.mean(axis=(0, 1)), expected, rtol=CLOSED_FORM_RELATIVE)
    noise, plain = (
        light_of(gbuffer, camera, environment, rays=8, sky_rays=rays).diffuse.std(axis=(0, 1)).max()
        for rays in (2, 0)
    )
    assert noise < 0.2 * plain


def test_the_sun_casts_a_shadow_where_geometry_says():
    """A small sun straight above a ball in a black sky: dark below it, full light away from it."""
    camera = Camera.perspective(96, 72, 0.8, world_from_view=look_at((0.0, 3.0, 4.0), (0.0, 0.0, 0.0)))
    floor, ball = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5), Sphere((0.0, 1.0, 0.0), 0.5)
    gbuffer = capture(camera, [floor, ball], thickness=1.0)
    y, x = np.mgrid[0:72, 0:96] + 0.5
    depth = np.where(gbuffer.is_background, 1.0, gbuffer.depth)
    point = (
        camera.pixel_to_view(x, y, depth) @ camera.world_from_view[:3, :3].T + camera.world_from_view[:3, 3]
    )
    is_floor = ~gbuffer.is_background & (gbuffer.albedo[..., 0] > 0.0)
    away = np.hypot(point[..., 0], point[..., 2])
    image = np.zeros((90, 180, 3))
    image[0] = 1000.0  # within two rows of 2 degrees of the zenith
    for is_smooth in (False, True):
        light = light_of(gbuffer, camera, sky_of(image, camera), filter=is_smooth)
        full = cosine_integral(sky_of(image), (0.0, 1.0, 0.0))[0]
        # Behind the ball rays pass the side of it that the camera does not see
        lit = light.diffuse[is_floor & (away > 0.7) & (point[..., 2] > 0.0)][:, 0]
        np.testing.assert_allclose(lit.mean(), full, rtol=CLOSED_FORM_RELATIVE)
        umbra = light.diffuse[is_floor & (away > 0.3) & (away < 0.4) & (point[..., 2] > 0.1)][:, 0]
        assert umbra.size > 10
        # The filter carries some of the dim part's light into the shadow
        assert umbra.max() <= (CLOSED_FORM_RELATIVE * full if is_smooth else 0.0)


@pytest.mark.parametrize("bounces", [1, 3])
def test_light_is_that_of_many_rays_over_the_hemisphere(bounces):
    gbuffer, environment = floor_and_ball(CAMERA), sky_of(sunny(8, 16, column=3), CAMERA)
    # What rays bring that end behind something is another matter
    options = {"bounces": bounces, "unknown": "nothing"}
    found = light_of(gbuffer, CAMERA, environment, rays=512, sky_rays=256, **options)
    truth = light_of(gbuffer, CAMERA, environment, rays=4096, sky_rays=0, **options)
    for name in ("diffuse", "environment_diffuse"):
        a, b = (getattr(light, name)[~gbuffer.is_background] for light in (found, truth))
        np.testing.assert_allclose(a.mean(axis=0), b.mean(axis=0), rtol=CLOSED_FORM_RELATIVE)
        assert np.abs(a - b).mean() < SKY_AS_BY_HEMISPHERE * b.mean()


def test_what_ends_behind_something_lies_in_shadow():
    """To the sky a blocked ray may be as good as open, to the sun it is not."""
    camera = Camera.perspective(48, 36, 0.8, world_from_view=look_at((0.0, 3.0, 4.0), (0.0, 0.0, 0.0)))
    floor, ball = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5), Sphere((0.0, 1.0, 0.0), 0.5)
    gbuffer = capture(camera, [floor, ball])
    image = np.zeros((90, 180, 3))
    image[0] = 1000.0
    settings, pixel = make_settings(), np.flatnonzero(gbuffer.albedo[..., 0] > 0.0)
    sky, scene = BrightSky.of(sky_of(image, camera)), TraceScene(gbuffer, camera, [], settings)
    light = light_from_bright_sky(scene, 0, sky, settings, pixel, 2)
    point, normal = surface_points(gbuffer, camera, pixel)
    status = scene.answer(point, normal).status
    assert (status == tracer.BLOCKED).sum() > 10
    assert (
        light.radiance[status == tracer.BLOCKED].mean()
        < 0.2 * light.radiance[status == tracer.UNKNOWN].mean()
    )


@pytest.mark.parametrize("bounces", [1, 2])
def test_mirrors_show_surfaces_in_the_sun(bounces):
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    wall = Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), specular=1.0)
    gbuffer, environment = capture(CAMERA, [floor, wall]), sky_of(sunny(row=2), CAMERA)
    found, truth = (
        light_of(gbuffer, CAMERA, environment, reflections=True, bounces=bounces, **rays)
        for rays in ({"rays": 64, "sky_rays": 16}, {"rays": 2048, "sky_rays": 0})
    )
    shows_floor = (gbuffer.specular[..., 0] > 0.0) & (found.glossy[..., 1] < 3.0)
    a, b = found.glossy[shows_floor], truth.glossy[shows_floor]
    np.testing.assert_allclose(a.mean(axis=0), b.mean(axis=0), rtol=CLOSED_FORM_RELATIVE)


def test_constant_light_is_as_ever_and_takes_no_ray_more():
    gbuffer = floor_and_ball(CAMERA)
    for environment in (Environment.constant((1.0, 2.0, 3.0)), sky_of(np.ones((4, 8, 3)), CAMERA), None):
        plain, light = (light_of(gbuffer, CAMERA, environment, sky_rays=rays, filter=True) for rays in (0, 8))
        np.testing.assert_array_equal(light.diffuse, plain.diffuse)
        np.testing.assert_array_equal(light.environment_diffuse, plain.environment_diffuse)
        assert light.rays == plain.rays
    assert "bright sky" not in light.rays


def test_what_is_left_out_is_said():
    gbuffer = floor_and_ball(CAMERA)
    sun, even = sky_of(sunny(), CAMERA), Environment.constant((1.0, 1.0, 1.0))
    said = [
        dict(light_of(gbuffer, CAMERA, sky, sky_rays=rays).skipped)
        for sky, rays in ((sun, 1), (sun, 0), (even, 1))
    ]
    assert "bright sky rays" not in said[0]
    assert said[1]["bright sky rays"] == "switched off"
    assert "mean" in said[2]["bright sky rays"]


def test_a_white_furnace_of_an_image_is_white():
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=1.0, source=1.0)
    gbuffer = capture(CAMERA, [floor, Sphere((0.0, -0.2, -6.0), 0.8, albedo=1.0, source=1.0)])
    light = light_of(gbuffer, CAMERA, sky_of(np.ones((8, 16, 3)), CAMERA), filter=True)
    np.testing.assert_allclose(light.diffuse[~gbuffer.is_background], 1.0, atol=FURNACE)


def test_nothing_comes_from_a_black_sky_or_from_below_the_horizon():
    gbuffer = capture(CAMERA, [Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=1.0)])
    assert (light_of(gbuffer, CAMERA, sky_of(np.zeros((8, 16, 3)))).diffuse == 0.0).all()
    image = np.zeros((16, 32, 3))
    image[12, 7] = 1e5
    light = light_of(gbuffer, CAMERA, sky_of(image))
    assert (light.diffuse == 0.0).all()
    assert light.rays["bright sky"] == 0


def test_a_pixel_of_blinding_light_makes_no_spikes():
    """With all light in one pixel of 1e5, no pixel of the frame is brighter than the whole of it allows."""
    image = np.full((128, 256, 3), 0.1)
    image[20, 40] = 1e5
    gbuffer, environment = floor_and_ball(CAMERA), sky_of(image, CAMERA)
    surface = ~gbuffer.is_background
    most = cosine_integral(environment, environment.world_from_view.T @ sun_direction(image))
    for rays in (1, 2):
        light = light_of(gbuffer, CAMERA, environment, sky_rays=rays).diffuse[surface]
        assert light.max() < 1.1 * most.max()
        assert light.min() >= 0.0
    floor = surface & (gbuffer.normal[..., 1] > 0.99)
    lit = light_of(gbuffer, CAMERA, environment).diffuse[floor]
    full = np.median(lit)
    # In the light or in the shadow, and hardly anything between
    assert ((lit > 0.9 * full) | (lit < 0.1 * full)).mean() > 0.9


def sun_direction(image: np.ndarray) -> np.ndarray:
    row, column = np.unravel_index(int(luminance(image).argmax()), image.shape[:2])
    polar, azimuth = (
        (row + 0.5) / image.shape[0] * np.pi,
        np.pi - (column + 0.5) / image.shape[1] * 2.0 * np.pi,
    )
    return np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])


def test_threads_and_chunks_change_nothing(monkeypatch):
    camera = Camera.perspective(53, 41, 1.0)
    gbuffer, environment = floor_and_ball(camera), sky_of(sunny(), camera)
    options = {"filter": True, "bounces": 2, "sky_rays": 3}
    first = light_of(gbuffer, camera, environment, threads=1, **options)
    for threads, at_once, per_task in ((2, 1_048_576, 65536), (8, 1_048_576, 512), (2, 1000, 128)):
        monkeypatch.setattr(parallel, "RAYS_AT_ONCE", at_once)
        monkeypatch.setattr(parallel, "RAYS_PER_TASK", per_task)
        other = light_of(gbuffer, camera, environment, threads=threads, **options)
        np.testing.assert_array_equal(first.diffuse, other.diffuse)
        np.testing.assert_array_equal(first.environment_diffuse, other.environment_diffuse)


def test_inputs_stay_as_they_are():
    gbuffer, environment = floor_and_ball(CAMERA), sky_of(sunny(), CAMERA)
    before = environment.image.copy()
    light_of(gbuffer, CAMERA, environment, bounces=2)
    np.testing.assert_array_equal(environment.image, before)


def test_another_view_finds_the_sun_where_the_frame_does():
    """The pixels of a view receive the same as when the view is the frame."""
    turned = Camera.perspective(24, 18, 1.2, world_from_view=look_at((2.0, 1.5, -1.0), (0.0, -1.0, -6.0)))
    views = [(floor_and_ball(camera), camera) for camera in (CAMERA, turned)]
    image, settings, pixel = sunny(), make_settings(), np.flatnonzero(~views[1][0].is_background)
    both = []
    for order, home in (((0, 1), 1), ((1, 0), 0)):
        placed = [views[index] for index in order]
        scene = TraceScene(*placed[0], placed[1:], settings)
        sky = BrightSky.of(sky_of(image, placed[0][1]))
        both.append(light_from_bright_sky(scene, home, sky, settings, pixel, 4))
    assert both[0].radiance.max() > 0.5
    difference = np.abs(both[0].radiance - both[1].radiance).mean()
    assert difference < TURNED_VIEW_RELATIVE * both[1].radiance.mean()


def test_views_hand_on_sunlight():
    """A dark ceiling sees the sunlit floor in the other view alone."""
    ceiling = Plane((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), albedo=1.0)
    up = Camera.perspective(24, 18, 1.0, world_from_view=look_at((0.0, 0.0, 0.0), (0.0, 1.0, -0.5)))
    down = Camera.perspective(32, 32, 2.0, world_from_view=look_at((0.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    frame, view = capture(up, [ceiling]), capture(down, [floor])
    image = np.zeros((16, 32, 3))
    image[6, 10] = 1000.0
    settings = make_settings(reflections=False, rays=64, bounces=2)
    alone = render_indirect(frame, up, settings, sky_of(image, up))
    light = render_indirect(frame, up, settings, sky_of(image, up), [(view, down)])
    assert (alone.diffuse == 0.0).all()  # the sun is behind the ceiling
    sunlit = cosine_integral(sky_of(image), (0.0, 1.0, 0.0))
    assert 0.0 < light.diffuse.max() <= 0.5 * sunlit.max() * (1.0 + CLOSED_FORM_RELATIVE)
    once = replace(settings, diffuse=replace(settings.diffuse, bounces=1))
    assert (render_indirect(frame, up, once, sky_of(image, up), [(view, down)]).diffuse == 0.0).all()


@pytest.mark.parametrize("unknown", ["environment", "nothing", "mean"])
def test_a_sun_that_the_frame_cannot_answer_brings_what_the_settings_say(unknown):
    """All rays of a wall that faces the camera go back past it."""
    gbuffer = capture(CAMERA, [Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), albedo=1.0)])
    environment = sky_of(sunny(column=24), CAMERA)
    light = light_of(gbuffer, CAMERA, environment, unknown=unknown, rays=64)
    if unknown == "environment":
        expected = cosine_integral(environment, (0.0, 0.0, 1.0))
        np.testing.assert_allclose(light.diffuse.mean(axis=(0, 1)), expected, rtol=CLOSED_FORM_RELATIVE)
    else:
        assert (light.diffuse == 0.0).all()


def test_single_precision_is_kept():
    environment = sky_of(sunny())
    sky = BrightSky.of(environment)
    assert sky.rest.image.dtype == np.float32
    u, v = sample_square(np.arange(64), 8, 2, 0, np.dtype(np.float32))
    for values in sky.draw(u, v, environment.world_from_view):
        assert values.dtype == np.float32
