# SPDX-License-Identifier: GPL-3.0-or-later
"""What must not change the light: units, the world's turn, flips, crops, threads, chunks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import (
    Camera,
    Environment,
    Fill,
    GBuffer,
    Settings,
    parallel,
    render_indirect,
    tracer,
    walk,
)
from tests.budget import examples
from tests.core import fuzz
from tests.core.synthetic import Plane, Sphere, capture, look_at, make_settings, random_gbuffer
from tests.core.test_pipeline import IMAGES, assert_same
from tests.tolerances import (
    CROPPED_FRAME,
    FLIPPED_MEAN,
    HALF_THE_PIXELS_ERROR,
    SCALED_SCENE_RELATIVE,
    TILE_BORDER,
    TURNED_WORLD_MEAN,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
SURFACES = (
    Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.6, specular=0.3, roughness=0.3, source=0.2),
    Plane((-2.0, 0.0, 0.0), (1.0, 0.0, 0.3), albedo=(0.7, 0.2, 0.1), source=lambda p: 1.0 + np.sin(2.0 * p)),
    Sphere((0.6, -0.3, -5.0), 0.7, albedo=0.2, specular=0.8, source=1.0),
    Sphere((-0.7, -0.5, -6.0), 0.5, albedo=0.5, specular=0.5, roughness=0.5, source=3.0),
)
METHODS = ("hemisphere", "horizon", "bitmask", "ssao")
LIGHTS = ("diffuse", "glossy", "environment_diffuse")
MEANS = ("diffuse", "glossy", "visibility", "known")
SIZE = (64, 48)


def lens(is_orthographic: bool, factor: float = 1.0, size: tuple[int, int] = SIZE) -> Camera:
    if is_orthographic:
        return Camera.orthographic(*size, 5.0 * factor)
    return Camera.perspective(*size, 1.1)


def plain_settings(method: str = "hemisphere", **options) -> Settings:
    settings = make_settings(**{"rays": 4, "bounces": 3, "filter": True, **options})
    return replace(settings, diffuse=replace(settings.diffuse, method=method))


def scene(is_orthographic: bool = False) -> GBuffer:
    return capture(lens(is_orthographic), SURFACES)


# Units of length.


def scaled(is_orthographic: bool, factor: float, settings: Settings):
    """The light of the scene with all lengths times `factor`."""
    near = scene(is_orthographic)
    thickness = np.where(near.is_background, 0.0, 0.4)
    far = replace(near, depth=near.depth.astype(np.float64) * factor, thickness=thickness * factor)
    settings = replace(settings, max_distance=6.0 * factor)
    return render_indirect(far, lens(is_orthographic, factor), settings, WHITE)


@given(st.integers(-20, 20), st.booleans(), st.sampled_from(METHODS))
@examples(max_examples=12)
def test_lengths_times_powers_of_two_change_no_bit(power, is_orthographic, method):
    settings = plain_settings(method, glossy={"reuse": 4, "color_pyramid": True, "subpixel": True})
    assert_same(scaled(is_orthographic, 2.0**power, settings), scaled(is_orthographic, 1.0, settings))


@given(st.floats(-3.0, 5.0), st.booleans(), st.sampled_from(METHODS))
@examples(max_examples=10)
def test_lengths_times_any_factor_change_no_mean(decades, is_orthographic, method):
    settings = plain_settings(method, rays=8)
    found, expected = (scaled(is_orthographic, factor, settings) for factor in (10.0**decades, 1.0))
    for name in MEANS:
        mean = getattr(expected, name).mean(dtype=np.float64)
        assert getattr(found, name).mean(dtype=np.float64) == pytest.approx(mean, rel=SCALED_SCENE_RELATIVE)


# Units of light.


def fill_of(gbuffer: GBuffer, camera: Camera, factor: float, is_denoised: bool) -> Fill:
    rng = np.random.default_rng(3)
    diffuse, glossy = rng.random((2, *gbuffer.shape, 3)) * factor
    return Fill(gbuffer.depth, gbuffer.normal, diffuse, glossy, camera, 4.0, is_denoised=is_denoised)


@given(
    st.integers(-20, 20),
    st.booleans(),
    st.sampled_from(METHODS),
    st.sampled_from([None, "level", "replace"]),
    st.booleans(),
)
@examples(max_examples=12)
def test_light_times_powers_of_two_is_as_much_light(power, is_orthographic, method, fill_mode, is_sky):
    factor = 2.0**power
    camera, gbuffer = lens(is_orthographic), scene(is_orthographic)
    coarse = lens(is_orthographic, size=(16, 12))
    image = np.random.default_rng(4).random((6, 12, 3)) ** 6
    glossy = {"reuse": 4, "color_pyramid": True, "subpixel": True}
    settings = replace(plain_settings(method, glossy=glossy), fill_mode=fill_mode or "level")
    lights = []
    for scale in (1.0, factor):
        direct = gbuffer.direct * np.float32(scale)
        lit = replace(gbuffer, direct=direct, source=direct * np.float32(0.7), glossy_source=direct)
        sky = Environment.constant((scale,) * 3)
        if is_sky:
            sky = Environment.equirectangular(image * scale, np.eye(4))
        fill = None
        if fill_mode is not None:
            fill = fill_of(capture(coarse, SURFACES), coarse, scale, fill_mode == "replace")
        lights.append(render_indirect(lit, camera, settings, sky, fill=fill))
    for name in IMAGES:
        scale = np.float32(factor if name in LIGHTS else 1.0)
        found, expected = getattr(lights[1], name), getattr(lights[0], name) * scale
        np.testing.assert_array_equal(found, expected, err_msg=name)


# Flips and turns.


def flipped(gbuffer: GBuffer, axis: int) -> GBuffer:
    turned = np.ones(3)
    turned[1 - axis] = -1.0
    names = ("depth", "albedo", "specular", "roughness", "direct")
    passes = {name: np.flip(getattr(gbuffer, name), axis) for name in names}
    return GBuffer(normal=np.flip(gbuffer.normal, axis) * turned, **passes)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("method", METHODS)
def test_flips_flip_the_mean_light(axis, method):
    """Random directions are no mirror images of each other: what stays is the mean of each part."""
    camera, gbuffer = lens(False), scene()
    settings = plain_settings(method, rays=64, bounces=1, filter=False)
    settings = replace(settings, diffuse=replace(settings.diffuse, slices=8))
    expected = render_indirect(gbuffer, camera, settings, WHITE)
    found = render_indirect(flipped(gbuffer, axis), camera, settings, WHITE)

    def parts(image: np.ndarray) -> np.ndarray:
        return image.reshape(6, 8, 8, 8, -1).mean(axis=(1, 3))

    for name in ("diffuse", "visibility"):
        off = parts(np.flip(getattr(found, name), axis)) - parts(getattr(expected, name))
        scale = getattr(expected, name).mean(dtype=np.float64)
        assert np.sqrt((off**2).mean()) <= FLIPPED_MEAN * scale, name
        assert abs(off.mean()) <= 0.2 * FLIPPED_MEAN * scale, name


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("columns", [1, 5])
def test_turning_world_and_sky_together_changes_nothing(method, columns):
    """About the zenith by whole columns of the sky's image, so that the image is the same, moved."""
    image = np.random.default_rng(4).random((6, 12, 3)) ** 4
    gbuffer, camera = scene(), lens(False)
    angle = 2.0 * np.pi * columns / 12
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    view = replace(lens(False, size=(20, 20)), world_from_view=look_at((1.0, 0.5, -2.0), (0.0, -0.5, -6.0)))
    shown = capture(view, SURFACES)
    lights = []
    for pose, sky in ((np.eye(4), image), (turn, np.roll(image, -columns, axis=1))):
        frame = replace(camera, world_from_view=pose @ camera.world_from_view)
        other = replace(view, world_from_view=pose @ view.world_from_view)
        environment = Environment.equirectangular(sky, frame.world_from_view)
        lights.append(render_indirect(gbuffer, frame, plain_settings(method), environment, [(shown, other)]))
    for name in MEANS:
        expected, found = (getattr(light, name).mean(dtype=np.float64) for light in lights)
        assert found == pytest.approx(expected, rel=TURNED_WORLD_MEAN), name


# Crops and resolutions.


@pytest.mark.parametrize("is_orthographic", [False, True])
def test_crop_that_sees_the_whole_beside_it_has_the_light_of_the_whole(is_orthographic):
    """A render border with crop: the camera is shifted, and what lies beyond the crop is an overscan."""
    camera, gbuffer = lens(is_orthographic), scene(is_orthographic)
    settings = plain_settings(rays=64, bounces=1, filter=False)
    whole = render_indirect(gbuffer, camera, settings, WHITE)
    rows, columns = slice(16, 48), slice(16, 48)  # whole tiles of the sampling pattern
    part = replace(camera, width=32, height=32, cx=camera.cx - columns.start, cy=camera.cy - rows.start)
    names = ("depth", "normal", "albedo", "specular", "roughness", "direct")
    cropped = GBuffer(**{name: getattr(gbuffer, name)[rows, columns] for name in names})
    found = render_indirect(cropped, part, settings, WHITE, [(gbuffer, camera)])
    alone = render_indirect(cropped, part, settings, WHITE)
    for name in ("diffuse", "visibility"):
        expected = getattr(whole, name)[rows, columns]
        error, without = (np.abs(getattr(light, name) - expected).mean() for light in (found, alone))
        assert error <= CROPPED_FRAME * expected.mean(), name
        assert error < without, name


def test_light_converges_as_pixels_double():
    """Each doubling halves the steps between pixels; light is compared on the coarsest one's pixels.

    Surfaces that go on to the horizon have no resolution at which they are resolved: this room ends.
    """
    back = Plane((0.0, 0.0, -8.0), (0.0, 0.0, 1.0), albedo=0.5, source=1.5)
    surfaces, found = (SURFACES[0], back, *SURFACES[2:]), []
    for size in ((24, 18), (48, 36), (96, 72), (192, 144)):
        camera, scale = lens(False, size=size), size[0] // 24
        # As many rays for each of the coarsest pixels, whatever it is cut into
        settings = plain_settings(rays=1024 // scale**2, bounces=1, filter=False, reflections=False)
        light = render_indirect(capture(camera, surfaces), camera, settings, WHITE)
        found.append(light.diffuse.reshape(18, scale, 24, scale, 3).mean(axis=(1, 3), dtype=np.float64))
    errors = [np.sqrt(((image - found[-1]) ** 2).mean()) for image in found[:-1]]
    assert errors[1] <= HALF_THE_PIXELS_ERROR * errors[0]
    assert errors[2] <= HALF_THE_PIXELS_ERROR * errors[1]


# Threads, chunks and tiles.


@given(st.data())
@examples(max_examples=8)
def test_threads_and_chunks_of_any_size_change_no_bit(data):
    """Whatever the settings: how much is done at a time, and by how many, is nobody's business."""
    shape = data.draw(st.sampled_from([(30, 41), (17, 16), (1, 70)]))
    rng = np.random.default_rng(data.draw(fuzz.SEEDS))
    gbuffer, camera = random_gbuffer(rng, shape), fuzz.plain_camera(shape, data.draw(st.booleans()))
    view = random_gbuffer(rng, (12, 12))
    pose = look_at((0.5, 0.2, 0.0), (0.0, 0.0, -5.0))
    views = [(view, Camera.perspective(12, 12, 1.5, world_from_view=pose))] * data.draw(st.integers(0, 1))
    settings, sky = data.draw(fuzz.settings()), data.draw(fuzz.skies())
    expected = render_indirect(gbuffer, camera, replace(settings, threads=1), sky, views)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parallel, "RAYS_PER_TASK", data.draw(st.sampled_from([64, 333, 5000])))
        patch.setattr(tracer, "LEAST_RAYS", data.draw(st.sampled_from([1, 50])))
        patch.setattr(walk, "CAPACITY", data.draw(st.sampled_from([7, 200, 131072])))
        for threads in (1, 2, 8):
            found = render_indirect(gbuffer, camera, replace(settings, threads=threads), sky, views)
            assert_same(found, expected)
            assert found.rays == expected.rays


@pytest.mark.parametrize("method", ["hemisphere", "bitmask"])
@pytest.mark.parametrize("filter", [False, True])
def test_borders_of_the_patterns_tiles_cannot_be_seen(method, filter):
    """Light of a wall on a floor is alike along its rows: columns beside a border differ as all others do."""
    camera = Camera.perspective(96, 64, 0.6)
    wall = Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), source=4.0)
    floor = Plane((0.0, -0.5, 0.0), (0.0, 1.0, 0.0), albedo=0.5)
    gbuffer = capture(camera, [wall, floor])
    light = render_indirect(gbuffer, camera, plain_settings(method, rays=16, bounces=1, filter=filter), WHITE)
    rows = (gbuffer.normal[..., 1] > 0.5).all(axis=1)
    assert rows.sum() > 8
    step = np.abs(np.diff(light.diffuse[rows, :, 0].astype(np.float64), axis=1)).mean(axis=0)
    beside_border = np.arange(1, 96) % 16 == 0
    inside = slice(16, 80)  # away from the frame's own border
    at_border, elsewhere = (
        step[inside][beside_border[inside] == is_there].mean() for is_there in (True, False)
    )
    assert at_border <= TILE_BORDER[filter] * elsewhere


def test_still_camera_does_not_flicker():
    """Frame after frame of one seed is the same picture, also when other frames are rendered in between."""
    gbuffer, camera = scene(), lens(False)
    settings = Settings.preset("balanced")
    first = render_indirect(gbuffer, camera, settings, WHITE)
    render_indirect(scene(True), lens(True), settings, WHITE)
    assert_same(render_indirect(scene(), lens(False), settings, WHITE), first)
