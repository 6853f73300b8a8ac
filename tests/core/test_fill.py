# SPDX-License-Identifier: GPL-3.0-or-later
"""A fill sets the level of indirect light, along surfaces, from any place; what is bad in it stays local."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Fill, GBuffer, IndirectLight, render_indirect
from ssgi_addon.core.fill_level import Answered, set_level
from ssgi_addon.core.silhouettes import find_surface_edges
from ssgi_addon.surface_light import limit_fireflies
from tests.core.synthetic import Plane, capture, look_at, make_settings, random_gbuffer, uniform_gbuffer
from tests.tolerances import (
    CARRIED_FROM_ELSEWHERE,
    FEW_VISIBILITY_RAYS,
    FILLED_FURNACE,
    FILTER_RELATIVE,
    FIREFLY,
    MERGED_MEAN,
    MERGED_NOISE,
    SPARSE_LEVEL,
)

SIZE, SMALL = (64, 48), (16, 12)
# So many samples that a fill's level is the level
MANY = 1e9
FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5, specular=0.5, roughness=0.5, source=1.0)
WALL = Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), albedo=0.5, specular=0.5, roughness=0.5, source=1.0)
POSE = look_at((0.0, 3.0, 5.0), (0.0, 0.6, 0.0))


def camera_of(size: tuple[int, int], pose: np.ndarray = POSE) -> Camera:
    return Camera.perspective(*size, 1.0, world_from_view=pose)


def points_of(gbuffer: GBuffer, camera: Camera) -> np.ndarray:
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    depth = np.where(gbuffer.is_background, 1.0, gbuffer.depth).astype(np.float64)
    return (
        camera.pixel_to_view(x, y, depth) @ camera.world_from_view[:3, :3].T + camera.world_from_view[:3, 3]
    )


def fill_of(surfaces, camera: Camera, diffuse=0.0, glossy=0.0, samples=MANY) -> Fill:
    """Return what `camera` sees of `surfaces`; light is a number, an array, or a function of world points."""
    gbuffer = capture(camera, surfaces)
    lights = [light(points_of(gbuffer, camera)) if callable(light) else light for light in (diffuse, glossy)]
    images = [np.broadcast_to(light, (*gbuffer.shape, 3)) for light in lights]
    return Fill(gbuffer.depth, gbuffer.normal, *images, camera, samples)


def filled(light: float | np.ndarray, gbuffer: GBuffer, camera: Camera, fill: Fill, threads=1, known=0.0):
    """Return even answered light of all surfaces after the fill's diffuse light set its level."""
    pixel = np.flatnonzero(~gbuffer.is_background)
    answered = np.broadcast_to(np.float32(light), (*gbuffer.shape, 3)).reshape(-1, 3)[pixel]
    image = np.zeros((gbuffer.depth.size, 3), dtype=np.float32)
    (image[pixel],) = set_level(
        [Answered(answered, np.full(pixel.size, known, np.float32), pixel, fill.diffuse)],
        (gbuffer, camera),
        fill,
        threads,
    )
    return image.reshape(*gbuffer.shape, 3)


def assert_same_light(found: IndirectLight, expected: IndirectLight) -> None:
    for name in ("diffuse", "glossy", "visibility", "known_diffuse", "known_glossy", "known"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


@pytest.fixture(scope="module")
def corner() -> tuple[GBuffer, Camera]:
    """A floor before a wall, both handing on 1: half of their hemispheres is out of sight."""
    camera = camera_of(SIZE)
    return capture(camera, [FLOOR, WALL]), camera


@pytest.fixture(scope="module")
def small() -> Fill:
    return fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=1.0, glossy=1.0)


# --- What a fill does to light ----------------------------------------------------------------------------


def test_fill_without_a_surface_changes_nothing(corner, small):
    settings = make_settings(rays=4)
    empty = replace(small, depth=np.full(small.shape, np.inf))
    assert_same_light(
        render_indirect(*corner, settings, fill=empty), render_indirect(*corner, settings, fill=None)
    )


@pytest.mark.parametrize("passes", [{"albedo": 0.0, "specular": 0.0}, {"depth": np.inf}])
def test_frame_without_anything_to_light_stays_dark(small, passes):
    gbuffer = uniform_gbuffer(SIZE[::-1], **passes)
    light = render_indirect(gbuffer, camera_of(SIZE), make_settings(rays=1), fill=small)
    assert not light.diffuse.any()
    assert not light.glossy.any()


def test_white_furnace_with_a_hidden_half_is_white(corner, small):
    """All surfaces hand on 1 and what is out of sight does, too: the light is 1, and as known as before."""
    settings = make_settings(rays=64, filter=True)
    before = render_indirect(*corner, settings)
    assert before.known_diffuse.mean() < 0.6
    light = render_indirect(*corner, settings, fill=small)
    surface = ~corner[0].is_background
    for name in ("diffuse", "glossy"):
        error = getattr(light, name)[surface] - 1.0
        assert abs(error.mean()) < FILLED_FURNACE["mean"]
        assert np.sqrt((error**2).mean()) < FILLED_FURNACE[name]
    for name in ("known_diffuse", "known_glossy", "known", "visibility"):
        np.testing.assert_array_equal(getattr(light, name), getattr(before, name))
    assert "fill" in light.seconds


def test_half_known_light_is_the_mixture_that_the_fill_holds(corner):
    """Answered: a share k of the hemisphere, with light 1. The rest brings 0.3: k + 0.3 (1 - k)."""
    gbuffer, camera = corner

    def known(points: np.ndarray) -> np.ndarray:
        return (0.5 + 0.05 * points[..., :1]) * np.ones(3)

    fill = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=lambda points: 0.3 + 0.7 * known(points))
    share = known(points_of(gbuffer, camera))
    found = filled(share, gbuffer, camera, fill)
    surface = ~gbuffer.is_background
    error = found[surface] - (0.3 + 0.7 * share)[surface]
    assert np.abs(error).max() < SPARSE_LEVEL


def test_detail_of_the_rays_stays(corner):
    """Light that alternates from pixel to pixel does so afterwards, around the fill's level."""
    gbuffer, camera = corner
    fill = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=1.0)
    checker = np.indices(gbuffer.shape).sum(axis=0)[..., None] % 2
    found = filled(0.4 + 0.2 * checker, gbuffer, camera, fill)
    expected = np.broadcast_to(0.9 + 0.2 * checker, found.shape)
    surface = ~gbuffer.is_background
    np.testing.assert_allclose(found[surface], expected[surface], atol=SPARSE_LEVEL)


def test_light_that_is_too_bright_is_lowered_but_never_below_nothing(corner):
    gbuffer, camera = corner
    dark = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=0.0)
    spots = np.zeros((*gbuffer.shape, 3))
    spots[::3, ::3] = 2.0
    found = filled(spots, gbuffer, camera, dark)
    assert found.min() == 0.0
    assert found.sum() < spots.sum()


@pytest.mark.parametrize(("known", "trust"), [(0.0, 3.13 / 4.13), (1.0, 0.13 / 1.13)])
def test_the_less_is_known_the_more_the_fill_counts(corner, known, trust):
    """A fill of one sample against rays that found nothing, or everything."""
    gbuffer, camera = corner
    fill = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=1.0, samples=1.0)
    found = filled(0.5, gbuffer, camera, fill, known=known)[~gbuffer.is_background]
    np.testing.assert_allclose(found, 0.5 + 0.5 * trust, rtol=FILTER_RELATIVE)


def test_more_samples_count_more(corner):
    gbuffer, camera = corner
    fills = [fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=1.0, samples=count) for count in (1, 4, 16)]
    levels = [filled(0.5, gbuffer, camera, fill, known=0.9).max() for fill in fills]
    assert 0.5 < levels[0] < levels[1] < levels[2] < 1.0


def test_mirrors_show_every_pixel_of_a_fill(corner):
    """A fill that alternates from pixel to pixel: rough surfaces take the mean, mirrors what is there."""
    gbuffer, camera = corner
    checker = 1.0 + np.indices(SMALL[::-1]).sum(axis=0)[..., None] % 2
    fill = fill_of([FLOOR, WALL], camera_of(SMALL), glossy=checker)
    pixel = np.flatnonzero(~gbuffer.is_background)
    nothing = np.zeros((pixel.size, 3), dtype=np.float32)
    answered = Answered(nothing, nothing[:, 0], pixel, fill.glossy)
    rough, sharp = set_level([answered, replace(answered, passes=0)], (gbuffer, camera), fill, 1)
    assert sharp.std() > 2.0 * rough.std()
    np.testing.assert_allclose(sharp.mean(), 1.5, rtol=SPARSE_LEVEL)


def test_one_firefly_lights_nothing_up(corner):
    """One pixel of an even fill holds a thousand times its light: around it there is little more."""
    gbuffer, camera = corner
    light = np.ones((*SMALL[::-1], 1))
    light[6, 8] = 1000.0
    fill = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=light)
    limited = filled(0.0, gbuffer, camera, fill)
    light[6, 8] = 1.0
    without = filled(0.0, gbuffer, camera, fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=light))
    assert 1.0 < (limited / np.maximum(without, 1e-6)).max() < FIREFLY


def test_single_bright_pixel_is_four_times_the_median():
    light = np.ones((9, 9, 3), dtype=np.float32)
    light[4, 4] = 1000.0
    is_surface = np.ones((9, 9), dtype=bool)
    is_surface[:, 0] = False
    limited = limit_fireflies(light, is_surface, is_surface)
    light[4, 4] = 4.0
    np.testing.assert_allclose(limited, light, rtol=FILTER_RELATIVE)


# --- Where it comes from ----------------------------------------------------------------------------------


def test_edges_stay_sharp():
    """A near plate before a far wall, each with light of its own: no pixel takes any of the other's."""
    plate = Plane((0.0, 0.0, -3.0), (0.0, 0.0, 1.0), bounds=lambda points: points[:, 0] < 0.13)
    wall = Plane((0.0, 0.0, -8.0), (0.0, 0.0, 1.0))
    camera, coarse = Camera.perspective(*SIZE, 1.0), Camera.perspective(*SMALL, 1.0)
    fill = fill_of([plate, wall], coarse, diffuse=lambda p: np.where(p[..., 2:] > -5.0, 1.0, 3.0))
    gbuffer = capture(camera, [plate, wall])
    expected = np.where(gbuffer.depth < 5.0, 1.0, 3.0)[..., None] * np.ones(3)
    np.testing.assert_allclose(filled(0.0, gbuffer, camera, fill), expected, rtol=FILTER_RELATIVE)


def test_thin_thing_between_the_pixels_of_a_fill_takes_what_is_near():
    """A bar that no pixel of the fill sees, just before a wall, is lit as the wall; far before it, not."""
    wall = Plane((0.0, 0.0, -8.0), (0.0, 0.0, 1.0))
    camera, coarse = Camera.perspective(*SIZE, 1.0), Camera.perspective(*SMALL, 1.0)
    fill = fill_of([wall], coarse, diffuse=2.0)
    for depth, expected in ((7.2, 2.0), (4.0, 0.0)):
        bar = Plane((0.0, 0.0, -depth), (0.0, 0.0, 1.0), bounds=lambda points: np.abs(points[:, 0]) < 0.1)
        gbuffer = capture(camera, [bar, wall])
        is_bar = gbuffer.depth < 7.9
        assert is_bar.any()
        found = filled(0.0, gbuffer, camera, fill)
        np.testing.assert_allclose(found[is_bar], expected, rtol=FILTER_RELATIVE)
        np.testing.assert_allclose(found[~is_bar], 2.0, rtol=FILTER_RELATIVE)


def test_fill_from_another_place_is_that_of_the_same_place_on_a_plane(corner):
    def light(points: np.ndarray) -> np.ndarray:
        return (1.0 + 0.1 * points[..., :1]) * np.ones(3)

    gbuffer, camera = corner
    here = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=light)
    moved = look_at((0.6, 2.7, 4.8), (0.2, 0.5, 0.1))
    there = fill_of([FLOOR, WALL], camera_of(SMALL, moved), diffuse=light)
    own, other = (filled(0.0, gbuffer, camera, fill) for fill in (here, there))
    inside = np.zeros(gbuffer.shape, dtype=bool)
    inside[12:-12, 16:-16] = True
    np.testing.assert_allclose(other[inside], own[inside], rtol=CARRIED_FROM_ELSEWHERE)


def test_what_another_place_does_not_see_is_left_as_it_was(corner):
    gbuffer, camera = corner
    away = look_at((0.0, 3.0, 5.0), (0.0, 3.0, 10.0))
    fill = fill_of([Plane((0.0, 0.0, 9.0), (0.0, 0.0, -1.0))], camera_of(SMALL, away), diffuse=5.0)
    np.testing.assert_array_equal(filled(0.25, gbuffer, camera, fill)[~gbuffer.is_background], 0.25)


@pytest.mark.parametrize("is_orthographic", [False, True])
def test_any_sizes_and_projections_fit(is_orthographic, rng):
    make = Camera.orthographic if is_orthographic else Camera.perspective
    wall = Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0))
    fill = fill_of([wall], make(5, 3, 1.0), diffuse=0.7)
    camera = make(17, 11, 1.0)
    found = filled(0.1, capture(camera, [wall]), camera, fill)
    np.testing.assert_allclose(found, 0.7, rtol=FILTER_RELATIVE)


# --- Bad input, threads -----------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 1e16])
@pytest.mark.parametrize("name", ["depth", "normal", "diffuse", "glossy", "samples"])
def test_bad_pixel_tells_nothing_and_stays_local(corner, rng, name, bad):
    gbuffer, camera = corner
    coarse = camera_of(SMALL)
    light = rng.random((*SMALL[::-1], 3))
    good = fill_of([FLOOR, WALL], coarse, diffuse=light, glossy=light)
    planes = {field: np.array(getattr(good, field)) for field in ("depth", "normal", "diffuse", "glossy")}
    planes["samples"] = np.full(good.shape, 4.0)
    before = {field: plane.copy() for field, plane in planes.items()}
    planes[name][6, 8] = bad
    fill = Fill(**planes, camera=coarse)
    if (name, bad) != ("normal", -1.0):  # which is a direction like any other
        assert np.isinf(fill.depth[6, 8])
        for field in ("normal", "diffuse", "glossy", "samples"):
            assert not np.any(getattr(fill, field)[6, 8])
    planes[name][6, 8] = before[name][6, 8]
    for field, plane in planes.items():
        np.testing.assert_array_equal(plane, before[field])
    rest = np.ones(good.shape, dtype=bool)
    rest[6, 8] = False
    for field in ("depth", "normal", "diffuse", "glossy"):
        np.testing.assert_array_equal(getattr(fill, field)[rest], getattr(good, field)[rest])
    found = filled(0.2, gbuffer, camera, fill)
    assert np.isfinite(found).all()
    assert found.max() < 2.0


def test_no_pixel_is_ever_negative_or_not_finite(rng):
    camera, coarse = Camera.perspective(40, 30, 1.0), Camera.perspective(11, 7, 1.0)
    gbuffer, low = random_gbuffer(rng, (30, 40)), random_gbuffer(rng, (7, 11))
    wild = rng.choice([0.0, 1e-20, 1.0, 1e5, 1e14, np.nan], (2, 7, 11, 3))
    fill = Fill(low.depth, low.normal, wild[0], wild[1], coarse)
    light = render_indirect(gbuffer, camera, make_settings(rays=2, bounces=2, filter=True), fill=fill)
    for image in (light.diffuse, light.glossy):
        assert np.isfinite(image).all()
        assert image.min() >= 0.0


def test_result_is_the_same_for_any_number_of_threads(rng):
    shape, coarse = (150, 200), Camera.perspective(50, 38, 1.0)
    gbuffer, low, camera = (
        random_gbuffer(rng, shape),
        random_gbuffer(rng, (38, 50)),
        Camera.perspective(200, 150, 1.0),
    )
    fill = Fill(low.depth, low.normal, low.direct, low.albedo, coarse)
    one, four = (filled(0.3, gbuffer, camera, fill, threads) for threads in (1, 4))
    np.testing.assert_array_equal(one, four)
    moved = replace(fill, camera=replace(coarse, world_from_view=look_at((0.1, 0.0, 0.0), (0.0, 0.0, -5.0))))
    one, four = (Fill.merged([moved, fill], threads) for threads in (1, 4))
    np.testing.assert_array_equal(one.diffuse, four.diffuse)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"depth": np.ones((3, 3))}, r"depth: expected the camera's shape \(12, 16\), got \(3, 3\)"),
        ({"diffuse": np.ones((12, 16))}, r"diffuse: expected shape \(12, 16, 3\)"),
        ({"glossy": np.ones((12, 16, 3), dtype=complex)}, "glossy: expected real numbers"),
        ({"samples": np.ones(3)}, "samples: expected shape"),
        ({"camera": None}, "camera: expected Camera, got NoneType"),
    ],
)
def test_wrong_fields_are_named(small, change, message):
    with pytest.raises(ValueError, match=message):
        replace(small, **change)


def test_wrong_fill_is_named(corner):
    with pytest.raises(ValueError, match="fill: expected Fill or None, got GBuffer"):
        render_indirect(*corner, make_settings(), fill=corner[0])
    with pytest.raises(ValueError, match="fills: expected at least one Fill"):
        Fill.merged([])


# --- A fill in place of rays ------------------------------------------------------------------------------


def replacing(**changes):
    return make_settings(rays=4, glossy_rays=1, fill_mode="replace", **changes)


def clean_fill_of(surfaces, camera: Camera, **light) -> Fill:
    return replace(fill_of(surfaces, camera, **light), is_denoised=True)


def test_fill_brings_the_light_where_no_ray_is_taken(corner):
    fill = clean_fill_of([FLOOR, WALL], camera_of((32, 24)), diffuse=0.7, glossy=0.3)
    light = render_indirect(*corner, replacing(visibility=False), fill=fill)
    surface = ~corner[0].is_background
    np.testing.assert_allclose(light.diffuse[surface], 0.7, rtol=FILTER_RELATIVE)
    np.testing.assert_allclose(light.glossy[surface], 0.3, rtol=FILTER_RELATIVE)
    assert not light.known[surface].any()
    assert not any(light.rays.values())
    assert any("the fill brings the light" in why for _, why in light.skipped)


def test_visibility_is_traced_beside_a_fill_and_changes_no_light(corner):
    fill = clean_fill_of([FLOOR, WALL], camera_of((32, 24)), diffuse=0.7, glossy=0.3)
    without = render_indirect(*corner, replacing(visibility=False), fill=fill)
    light = render_indirect(*corner, replacing(), fill=fill)
    rays = render_indirect(*corner, make_settings(rays=64))
    for name in ("diffuse", "glossy"):
        np.testing.assert_array_equal(getattr(light, name), getattr(without, name))
    surface = ~corner[0].is_background
    for name in ("visibility", "known_diffuse"):
        error = (getattr(light, name) - getattr(rays, name))[surface]
        assert abs(error.mean()) < FEW_VISIBILITY_RAYS
    np.testing.assert_array_equal(light.known_glossy, light.known_diffuse)


def test_without_a_fill_rays_bring_the_light_in_either_mode(corner):
    level, replaced = (
        render_indirect(*corner, make_settings(rays=2, fill_mode=mode)) for mode in ("level", "replace")
    )
    assert_same_light(level, replaced)


def test_noisy_fill_sets_the_level_in_either_mode(corner, small):
    level, replaced = (
        render_indirect(*corner, make_settings(rays=2, fill_mode=mode), fill=small)
        for mode in ("level", "replace")
    )
    assert_same_light(level, replaced)


def test_mirrors_show_what_the_fill_lights():
    """A mirror floor sees the wall: 1 that it hands on, and 0.5 x 0.6 + 0.5 x 0.2 of the fill's light."""
    mirror = replace(FLOOR, albedo=0.0, specular=1.0, roughness=0.0)
    camera = camera_of(SIZE)
    gbuffer = capture(camera, [mirror, WALL])
    fill = clean_fill_of([mirror, WALL], camera_of((32, 24)), diffuse=0.6, glossy=0.2)
    light = render_indirect(gbuffer, camera, replacing(visibility=False), fill=fill)
    floor = (gbuffer.roughness == 0.0) & ~gbuffer.is_background
    floor &= ~find_surface_edges(gbuffer, camera)
    met, lost = (floor & (light.known_glossy == known) for known in (1.0, 0.0))
    assert met.sum() > 100
    np.testing.assert_allclose(light.glossy[met], 1.4, rtol=FILTER_RELATIVE)
    # Rays that leave the frame find the fill's light in its place
    assert lost.sum() > 100
    np.testing.assert_allclose(light.glossy[lost], 0.2, rtol=FILTER_RELATIVE)


def test_views_hand_on_the_fill_s_light_and_its_mean_where_it_sees_nothing():
    """The mirror shows a wall beside the frame that a view knows: 1 + 0.5 x the fill's mean diffuse light."""
    mirror = replace(FLOOR, albedo=0.0, specular=1.0, roughness=0.0)
    camera = camera_of(SIZE)
    frame = capture(camera, [mirror])
    wider = Camera.perspective(*SIZE, 2.0, world_from_view=POSE)
    wall = replace(WALL, point=(0.0, 0.0, -30.0))
    fill = clean_fill_of([mirror], camera_of((32, 24)), diffuse=0.6)
    views = [(capture(wider, [mirror, wall]), wider)]
    light = render_indirect(frame, camera, replacing(visibility=False), views=views, fill=fill)
    met = ~frame.is_background & (light.known_glossy == 1.0)
    assert met.sum() > 100
    np.testing.assert_allclose(light.glossy[met], 1.3, rtol=FILTER_RELATIVE)


def test_denoised_fill_is_taken_at_its_word(corner, rng):
    """What varies in it is light; in a fill that nobody cleaned it is noise."""
    noise = rng.gamma(1.0, 1.0, (SMALL[1], SMALL[0], 3))
    noisy = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=noise)
    spread = [
        filled(1.0, *corner, replace(noisy, is_denoised=clean))[~corner[0].is_background].std()
        for clean in (False, True)
    ]
    assert spread[1] > 2.0 * spread[0]


def test_more_paths_or_less_known_rays_let_a_denoised_fill_weigh_more(corner):
    gbuffer, camera = corner
    surface = ~gbuffer.is_background

    def mean(samples: float, known: float) -> float:
        fill = fill_of([FLOOR, WALL], camera_of(SMALL), diffuse=2.0, samples=samples)
        return float(
            filled(1.0, gbuffer, camera, replace(fill, is_denoised=True), known=known)[surface].mean()
        )

    assert 1.0 < mean(0.1, 1.0) < mean(1.0, 1.0) < mean(1.0, 0.0) < 2.0


def test_fine_fill_is_read_between_its_four_nearest_pixels():
    """A gradient across one wall comes over as it is, but for the border."""
    camera, coarse = Camera.perspective(*SIZE, 1.0), Camera.perspective(32, 24, 1.0)
    wall = Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), albedo=0.5, specular=0.5, roughness=0.5)
    ramp = lambda points: np.repeat(3.0 + points[..., :1], 3, axis=-1)  # noqa: E731
    gbuffer = capture(camera, [wall])
    light = render_indirect(
        gbuffer, camera, replacing(visibility=False), fill=clean_fill_of([wall], coarse, diffuse=ramp)
    )
    expected = ramp(points_of(gbuffer, camera))
    np.testing.assert_allclose(light.diffuse[1:-1, 1:-1], expected[1:-1, 1:-1], rtol=FILTER_RELATIVE)


# --- Several fills ----------------------------------------------------------------------------------------


def test_merged_fills_of_one_camera_are_their_weighted_mean(rng):
    camera = Camera.perspective(*SMALL, 1.0)
    wall = Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0))
    lights = rng.random((2, *SMALL[::-1], 3))
    fills = [
        fill_of([wall], camera, *lights, samples=1.0),
        fill_of([wall], camera, *lights[::-1], samples=3.0),
    ]
    merged = Fill.merged(fills)
    np.testing.assert_allclose(merged.diffuse, 0.25 * lights[0] + 0.75 * lights[1], rtol=FILTER_RELATIVE)
    np.testing.assert_allclose(merged.glossy, 0.25 * lights[1] + 0.75 * lights[0], rtol=FILTER_RELATIVE)
    np.testing.assert_array_equal(merged.samples, 4.0)


def test_fills_of_a_moving_camera_lose_their_noise(rng):
    """Eight frames of one floor: each has its own noise, the mean has a third of it and none of a bias."""
    places = [look_at((0.1 * frame, 3.0, 5.0), (0.05 * frame, 0.6, 0.0)) for frame in range(8)]
    fills = [
        fill_of(
            [FLOOR, WALL], camera_of((32, 24), pose), diffuse=rng.gamma(1.0, 1.0, (24, 32, 3)), samples=4.0
        )
        for pose in places
    ]
    merged = Fill.merged(fills)
    assert merged.camera is fills[-1].camera
    np.testing.assert_array_equal(merged.depth, fills[-1].depth)
    surface = np.isfinite(merged.depth) & (merged.samples >= 8 * 4 - 1)
    assert surface.mean() > 0.5
    assert merged.diffuse[surface].std() < MERGED_NOISE
    assert abs(merged.diffuse[surface].mean() - 1.0) < MERGED_MEAN


def test_denoised_fills_are_merged_among_themselves(small):
    clean = replace(small, is_denoised=True)
    assert Fill.merged([clean, clean]).is_denoised
    assert not Fill.merged([small, small]).is_denoised
    with pytest.raises(ValueError, match="expected all denoised or none"):
        Fill.merged([small, clean])


def test_what_came_into_sight_has_the_newest_light_alone():
    """A plate covered part of the wall before: that part keeps its own light and number of samples."""
    wall = Plane((0.0, 0.0, -8.0), (0.0, 0.0, 1.0))
    plate = Plane((0.0, 0.0, -3.0), (0.0, 0.0, 1.0), bounds=lambda points: points[:, 0] < 0.0)
    camera = Camera.perspective(*SMALL, 1.0)
    before = fill_of([plate, wall], camera, diffuse=5.0, samples=4.0)
    now = fill_of([wall], camera, diffuse=1.0, samples=4.0)
    merged = Fill.merged([before, now])
    np.testing.assert_allclose(merged.diffuse[:, :6], 1.0, rtol=FILTER_RELATIVE)
    np.testing.assert_array_equal(merged.samples[:, :6], 4.0)
    np.testing.assert_allclose(merged.diffuse[:, 10:], 3.0, rtol=FILTER_RELATIVE)


def test_pixels_of_a_fill_without_light_of_rays_are_no_part_of_the_level():
    """Half of the frame has no rays: the other half's level is not taken for half as dark."""
    camera, coarse = Camera.perspective(*SIZE, 1.0), Camera.perspective(*SMALL, 1.0)
    gbuffer = uniform_gbuffer(SIZE[::-1], 5.0)
    low = uniform_gbuffer(SMALL[::-1], 5.0)
    fill = Fill(low.depth, low.normal, np.ones((12, 16, 3)), np.ones((12, 16, 3)), coarse)
    pixel = np.arange(gbuffer.depth.size)[::2]
    light = np.ones((pixel.size, 3), dtype=np.float32)
    known = np.zeros(pixel.size, dtype=np.float32)
    (found,) = set_level([Answered(light, known, pixel, fill.diffuse)], (gbuffer, camera), fill, 1)
    np.testing.assert_allclose(found, 1.0, rtol=FILTER_RELATIVE)
