# SPDX-License-Identifier: GPL-3.0-or-later
"""What a capture holds: the surface at each pixel's centre, its camera, and light without bounces."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import addon_utils

from ssgi_addon.blender import cycles_passes, render_settings
from ssgi_addon.blender.build import add_box, add_camera, new_material, new_world, node_tree
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.errors import SSGIError
from tests.scenes import WHITE, build_ball_over_plane, build_closed_room, build_emissive_room
from tests.tolerances import (
    CAPTURED_GEOMETRY,
    DENOISED_LIGHT,
    DENOISED_LIGHT_MEAN,
    PASS_SUM_RELATIVE,
    REPROJECTED_PX,
    UNIT_NORMAL,
)

ONE_SAMPLE = CaptureOptions(samples=1, denoiser="none")


@pytest.fixture
def steps(empty_file):
    """Boxes of different heights under an even sky, and a camera that sees past them."""
    scene = empty_file
    scene.world = new_world("Sky", (0.5, 0.6, 0.7), 1.0)
    scene.render.resolution_x, scene.render.resolution_y = 48, 30
    clay = new_material("Clay", WHITE)
    for index in range(5):
        x = 0.9 * index - 2.0
        add_box(scene, f"Step {index}", clay, (x, -0.3 * index, 0.0), (x + 0.7, 1.0, 0.5 + 0.4 * index))
    add_camera(scene, (0.6, -5.0, 3.0), (0.0, 0.3, 0.6), lens=30.0)
    return scene


def reprojection_error(frame):
    """Distance between each surface pixel's centre and where its point projects to, pixels, (N,)."""
    camera, is_surface = frame.camera, ~frame.gbuffer.is_background
    view_from_world = np.linalg.inv(camera.world_from_view)
    points_ws = frame.layers["Position"][is_surface].astype(np.float64)
    points_vs = points_ws @ view_from_world[:3, :3].T + view_from_world[:3, 3]
    x_px, y_px, depth = camera.view_to_pixel(points_vs)
    rows, columns = np.nonzero(is_surface)
    assert np.allclose(depth, frame.gbuffer.depth[is_surface], rtol=CAPTURED_GEOMETRY)
    return np.hypot(x_px - columns - 0.5, y_px - rows - 0.5)


# --- Geometry ---------------------------------------------------------------------------------------------


def test_first_row_is_the_top_of_the_picture(empty_file):
    """A box that fills the upper half before a camera that looks along +Y."""
    add_box(empty_file, "Upper", new_material("Clay", WHITE), (-9, 2, 0), (9, 3, 9))
    add_camera(empty_file, (0, 0, 0), (0, 2, 0), lens=50.0)
    empty_file.render.resolution_x, empty_file.render.resolution_y = 8, 8
    frame = capture_frame(empty_file, ONE_SAMPLE)
    assert np.abs(frame.gbuffer.depth[:4] - 2.0).max() < CAPTURED_GEOMETRY
    assert np.isposinf(frame.gbuffer.depth[4:]).all()


def test_normals_are_in_view_space(empty_file):
    """The wall that a camera faces has a normal toward it, whichever way both are turned."""
    add_box(empty_file, "Wall", new_material("Clay", WHITE), (2, -9, -9), (3, 9, 9))
    add_camera(empty_file, (0, 0, 0), (2, 0, 0), lens=50.0)
    empty_file.render.resolution_x, empty_file.render.resolution_y = 6, 4
    normal = capture_frame(empty_file, ONE_SAMPLE).gbuffer.normal
    assert np.abs(normal - (0.0, 0.0, 1.0)).max() < UNIT_NORMAL


def test_arrays_are_contiguous_single_precision(steps):
    gbuffer = capture_frame(steps, ONE_SAMPLE).gbuffer
    for name in ("depth", "normal", "albedo", "specular", "roughness", "direct", "source", "glossy_source"):
        array = getattr(gbuffer, name)
        assert array.dtype == np.float32, name
        assert array.flags.c_contiguous, name
        assert array.shape[:2] == (30, 48), name


def test_sky_and_holdouts_are_background(steps):
    steps.objects["Step 2"].is_holdout = True
    gbuffer = capture_frame(steps, ONE_SAMPLE).gbuffer
    steps.objects["Step 2"].is_holdout = False
    seen = capture_frame(steps, ONE_SAMPLE).gbuffer
    assert np.isposinf(gbuffer.depth[0]).all()
    assert gbuffer.is_background.sum() > seen.is_background.sum()
    assert not gbuffer.normal[gbuffer.is_background].any()


def test_depth_of_field_and_motion_blur_do_not_move_geometry(steps):
    sharp = capture_frame(steps, ONE_SAMPLE).gbuffer
    steps.camera.data.dof.use_dof = True
    steps.camera.data.dof.focus_distance = 1.0
    steps.camera.data.dof.aperture_fstop = 0.1
    steps.render.use_motion_blur = True
    steps.camera.location.x += 1.0
    steps.camera.keyframe_insert("location", frame=2)
    steps.camera.location.x -= 1.0
    steps.camera.keyframe_insert("location", frame=1)
    steps.frame_set(1)
    frame = capture_frame(steps, ONE_SAMPLE)
    assert np.array_equal(frame.gbuffer.depth, sharp.depth)
    assert any("Depth of field" in note for note in frame.notes)
    assert any("Motion blur" in note for note in frame.notes)


def test_volumes_do_not_hide_surfaces(steps):
    clear = capture_frame(steps, ONE_SAMPLE).gbuffer
    fog = new_material("Fog", WHITE)
    fog.node_tree.nodes.clear()
    for tree, kind in (
        (fog.node_tree, "ShaderNodeOutputMaterial"),
        (node_tree(steps.world), "ShaderNodeOutputWorld"),
    ):
        output = next((node for node in tree.nodes if node.bl_idname == kind), None) or tree.nodes.new(kind)
        scatter = tree.nodes.new("ShaderNodeVolumeScatter")
        scatter.inputs["Density"].default_value = 0.2
        tree.links.new(output.inputs["Volume"], scatter.outputs[0])
    add_box(steps, "Fog", fog, (-9, -4, -1), (9, 9, 9))
    frame = capture_frame(steps, ONE_SAMPLE)
    assert np.allclose(frame.gbuffer.depth, clear.depth, rtol=CAPTURED_GEOMETRY)
    assert any("'Fog', 'Sky'" in note for note in frame.notes)


# --- Camera -----------------------------------------------------------------------------------------------


def set_orthographic(scene):
    scene.camera.data.type = "ORTHO"
    scene.camera.data.ortho_scale = 6.0


def set_shift(scene):
    scene.camera.data.shift_x, scene.camera.data.shift_y = 0.2, -0.15


def set_orthographic_shift(scene):
    set_orthographic(scene)
    set_shift(scene)


def set_vertical_fit(scene):
    scene.camera.data.sensor_fit = "VERTICAL"
    scene.camera.data.sensor_height = 30.0


def set_tall_frame(scene):
    scene.render.resolution_x, scene.render.resolution_y = 31, 53
    set_shift(scene)


def set_pixel_aspect(scene):
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = 1.0, 1.7
    set_shift(scene)


def set_wide_pixels(scene):
    scene.render.pixel_aspect_x = 2.0


def set_percentage(scene):
    scene.render.resolution_x, scene.render.resolution_y = 101, 67
    scene.render.resolution_percentage = 33


def set_cropped_border(scene):
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = 0.1, 0.7
    render.border_min_y, render.border_max_y = 0.25, 0.9


def set_shifted_orthographic_border(scene):
    set_orthographic_shift(scene)
    set_cropped_border(scene)


def set_scaled_parent(scene):
    parent = bpy.data.objects.new("Rig", None)
    scene.collection.objects.link(parent)
    parent.scale = (3.0, 3.0, 3.0)
    parent.location = (0.3, -0.2, 0.1)
    scene.camera.parent = parent
    scene.camera.location /= 3.0


@pytest.mark.parametrize(
    "change",
    [
        None,
        set_orthographic,
        set_shift,
        set_orthographic_shift,
        set_vertical_fit,
        set_tall_frame,
        set_pixel_aspect,
        set_wide_pixels,
        set_percentage,
        set_cropped_border,
        set_shifted_orthographic_border,
        set_scaled_parent,
    ],
)
def test_surface_points_project_to_their_pixels(steps, change):
    if change is not None:
        change(steps)
    frame = capture_frame(steps, ONE_SAMPLE)
    assert frame.gbuffer.shape == (frame.camera.height, frame.camera.width)
    assert 0.05 < frame.gbuffer.is_background.mean() < 0.95
    assert reprojection_error(frame).max() < REPROJECTED_PX


def test_cropped_border_is_cut_out_of_the_whole_frame(steps):
    whole = capture_frame(steps, ONE_SAMPLE).gbuffer.depth
    set_cropped_border(steps)
    region = capture_frame(steps, ONE_SAMPLE).gbuffer.depth
    # 0.1 and 0.7 of 48 columns, 0.25 and 0.9 of 30 rows from the bottom
    assert np.allclose(region, whole[30 - 27 : 30 - 7, 4:33], rtol=CAPTURED_GEOMETRY)


def test_border_without_crop_captures_the_whole_frame(steps):
    whole = capture_frame(steps, ONE_SAMPLE).gbuffer.depth
    set_cropped_border(steps)
    steps.render.use_crop_to_border = False
    assert np.array_equal(capture_frame(steps, ONE_SAMPLE).gbuffer.depth, whole)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (5, 3), (13, 2), (3, 900)])
def test_any_size_can_be_captured(steps, size):
    frame = capture_frame(steps, CaptureOptions(samples=1, denoiser="none", resolution=size))
    assert (frame.camera.width, frame.camera.height) == size


def test_frames_larger_than_a_tile_come_back_whole(steps):
    steps.cycles.tile_size = 8
    gbuffer = capture_frame(steps, ONE_SAMPLE).gbuffer
    steps.cycles.tile_size = 2048
    assert np.array_equal(gbuffer.direct, capture_frame(steps, ONE_SAMPLE).gbuffer.direct)


# --- Light ------------------------------------------------------------------------------------------------


def direct_sum(layers):
    """Everything that the passes say reaches the camera without a diffuse or glossy bounce."""
    transmission = layers["Transmission Direct"] + layers["Transmission Indirect"]
    return (
        layers["Diffuse Direct"] * layers["Diffuse Color"]
        + layers["Glossy Direct"] * layers["Glossy Color"]
        + transmission * layers["Transmission Color"]
        + layers["Volume Direct"]
        + layers["Volume Indirect"]
        + layers["Emission"]
        + layers["Environment"]
    )


@pytest.mark.parametrize("build", [build_closed_room, build_emissive_room, build_ball_over_plane])
def test_direct_light_is_the_sum_of_the_direct_passes(empty_file, build):
    frame = capture_frame(build(), CaptureOptions(samples=4, denoiser="none"))
    error = np.abs(direct_sum(frame.layers) - frame.gbuffer.direct).max()
    assert error < PASS_SUM_RELATIVE * frame.gbuffer.direct.max()


def test_glass_and_volumes_are_in_the_sum_of_the_direct_passes(steps):
    glass = bpy.data.materials.new("Glass")
    nodes = node_tree(glass).nodes
    nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1.0
    add_box(steps, "Pane", glass, (-1.0, -3.0, 0.5), (1.0, -2.5, 2.0))
    mist = new_material("Mist", WHITE)
    mist.node_tree.nodes.clear()
    scatter = mist.node_tree.nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 0.02
    output = mist.node_tree.nodes.new("ShaderNodeOutputMaterial")
    mist.node_tree.links.new(output.inputs["Volume"], scatter.outputs[0])
    add_box(steps, "Mist", mist, (-9, -4, -1), (9, 9, 9))
    frame = capture_frame(steps, CaptureOptions(samples=4, denoiser="none"))
    assert frame.layers["Transmission Indirect"].max() > 0.0
    assert frame.layers["Volume Direct"].max() > 0.0
    error = np.abs(direct_sum(frame.layers) - frame.gbuffer.direct).max()
    assert error < PASS_SUM_RELATIVE * frame.gbuffer.direct.max()
    assert any("'Glass'" in note and "refraction" in note for note in frame.notes)


def test_sources_hold_no_emission(empty_file):
    """The glowing panel shines in the direct light; as a source it is dark: Cycles counted its light."""
    frame = capture_frame(build_emissive_room(), CaptureOptions(samples=4, denoiser="none"))
    is_panel = frame.layers["Emission"].min(axis=-1) > 7.0  # 12 x (1, 0.85, 0.6), without edges
    assert is_panel.any()
    assert frame.emission_in_direct
    assert frame.world_in_direct
    assert frame.environment is None
    handed_on = frame.gbuffer.glossy_source[is_panel]
    assert handed_on.max() < 0.1 * frame.gbuffer.direct[is_panel].min()


def test_shadow_is_black_without_bounces(empty_file):
    """Under a sun, what faces away from it sees no light but what the ground would reflect."""
    scene = empty_file
    clay = new_material("Clay", WHITE)
    add_box(scene, "Ground", clay, (-9, -9, -1), (9, 9, 0))
    add_box(scene, "Roof", clay, (-9, 0, 2), (9, 9, 3))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.angle = 0.0
    scene.collection.objects.link(sun)
    add_camera(scene, (0, 4, 1.0), (0, 9, 2.0), lens=30.0)
    scene.render.resolution_x, scene.render.resolution_y = 16, 12
    gbuffer = capture_frame(scene, CaptureOptions(samples=4, denoiser="none")).gbuffer
    assert gbuffer.direct[~gbuffer.is_background].max() == 0.0


def test_denoising_cleans_the_direct_light_and_what_surfaces_hand_on(empty_file):
    scene = build_closed_room()
    noisy = capture_frame(scene, CaptureOptions(samples=2, denoiser="none"))
    denoised = capture_frame(scene, CaptureOptions(samples=2, denoiser="accurate"))
    if "no denoiser" in " ".join(denoised.notes):
        pytest.skip("this Blender has no denoiser")
    truth = capture_frame(scene, CaptureOptions(samples=128, denoiser="none"))
    for name in ("direct", "source", "glossy_source"):
        right, *found = (getattr(of.gbuffer, name) for of in (truth, noisy, denoised))
        noise, left = (np.mean((image - right) ** 2) for image in found)
        assert left < DENOISED_LIGHT * noise, name
        assert abs(found[1].mean() / right.mean() - 1.0) < DENOISED_LIGHT_MEAN, name
    assert np.array_equal(noisy.gbuffer.normal, denoised.gbuffer.normal)


def test_a_blender_without_denoiser_says_so(steps, monkeypatch):
    monkeypatch.setattr(render_settings.compat, "has_denoiser", lambda scene: False)
    noisy = capture_frame(steps, ONE_SAMPLE)
    frame = capture_frame(steps, CaptureOptions(samples=1, denoiser="accurate"))
    assert np.array_equal(frame.gbuffer.direct, noisy.gbuffer.direct)
    assert any("no denoiser" in note for note in frame.notes)


# --- What is captured -------------------------------------------------------------------------------------


def test_frame_option_captures_that_frame(steps):
    steps.camera.keyframe_insert("location", frame=1)
    steps.camera.location.z += 2.0
    steps.camera.keyframe_insert("location", frame=11)
    steps.frame_set(1)
    frame = capture_frame(steps, CaptureOptions(samples=1, denoiser="none", frame=11))
    assert math.isclose(frame.camera.world_from_view[2, 3], 5.0, rel_tol=CAPTURED_GEOMETRY)
    assert steps.frame_current == 1
    assert math.isclose(steps.camera.location.z, 3.0, rel_tol=CAPTURED_GEOMETRY)


def test_camera_of_a_marker_is_used_on_its_frame_alone(steps):
    first = steps.camera
    second = add_camera(steps, (0.0, 0.0, 9.0), (0.0, 0.1, 0.0), lens=30.0)
    steps.camera = first
    for number, camera in ((1, first), (5, second)):
        steps.timeline_markers.new("Cut", frame=number).camera = camera
    frame = capture_frame(steps, CaptureOptions(samples=1, denoiser="none", frame=5))
    assert frame.camera.world_from_view[2, 3] == 9.0
    assert steps.camera == first


def test_view_layer_option_captures_that_layer(steps):
    other = steps.view_layers.new("Empty")
    other.layer_collection.exclude = False
    hidden = bpy.data.collections.new("Hidden")
    steps.collection.children.link(hidden)
    for thing in [thing for thing in steps.objects if thing.type == "MESH"]:
        steps.collection.objects.unlink(thing)
        hidden.objects.link(thing)
    other.layer_collection.children["Hidden"].exclude = True
    empty = capture_frame(steps, CaptureOptions(samples=1, denoiser="none", view_layer="Empty"))
    assert empty.gbuffer.is_background.all()
    assert not capture_frame(steps, ONE_SAMPLE).gbuffer.is_background.all()


def test_scene_that_is_not_current_can_be_captured(steps):
    expected = capture_frame(steps, ONE_SAMPLE).gbuffer
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    found = capture_frame(steps, ONE_SAMPLE).gbuffer
    assert np.array_equal(found.depth, expected.depth)
    assert np.array_equal(found.direct, expected.direct)


def test_samples_of_the_view_layer_do_not_count(steps):
    expected = capture_frame(steps, ONE_SAMPLE).gbuffer.direct
    steps.view_layers[0].samples = 3
    assert np.array_equal(capture_frame(steps, ONE_SAMPLE).gbuffer.direct, expected)


def test_progress_tells_each_step_in_order(steps):
    told = []
    capture_frame(steps, ONE_SAMPLE, lambda fraction, text: told.append((fraction, text)))
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)
    assert [text for _, text in told] == ["Geometry", "Direct light", "Captured"]


# --- Refusals ---------------------------------------------------------------------------------------------


def remove_camera(scene):
    scene.camera = None


def use_empty_as_camera(scene):
    scene.camera = bpy.data.objects.new("Empty", None)
    scene.collection.objects.link(scene.camera)


def use_panorama(scene):
    scene.camera.data.type = "PANO"


def use_stereo(scene):
    scene.render.use_multiview = True


def use_no_pixels(scene):
    scene.render.resolution_x = 40
    scene.render.resolution_percentage = 1


def use_empty_border(scene):
    set_cropped_border(scene)
    scene.render.border_max_x = scene.render.border_min_x


def use_too_many_pixels(scene):
    scene.render.resolution_x = 8193


def shear_camera(scene):
    parent = bpy.data.objects.new("Rig", None)
    scene.collection.objects.link(parent)
    parent.scale = (3.0, 1.0, 1.0)
    scene.camera.parent = parent


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (remove_camera, "has no camera"),
        (use_empty_as_camera, "is used as the camera"),
        (use_panorama, "is panoramic"),
        (use_stereo, "stereoscopic"),
        (use_no_pixels, "renders 0 x 0 pixels"),
        (use_empty_border, "renders 0 x 20 pixels"),
        (use_too_many_pixels, "at most 8192"),
        (shear_camera, "is sheared"),
    ],
)
def test_what_cannot_be_captured_is_refused_in_one_line(steps, change, message):
    change(steps)
    with pytest.raises(SSGIError, match=message) as refusal:
        capture_frame(steps, ONE_SAMPLE)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (CaptureOptions(resolution=(0, 9)), "has no pixels"),
        (CaptureOptions(resolution=(3, 65536)), "3 x 65536 pixels are more"),
        (CaptureOptions(view_layer="Nope"), "no view layer 'Nope': choose one of 'ViewLayer'"),
        (CaptureOptions(engine="workbench"), "cannot be captured"),
    ],
)
def test_options_that_mean_nothing_are_refused(steps, options, message):
    with pytest.raises(SSGIError, match=message):
        capture_frame(steps, options)


def test_missing_cycles_is_refused(steps):
    addon_utils.disable("cycles")
    try:
        with pytest.raises(SSGIError, match="Cycles render engine is not available"):
            capture_frame(steps, ONE_SAMPLE)
    finally:
        addon_utils.enable("cycles")


def test_blenders_own_render_error_becomes_one_line(steps, monkeypatch):
    def fail(**_):
        raise RuntimeError("Error: out of luck\nmore\n")

    ops = SimpleNamespace(render=SimpleNamespace(render=fail))
    monkeypatch.setattr(cycles_passes, "bpy", SimpleNamespace(ops=ops, types=bpy.types))
    with pytest.raises(SSGIError, match=r"could not render scene 'Scene': out of luck$"):
        capture_frame(steps, ONE_SAMPLE)
