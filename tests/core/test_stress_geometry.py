# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry that broke screen-space methods: rims, thin things, shelves, near planes, bent normals."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, Fill, GBuffer, Settings, composite, render_indirect, tracer
from ssgi_addon.core.depth_field import DepthField
from tests.core.synthetic import Plane, Sphere, capture, make_settings, uniform_gbuffer
from tests.core.test_pipeline import assert_in_range
from tests.tolerances import (
    AVERAGED_RIM_MEAN,
    CLOSED_FORM_RELATIVE,
    COPLANAR_LAYER_MEAN,
    FURNACE,
    REPEATED_SUM,
    ROUND_BLUR,
    SAME_BLUR_AT_ANY_DISTANCE,
    WIRE_SHARE,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
METHODS = ("hemisphere", "horizon", "bitmask", "ssao")
FLOOR = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.6, source=0.3)
WALL = Plane((0.0, 0.0, -9.0), (0.0, 0.0, 1.0), albedo=0.7, source=1.0)
BALL = Sphere((0.0, 0.0, -5.0), 0.8, albedo=0.4, specular=0.5, roughness=0.2, source=2.0)


def with_method(method: str, **options) -> Settings:
    settings = make_settings(**{"rays": 8, "bounces": 2, "filter": True, **options})
    return replace(settings, diffuse=replace(settings.diffuse, method=method))


def averaged(fine: GBuffer, side: int) -> GBuffer:
    """Return a frame as renderers write it: one sample of depth, everything else the mean of all samples."""
    height, width = fine.shape[0] // side, fine.shape[1] // side

    def mean(image: np.ndarray) -> np.ndarray:
        return (
            image.reshape(height, side, width, side, -1)
            .mean(axis=(1, 3))
            .reshape(height, width, *image.shape[2:])
        )

    middle = side // 2
    passes = {
        name: mean(getattr(fine, name)) for name in ("normal", "albedo", "specular", "roughness", "direct")
    }
    return GBuffer(depth=fine.depth[middle::side, middle::side], **passes)


# Case 1: silhouettes.


def test_passes_averaged_over_a_rim_change_the_light_at_the_rim_alone():
    coarse, fine = (Camera.perspective(64 * side, 48 * side, 0.9) for side in (1, 5))
    clean = capture(coarse, [FLOOR, WALL, BALL])
    mixed = averaged(capture(fine, [FLOOR, WALL, BALL]), 5)
    lengths = np.linalg.norm(mixed.normal, axis=-1)
    assert np.allclose(lengths[~mixed.is_background], 1.0, atol=REPEATED_SUM)
    lights = [
        render_indirect(frame, coarse, with_method("hemisphere", rays=32), WHITE) for frame in (clean, mixed)
    ]
    for light in lights:
        assert_in_range(light)
    is_rim = np.abs(mixed.albedo - clean.albedo).max(axis=-1) > 0.01
    assert 0.01 < is_rim.mean() < 0.2
    for name in ("diffuse", "visibility"):
        found, expected = (getattr(light, name)[~is_rim] for light in lights)
        assert np.abs(found - expected).mean() <= AVERAGED_RIM_MEAN * expected.mean()
    # No dots: what is mixed lies between what is clean
    pictures = [composite(frame, light) for frame, light in zip((clean, mixed), lights, strict=True)]
    assert pictures[1].max() <= (1.0 + AVERAGED_RIM_MEAN) * pictures[0].max()


# Case 9: a camera inside of things, and what its near plane cuts.


@pytest.mark.parametrize("method", METHODS)
def test_camera_inside_a_ball_sees_a_closed_room(method):
    """From within, a ball of one radiance is a furnace: what the frame shows of it is as bright as it is."""
    camera = Camera.perspective(48, 36, 1.9)
    inside = Sphere((0.1, 0.0, -0.2), 1.0, albedo=1.0, source=1.0)
    light = render_indirect(capture(camera, [inside]), camera, with_method(method, rays=32, bounces=1), WHITE)
    assert_in_range(light)
    if method != "ssao":
        np.testing.assert_allclose(light.diffuse, 1.0, atol=FURNACE)


@pytest.mark.parametrize("height", [1e-3, 1e-5])
@pytest.mark.parametrize("is_orthographic", [False, True])
def test_floor_at_the_height_of_the_camera_does_not_cover_itself(height, is_orthographic):
    """It runs through the near plane: its first row is a thousand times nearer than its last one."""
    make = Camera.orthographic if is_orthographic else Camera.perspective
    camera = make(48, 36, 1.2)
    gbuffer = capture(camera, [Plane((0.0, -height, -3.0), (0.0, 1.0, 1e-3), albedo=1.0, source=1.0)])
    for method in METHODS:
        light = render_indirect(gbuffer, camera, with_method(method, filter=False), WHITE)
        assert_in_range(light)
        surface = ~gbuffer.is_background
        assert light.visibility[surface].min() >= 1.0 - 2.0 / 32.0, method  # a sector to each side


def test_what_the_near_plane_cuts_open_is_not_seen_into():
    """A box around the camera's left half is cut away by the near plane: rays toward it leave the frame."""
    camera = Camera.perspective(48, 36, 1.2)
    near = Plane((-0.02, 0.0, 0.0), (1.0, 0.0, 0.0), albedo=0.5, source=5.0, bounds=lambda p: p[:, 2] > -0.3)
    gbuffer = capture(camera, [FLOOR, WALL, near])
    depth = np.where(gbuffer.depth < 0.1, np.inf, gbuffer.depth)  # clipped
    cut = replace(gbuffer, depth=depth)
    for method in METHODS:
        assert_in_range(render_indirect(cut, camera, with_method(method), WHITE))


# Case 10: normals.


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("is_orthographic", [False, True])
def test_normals_exactly_along_an_axis_give_light_in_range(axis, sign, is_orthographic):
    """Edge-on and back-facing ones too: tangent frames have no pole, and lobes no view from below."""
    normal = np.zeros((13, 17, 3))
    normal[..., axis] = sign
    make = Camera.orthographic if is_orthographic else Camera.perspective
    for roughness in (0.0, 0.3, 1.0):
        gbuffer = uniform_gbuffer((13, 17), 4.0, normal=normal, roughness=roughness, albedo=1.0, specular=1.0)
        for method in METHODS:
            light = render_indirect(gbuffer, make(17, 13, 1.1), with_method(method, rays=4), WHITE)
            assert_in_range(light)
            np.testing.assert_array_less(light.glossy, 1.0 + FURNACE)
            np.testing.assert_array_less(light.diffuse, 2.0 + FURNACE)


# Case 11: coplanar duplicates, thin things, shelves.


def test_layer_behind_at_the_same_depth_changes_little():
    """Two coplanar faces: a peeled layer that is the front once more."""
    camera = Camera.perspective(48, 36, 0.9)
    gbuffer = capture(camera, [FLOOR, WALL, BALL])
    twice = replace(gbuffer, behind=gbuffer)
    lights = [
        render_indirect(frame, camera, with_method("hemisphere", rays=32), WHITE)
        for frame in (gbuffer, twice)
    ]
    for name in ("diffuse", "glossy", "visibility"):
        found, expected = (getattr(light, name).mean(dtype=np.float64) for light in reversed(lights))
        assert found == pytest.approx(expected, rel=COPLANAR_LAYER_MEAN), name


def test_depth_that_fights_with_itself_covers_nothing():
    """Two faces at one place: depth flickers between them by rounding, from pixel to pixel."""
    camera = Camera.perspective(48, 36, 0.9)
    flat = capture(camera, [Plane((0.0, 0.0, -7.0), (0.2, 0.3, 1.0), albedo=1.0, source=1.0)])
    flicker = np.random.default_rng(1).choice([-1.0, 0.0, 1.0], flat.shape) * 2.0**-22
    gbuffer = replace(flat, depth=flat.depth.astype(np.float64) * (1.0 + flicker))
    light = render_indirect(gbuffer, camera, with_method("hemisphere", filter=False), WHITE)
    assert (light.visibility[~gbuffer.is_background] == 1.0).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [1, 8])
def test_wires_of_one_pixel_cover_no_more_than_they_are(method, count):
    """Grass before a wall may hide it by its own share, and not by slabs behind it."""
    camera = Camera.perspective(65, 49, 0.9)
    gbuffer = capture(camera, [replace(WALL, albedo=1.0)])
    columns = np.linspace(0, 64, count + 2).astype(int)[1:-1]
    depth, direct = gbuffer.depth.copy(), gbuffer.direct.copy()
    depth[:, columns], direct[:, columns] = 8.0, 0.0
    wired = replace(gbuffer, depth=depth, direct=direct, thickness=np.full(gbuffer.shape, 0.05))
    light = render_indirect(wired, camera, with_method(method, rays=64, bounces=1, filter=False), WHITE)
    assert_in_range(light)
    is_wall = wired.depth > 8.5
    closed = 1.0 - light.visibility[is_wall].mean()
    # Below a horizon everything counts as solid
    assert closed <= WIRE_SHARE * count / 65 or method == "horizon"


def test_deep_shelves_seen_edge_on_are_dark_inside_and_finite():
    """Boards of one pixel with dark gaps between them, alternating row by row."""
    camera = Camera.perspective(48, 40, 0.7)
    depth = np.where(np.arange(40)[:, None] % 2 == 0, 4.0, 9.0) * np.ones((1, 48))
    gbuffer = uniform_gbuffer((40, 48), depth, albedo=0.8, specular=0.2, roughness=0.3, direct=1.0)
    for method in METHODS:
        for thickness in (None, np.full((40, 48), 5.0), np.zeros((40, 48))):
            light = render_indirect(replace(gbuffer, thickness=thickness), camera, with_method(method), WHITE)
            assert_in_range(light)
            assert light.visibility[1:-1:2].mean() <= light.visibility[::2].mean(), method


def test_walks_agree_on_shelves_and_wires():
    camera = Camera.perspective(48, 40, 0.7)
    depth = np.where((np.arange(40)[:, None] % 2 == 0) & (np.arange(48) % 5 != 0), 4.0, 9.0)
    gbuffer = uniform_gbuffer((40, 48), depth)
    rng = np.random.default_rng(3)
    y, x = rng.integers(0, 40, 5000), rng.integers(0, 48, 5000)
    origin = camera.pixel_to_view(x + 0.5, y + 0.5, depth[y, x]).T.astype(np.float32)
    direction = rng.normal(size=(3, 5000)).astype(np.float32)
    found = [
        tracer.trace_rays(DepthField.build(gbuffer, camera, 0.1, max_level=level), origin, direction)
        for level in (0, 7)
    ]
    np.testing.assert_array_equal(found[0].status, found[1].status)
    np.testing.assert_array_equal(found[0].pixel, found[1].pixel)


# Cases 24 and 25: the dark, and one pixel of blinding light.


@pytest.mark.parametrize("method", METHODS)
def test_mirrors_and_metals_in_the_dark_are_black(method):
    for roughness in (0.0, 0.5):
        gbuffer = uniform_gbuffer((9, 11), 3.0, albedo=0.0, specular=1.0, roughness=roughness, direct=0.0)
        light = render_indirect(gbuffer, Camera.perspective(11, 9, 1.0), with_method(method))
        assert_in_range(light)
        assert (composite(gbuffer, light) == 0.0).all()


@pytest.mark.parametrize("method", METHODS)
def test_nothing_lit_is_multiplied_away(method):
    """Light that only one surface has stays where it is, whatever is black around it."""
    gbuffer = uniform_gbuffer((9, 11), 3.0, albedo=0.0, specular=0.0, direct=0.0)
    direct = gbuffer.direct.copy()
    direct[4, 5] = (1e-6, 1.0, 1e4)
    gbuffer = replace(gbuffer, direct=direct)
    light = render_indirect(gbuffer, Camera.perspective(11, 9, 1.0), with_method(method), WHITE)
    np.testing.assert_array_equal(composite(gbuffer, light), direct)


def test_light_of_one_blinding_pixel_falls_on_what_sees_it_and_is_not_clamped():
    """Its energy is a mean over rays: the sum over a floor is as many times brighter as the pixel is."""
    camera = Camera.perspective(48, 36, 0.9)
    gbuffer = capture(camera, [replace(FLOOR, source=0.0), replace(WALL, source=0.0)])
    sums = []
    for radiance in (1.0, 1e5):
        direct = np.zeros((36, 48, 3), np.float32)
        direct[10, 24] = radiance
        lit = replace(gbuffer, direct=direct)
        light = render_indirect(lit, camera, with_method("hemisphere", rays=64, bounces=1, filter=False))
        assert_in_range(light)
        sums.append(light.diffuse.sum(dtype=np.float64))
    assert sums[1] == pytest.approx(1e5 * sums[0], rel=CLOSED_FORM_RELATIVE)


def test_light_that_the_limit_on_fireflies_takes_is_told():
    """One of 192 pixels of a fill is a thousand times as bright: most of its light is left out, and said."""
    camera, coarse = Camera.perspective(48, 36, 0.9), Camera.perspective(16, 12, 0.9)
    gbuffer, seen = capture(camera, [WALL, FLOOR]), capture(coarse, [WALL, FLOOR])
    told = []
    for brightest in (1.0, 1000.0):
        diffuse = np.ones((12, 16, 3))
        diffuse[6, 8] = brightest
        fill = Fill(seen.depth, seen.normal, diffuse, np.zeros_like(diffuse), coarse)
        light = render_indirect(gbuffer, camera, with_method("hemisphere"), fill=fill)
        assert_in_range(light)
        told.append([what for what, why in light.skipped if "outshine" in why])
    assert told[0] == []
    assert len(told[1]) == 1
    share = float(told[1][0].partition("%")[0]) / 100.0
    assert 0.5 < share < 1000.0 / 1191.0
    assert told[1][0].endswith("of the fill's diffuse light")


# Case 26: rough reflections.


def edge_width(profile: np.ndarray) -> float:
    """Return over how many pixels an edge falls from three quarters to one quarter."""
    profile = (profile - profile.min()) / np.ptp(profile)
    order = np.argsort(profile)
    return abs(float(np.diff(np.interp([0.25, 0.75], profile[order], np.arange(profile.size)[order]))[0]))


@functools.cache
def blurred_edge(is_upright: bool, scale: float) -> float:
    """Return the width of a black and white edge in a rough mirror that faces the camera, pixels.

    The edge is behind the camera, in a view of its own, twice as far from the mirror as the camera is.
    """
    camera = Camera.perspective(48, 48, 0.6)
    mirror = Plane((0.0, 0.0, -5.0 * scale), (0.0, 0.0, 1.0), specular=1.0, roughness=0.35)
    axis = 0 if is_upright else 1
    shown = Plane(
        (0.0, 0.0, 5.0 * scale), (0.0, 0.0, -1.0),
        source=lambda p: np.repeat((p[:, axis] > 0.0)[:, None] * 1.0, 3, axis=1),
    )  # fmt: skip
    turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    back = Camera.perspective(192, 192, 2.4, world_from_view=turn)
    settings = make_settings(rays=64, diffuse=False, filter=False)
    gbuffer = capture(camera, [mirror])
    light = render_indirect(gbuffer, camera, settings, None, [(capture(back, [shown]), back)])
    image = light.glossy[..., 0].mean(axis=0 if is_upright else 1, dtype=np.float64)
    return edge_width(image[8:-8])


def test_rough_reflections_blur_edges_alike_in_all_directions():
    upright, level = blurred_edge(True, 1.0), blurred_edge(False, 1.0)
    assert upright > 3.0
    assert upright == pytest.approx(level, rel=ROUND_BLUR)


def test_rough_reflections_are_as_wide_on_the_screen_at_any_distance():
    """Mirror, camera and edge farther apart by as much: the same picture, not one blurred by pixels."""
    widths = [blurred_edge(True, scale) for scale in (0.1, 1.0, 30.0)]
    np.testing.assert_allclose(widths, widths[1], rtol=SAME_BLUR_AT_ANY_DISTANCE)
