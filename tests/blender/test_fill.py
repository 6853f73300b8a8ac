# SPDX-License-Identifier: GPL-3.0-or-later
"""The fill: a small render of the light that Cycles finds with the scene's own bounces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.build import add_box, add_camera, new_material
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.fill import denoised_fill
from ssgi_addon.core import Settings, composite
from ssgi_addon.core.fill import Fill
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import read_passes, write_passes
from ssgi_addon.results import compute_picture
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.opengl import needs_opengl
from tests.scenes import build_closed_room, new_scene
from tests.tolerances import (
    CAPTURED_GEOMETRY,
    DENOISED_FILL,
    FILLED_PICTURE,
    FURNACE_OF_CYCLES,
    PASS_SUM_RELATIVE,
    REPROJECTED_PX,
    SURROUND_DEPTH,
    UNIT_NORMAL,
)

OPTIONS = CaptureOptions(samples=1, denoiser="none", resolution=(32, 20), fill=4)
# Samples after which guided paths go other ways than those before them.
LEARNING = 8


@pytest.fixture
def room(empty_file):
    return build_closed_room()


def fill_in(scene, options=OPTIONS) -> tuple[CapturedFrame, Fill]:
    frame = capture_frame(scene, options)
    assert frame.fill is not None
    return frame, frame.fill


def test_none_is_rendered_unless_asked_for(room):
    frame = capture_frame(room, replace(OPTIONS, fill=0))
    assert frame.fill is None
    assert "fill" not in frame.seconds


def test_one_is_rendered_where_geometry_came_with_the_light(room):
    frame, _ = fill_in(room, replace(OPTIONS, own_geometry=False))
    assert "geometry" not in frame.seconds
    assert frame.seconds["fill"] > 0.0


@pytest.mark.parametrize("size", [(32, 20), (33, 19), (4, 3), (5, 31)])
def test_pixel_of_a_fill_stands_for_four_of_the_frame_each_way(room, size):
    frame, fill = fill_in(room, replace(OPTIONS, resolution=size))
    assert fill.shape == (math.ceil(size[1] / 4), math.ceil(size[0] / 4))
    assert frame.seconds["fill"] > 0.0
    # Both look the same way, and as far as pixels allow
    assert np.allclose(fill.camera.world_from_view, frame.camera.world_from_view, atol=UNIT_NORMAL)
    stride = frame.camera.fx / fill.camera.fx
    assert abs(stride * max(fill.shape) - max(size)) < 4.0
    np.testing.assert_array_equal(fill.samples, 4.0)


def test_denoised_fill_is_finer_and_has_less_noise(room):
    """As many light paths over four times as many pixels; what the denoiser leaves is not their noise."""
    options = replace(OPTIONS, resolution=(128, 80))
    truth = fill_in(room, replace(options, fill=1024))[1]
    _, noisy = fill_in(room, options)
    frame, clean = fill_in(room, replace(options, fill_denoiser="fast"))
    assert (noisy.is_denoised, clean.is_denoised) == (False, True)
    assert clean.shape == (40, 64)
    np.testing.assert_array_equal(clean.samples, 1.0)
    blocks = clean.diffuse.reshape(20, 2, 32, 2, 3).mean(axis=(1, 3))
    error = [np.square(light - truth.diffuse).mean() for light in (noisy.diffuse, blocks)]
    assert error[1] < DENOISED_FILL * error[0]
    assert frame.fill is clean


def test_fill_of_many_paths_has_as_many_pixels_as_the_frame(room):
    frame, fill = fill_in(room, replace(OPTIONS, fill=64, fill_denoiser="accurate"))
    assert fill.shape == frame.gbuffer.shape
    np.testing.assert_array_equal(fill.samples, 4.0)


def test_fill_of_few_paths_stays_coarse(room):
    """There is no fourth of a sample."""
    _, fill = fill_in(room, replace(OPTIONS, fill=3, fill_denoiser="fast"))
    assert fill.shape == (5, 8)
    np.testing.assert_array_equal(fill.samples, 3.0)
    assert fill.is_denoised


def test_glossy_light_that_nothing_takes_is_left_alone(room):
    _, noisy = fill_in(room)
    clean = denoised_fill(room, noisy, has_glossy=False)
    np.testing.assert_array_equal(clean.glossy, noisy.glossy)
    assert not np.array_equal(clean.diffuse, noisy.diffuse)


def test_light_that_is_not_split_is_what_surfaces_show(room):
    """Emission is none of it: emitters are lamps already."""
    frame = capture_frame(
        room, replace(OPTIONS, fill=0, own_geometry=False, splits_light=False, keep_passes=False)
    )
    assert "Diffuse Direct" not in frame.layers
    shown = np.maximum(frame.layers["Combined"] - frame.layers["Emission"], 0.0)
    np.testing.assert_allclose(frame.gbuffer.reflection_source, shown, rtol=PASS_SUM_RELATIVE)
    np.testing.assert_allclose(frame.gbuffer.diffuse_source, shown, rtol=PASS_SUM_RELATIVE)


def test_bounces_that_are_off_in_the_scenes_own_renders_are_on_in_a_fill(room):
    """Who takes the light from our layers switches Cycles' own off, and renders again."""
    _, fill = fill_in(room)
    room.cycles.diffuse_bounces = room.cycles.glossy_bounces = 0
    _, again = fill_in(room)
    assert fill.diffuse.max() > 0.0
    np.testing.assert_array_equal(again.diffuse, fill.diffuse)
    assert room.cycles.diffuse_bounces == room.cycles.glossy_bounces == 0


def test_geometry_is_that_of_the_pixels_centres(room):
    """A point of the fill's surface lies on the frame's, where the frame has that pixel's neighbours."""
    frame, fill = fill_in(room)
    y, x = np.mgrid[0 : fill.shape[0], 0 : fill.shape[1]] + 0.5
    points = fill.camera.pixel_to_view(x, y, fill.depth.astype(np.float64))
    x_px, y_px, depth = frame.camera.view_to_pixel(points)
    assert np.allclose(x_px, 4 * x, atol=REPROJECTED_PX)
    assert np.allclose(y_px, 4 * y, atol=REPROJECTED_PX)
    corners = [frame.gbuffer.depth[2 + dy :: 4, 2 + dx :: 4] for dy in (-1, 0) for dx in (-1, 0)]
    between = (depth > np.min(corners, axis=0) * (1 - SURROUND_DEPTH)) & (
        depth < np.max(corners, axis=0) * (1 + SURROUND_DEPTH)
    )
    assert between.all()
    assert np.allclose(np.linalg.norm(fill.normal, axis=-1), 1.0, atol=CAPTURED_GEOMETRY)


def test_cropped_frame_has_a_fill_of_the_whole(room):
    room.render.use_border = room.render.use_crop_to_border = True
    room.render.border_min_x, room.render.border_max_x = 0.5, 0.6
    room.render.border_min_y, room.render.border_max_y = 0.5, 0.65
    frame, fill = fill_in(room)
    assert frame.gbuffer.shape == (3, 3)
    assert fill.shape == (5, 8)
    picture = compute_picture(frame, Settings.preset("draft"))
    unfilled = compute_picture(replace(frame, fill=None), Settings.preset("draft"))
    assert picture.combined.mean() > unfilled.combined.mean()


def test_closed_white_room_is_filled_with_its_closed_form(empty_file):
    """Walls that emit 1 and reflect a half: what comes from all sides is 2, and 1 of it was reflected.

    A camera in a corner sees less than half of the walls, so the rays alone know too little.
    """
    scene = new_scene("Furnace")
    glow = new_material("Glow", (0.5, 0.5, 0.5), roughness=1.0, specular=0.0, emission=1.0)
    add_box(scene, "Room", glow, (-1, -1, -1), (1, 1, 1))
    add_camera(scene, (-0.9, -0.8, 0.1), (1.0, 0.9, -0.1), lens=35.0)
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 32
    frame, _ = fill_in(scene, replace(OPTIONS, samples=256, fill=256))
    color = frame.gbuffer.albedo.mean()
    emitted = frame.layers["Emission"].mean()
    expected = emitted * color / (1.0 - color)
    light = compute_picture(frame, Settings.preset("balanced")).light
    unfilled = compute_picture(replace(frame, fill=None), Settings.preset("balanced")).light
    assert unfilled.diffuse.mean() < 0.7 * expected
    assert math.isclose(light.diffuse.mean(), expected, rel_tol=FURNACE_OF_CYCLES)
    np.testing.assert_array_equal(light.known, unfilled.known)


def test_bounces_are_those_of_the_scene(room):
    _, many = fill_in(room, replace(OPTIONS, fill=32))
    room.cycles.max_bounces = room.cycles.diffuse_bounces = 1
    _, one = fill_in(room, replace(OPTIONS, fill=32))
    room.cycles.max_bounces = 0
    _, none = fill_in(room, replace(OPTIONS, fill=32))
    assert many.diffuse.mean() > 1.3 * one.diffuse.mean() > 0.0
    assert none.diffuse.max() == 0.0


def test_fill_is_the_same_after_another_where_the_scene_guides_its_paths(room):
    """What guiding has learned would go on where Cycles' scene is kept, and light would depend on it."""
    room.cycles.use_guiding = True
    room.render.use_persistent_data = True
    options = replace(OPTIONS, fill=16 * LEARNING)
    _, first = fill_in(room, options)
    _, second = fill_in(room, options)
    assert np.array_equal(first.diffuse, second.diffuse)
    assert room.cycles.use_guiding


def test_clamping_is_off_in_the_fill_alone(room):
    room.cycles.sample_clamp_indirect = room.cycles.sample_clamp_direct = 1e-3
    _, fill = fill_in(room)
    assert fill.diffuse.mean() > 0.05
    assert math.isclose(room.cycles.sample_clamp_indirect, 1e-3, rel_tol=CAPTURED_GEOMETRY)


def test_scene_is_as_before(room):
    room.render.use_border = True
    room.render.border_max_x = 0.7
    room.cycles.use_denoising = True
    before = fingerprint()
    capture_frame(room, OPTIONS)
    assert not changes(before, fingerprint())


def test_scene_is_as_before_after_a_cancel(room):
    before = fingerprint()

    def cancel(_fraction, text):
        if text == "Fill":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        capture_frame(room, OPTIONS, cancel)
    assert not changes(before, fingerprint())


@needs_opengl
def test_eevee_has_no_fill_and_says_so(room):
    frame = capture_frame(room, replace(OPTIONS, engine="eevee"))
    assert frame.fill is None
    assert "Only Cycles can render a fill: it is left out." in frame.notes


def test_captured_fill_reads_back_to_the_same_picture(room, tmp_path):
    pytest.importorskip("OpenEXR")
    frame, fill = fill_in(room)
    found = read_passes(write_passes(frame, tmp_path, "room_0001"))
    assert found.fill is not None
    for name in ("depth", "normal", "diffuse", "glossy", "samples"):
        np.testing.assert_array_equal(getattr(found.fill, name), getattr(fill, name))
    settings = Settings.preset("draft")
    pictures = [compute_picture(each, settings).combined for each in (frame, found)]
    np.testing.assert_array_equal(*pictures)


def test_filled_picture_is_as_bright_as_with_global_illumination(room):
    from ssgi_addon.blender.reference import ReferenceOptions, render_reference

    options = replace(OPTIONS, resolution=(64, 36), samples=64, fill=64)
    frame, _ = fill_in(room, options)
    truth = render_reference(room, ReferenceOptions(samples=64, denoiser="none", resolution=(64, 36)))
    expected = composite(
        frame.gbuffer,
        replace(
            compute_picture(frame, Settings.preset("draft")).light,
            diffuse=truth.diffuse_indirect,
            glossy=truth.glossy_indirect,
        ),
    )
    picture = compute_picture(frame, Settings.preset("balanced"))
    unfilled = compute_picture(replace(frame, fill=None), Settings.preset("balanced"))
    assert abs(picture.combined.mean() / expected.mean() - 1.0) < FILLED_PICTURE
    assert abs(unfilled.combined.mean() / expected.mean() - 1.0) > 2 * FILLED_PICTURE
