# SPDX-License-Identifier: GPL-3.0-or-later
"""The surround: six ordinary views from the camera's place that together see every direction."""

from __future__ import annotations

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Vector

from ssgi_addon.blender import compat, roughness, views
from ssgi_addon.blender.build import add_ball, add_box, add_camera, new_material, new_world, node_tree
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.restore import Restorer
from ssgi_addon.core.stations import CUBE_FACES
from ssgi_addon.errors import SSGIError
from tests.blender.test_capture import (
    set_cropped_border,
    set_percentage,
    set_pixel_aspect,
    set_shift,
    set_vertical_fit,
)
from tests.scenes import RED, WHITE, build_closed_room, build_emissive_room
from tests.tolerances import (
    CAPTURED_GEOMETRY,
    MEAN_OF_NOISY_PIXELS,
    ROUGHNESS_AOV,
    ROUGHNESS_DENOISING,
    SURROUND_DEPTH,
    UNIT_NORMAL,
)

SIZE = 12
OPTIONS = CaptureOptions(samples=1, denoiser="none", surround=SIZE, view_samples=1)


@pytest.fixture
def room(empty_file):
    """A closed room with things on all sides of a camera that looks askew."""
    scene = build_closed_room()
    clay = new_material("Clay", WHITE)
    add_ball(scene, "Ball", clay, (-0.9, -1.6, 0.8), 0.4)
    add_box(scene, "Shelf", clay, (0.4, -2.4, 1.9), (1.9, -1.2, 2.1))
    scene.camera.location = (0.2, -1.0, 1.4)
    scene.camera.rotation_euler = (1.3, 0.2, 0.7)
    scene.render.resolution_x, scene.render.resolution_y = 16, 9
    return scene


def pixel_centers_ws(camera):
    """World-space direction through each pixel's centre ``(H, W, 3)`` that ends at depth 1."""
    y_px, x_px = np.mgrid[: camera.height, : camera.width] + 0.5
    points_vs = camera.pixel_to_view(x_px, y_px, np.ones_like(x_px))
    return points_vs @ camera.world_from_view[:3, :3].T


# --- What the faces see -----------------------------------------------------------------------------------


def test_faces_hold_what_rays_from_their_place_hit(room):
    frame = capture_frame(room, OPTIONS)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert len(frame.views) == len(CUBE_FACES)
    for gbuffer, camera in frame.views:
        directions = pixel_centers_ws(camera)
        depth, normal = np.zeros(gbuffer.shape), np.zeros((*gbuffer.shape, 3))
        for pixel in np.ndindex(gbuffer.shape):
            origin, direction = Vector(camera.world_from_view[:3, 3]), Vector(directions[pixel])
            is_hit, place, normal_ws, *_ = room.ray_cast(depsgraph, origin, direction)
            assert is_hit
            depth[pixel] = (place - origin).length / direction.length
            normal[pixel] = camera.world_from_view[:3, :3].T @ normal_ws
        assert np.allclose(gbuffer.depth, depth, rtol=SURROUND_DEPTH)
        is_flat = np.abs(normal - gbuffer.normal).max(axis=-1) < UNIT_NORMAL
        assert is_flat.mean() > 0.8  # the ball is shaded smoothly


def test_each_direction_lies_in_one_face(room, rng):
    views = capture_frame(room, OPTIONS).views
    directions = rng.normal(size=(500, 3))
    seen = np.zeros(500, dtype=int)
    for _, camera in views:
        x_px, y_px, depth = camera.view_to_pixel(directions @ camera.world_from_view[:3, :3])
        seen += (depth > 0.0) & (np.abs(x_px - SIZE / 2) < SIZE / 2) & (np.abs(y_px - SIZE / 2) < SIZE / 2)
    assert (seen == 1).all()


def test_front_face_is_a_frame_of_ninety_degrees(room):
    room.camera.data.lens = 18.0
    frame = capture_frame(
        room, CaptureOptions(samples=16, denoiser="none", resolution=(32, 32), surround=32, view_samples=16)
    )
    front = frame.views[0][0]
    assert np.allclose(front.depth, frame.gbuffer.depth, rtol=SURROUND_DEPTH)
    is_same = np.abs(front.normal - frame.gbuffer.normal).max(axis=-1) < UNIT_NORMAL
    assert is_same.mean() > 0.95  # one sample against the mean of sixteen
    for name in ("albedo", "specular", "direct", "source", "glossy_source"):
        found, expected = getattr(front, name).mean(), getattr(frame.gbuffer, name).mean()
        assert math.isclose(found, expected, rel_tol=MEAN_OF_NOISY_PIXELS), name


def test_faces_hand_on_no_emission(empty_file):
    """The panel above the camera shines in the up face; as a source it is dark: Cycles counted its light."""
    scene = build_emissive_room()
    scene.camera.location = (0.0, 0.9, 1.5)
    up = capture_frame(scene, OPTIONS).views[[forward for forward, _ in CUBE_FACES].index((0, 1, 0))][0]
    is_panel = up.direct.min(axis=-1) > 7.0  # 12 x (1, 0.85, 0.6)
    assert is_panel.any()
    assert up.glossy_source[is_panel].max() < 0.1 * up.direct[is_panel].min()


@pytest.mark.parametrize("source", ["aov", "native"])
def test_faces_have_the_roughness_of_their_surfaces(empty_file, monkeypatch, source):
    tolerance = ROUGHNESS_DENOISING
    if source == "aov":
        monkeypatch.setattr(views, "borrow_roughness", roughness.borrow_aov_roughness)
        tolerance = ROUGHNESS_AOV
    elif not compat.has_roughness_pass(empty_file.view_layers[0]):
        pytest.skip("this Blender has no roughness among its denoising passes")
    glazed = new_material("Glazed", RED, roughness=0.3)
    add_box(empty_file, "Inside", glazed, (-2, -2, -2), (2, 2, 2))
    add_camera(empty_file, (0.1, 0.2, 0.3), (0.0, 1.0, 0.5), lens=30.0)
    empty_file.render.resolution_x, empty_file.render.resolution_y = 8, 8
    for gbuffer, _ in capture_frame(empty_file, OPTIONS).views:
        assert np.abs(gbuffer.roughness - 0.3).max() < tolerance


def test_fog_does_not_hide_the_surfaces_around(room):
    clear = capture_frame(room, OPTIONS).views
    room.world = new_world("Fog", (1, 1, 1), 1.0)
    nodes = node_tree(room.world).nodes
    scatter = nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 1.0
    node_tree(room.world).links.new(nodes["World Output"].inputs["Volume"], scatter.outputs[0])
    for (found, _), (expected, _) in zip(capture_frame(room, OPTIONS).views, clear, strict=True):
        assert np.allclose(found.depth, expected.depth, rtol=CAPTURED_GEOMETRY)


# --- Where the faces stand --------------------------------------------------------------------------------


def assert_surrounds(views, world_from_view):
    """Faces look along both ways of each axis of a pose, from its place, with a right angle's view."""
    assert len(views) == len(CUBE_FACES)
    for (_, camera), (forward, up) in zip(views, CUBE_FACES, strict=True):
        rotation = world_from_view[:3, :3]
        assert np.allclose(camera.world_from_view[:3, 3], world_from_view[:3, 3], atol=CAPTURED_GEOMETRY)
        assert np.allclose(-camera.world_from_view[:3, 2], rotation @ forward, atol=UNIT_NORMAL)
        assert np.allclose(camera.world_from_view[:3, 1], rotation @ up, atol=UNIT_NORMAL)
        assert math.isclose(np.linalg.det(camera.world_from_view), 1.0, rel_tol=UNIT_NORMAL)
        assert not camera.is_orthographic
        assert (camera.width, camera.height) == (SIZE, SIZE)
        intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
        assert np.allclose(intrinsics, SIZE / 2, rtol=CAPTURED_GEOMETRY)


def test_faces_surround_the_camera(room):
    frame = capture_frame(room, OPTIONS)
    assert_surrounds(frame.views, frame.camera.world_from_view)


def test_faces_follow_a_camera_on_a_rig_to_the_captured_frame(room):
    """Keyframes on a scaled parent, a constraint on the camera, another camera at the marker before."""
    rig = bpy.data.objects.new("Rig", None)
    room.collection.objects.link(rig)
    rig.scale = (0.5, 0.5, 0.5)
    rig.keyframe_insert("location", frame=1)
    rig.location = (0.3, 0.4, 0.5)
    rig.keyframe_insert("location", frame=11)
    tracked = room.camera
    tracked.parent = rig
    constraint = tracked.constraints.new("TRACK_TO")
    constraint.target = room.objects["Ball"]
    constraint.track_axis, constraint.up_axis = "TRACK_NEGATIVE_Z", "UP_Y"
    other = add_camera(room, (0.0, 0.0, 1.0), (1.0, 0.0, 1.0), lens=50.0)
    room.camera = tracked
    room.frame_set(1)
    for number, camera in ((5, other), (11, tracked)):
        room.timeline_markers.new("Cut", frame=number).camera = camera
    frame = capture_frame(
        room, CaptureOptions(samples=1, denoiser="none", surround=SIZE, view_samples=1, frame=11)
    )
    assert_surrounds(frame.views, frame.camera.world_from_view)
    assert np.allclose(frame.camera.world_from_view[:3, 3], (0.4, -0.1, 1.2), atol=CAPTURED_GEOMETRY)


def test_scene_that_is_not_current_is_surrounded(room):
    expected = capture_frame(room, OPTIONS).views
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    for (found, _), (gbuffer, _) in zip(capture_frame(room, OPTIONS).views, expected, strict=True):
        assert np.array_equal(found.depth, gbuffer.depth)
        assert np.array_equal(found.direct, gbuffer.direct)


def set_blur(scene):
    scene.render.use_motion_blur = True
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 0.5, 0.1
    scene.camera.keyframe_insert("location", frame=scene.frame_current)
    scene.camera.location.x += 1.0
    scene.camera.keyframe_insert("location", frame=scene.frame_current + 1)
    scene.frame_set(scene.frame_current)


def set_tiles(scene):
    scene.cycles.tile_size = 8


@pytest.mark.parametrize(
    "change",
    [
        set_shift,
        set_vertical_fit,
        set_pixel_aspect,
        set_percentage,
        set_cropped_border,
        set_blur,
        set_tiles,
    ],
)
def test_framing_and_lens_of_the_frame_do_not_change_the_faces(room, change):
    expected = capture_frame(room, OPTIONS).views
    change(room)
    found = capture_frame(room, OPTIONS).views
    for (gbuffer, camera), (same, same_camera) in zip(found, expected, strict=True):
        assert np.array_equal(gbuffer.depth, same.depth)
        assert np.array_equal(camera.world_from_view, same_camera.world_from_view)


def test_faces_are_clipped_as_the_frame_is(room):
    room.camera.data.clip_start, room.camera.data.clip_end = 1.0, 1.5
    gbuffers = [gbuffer for gbuffer, _ in capture_frame(room, OPTIONS).views]
    depth = np.concatenate([gbuffer.depth[~gbuffer.is_background] for gbuffer in gbuffers])
    assert depth.size
    assert depth.min() >= 1.0
    assert depth.max() <= 1.5


# --- Orthographic frames ----------------------------------------------------------------------------------


def test_orthographic_frame_lies_in_the_front_face(room):
    room.camera.data.type = "ORTHO"
    room.camera.data.ortho_scale = 1.5
    room.camera.data.shift_x = 0.1
    frame = capture_frame(room, OPTIONS)
    y_px, x_px = np.mgrid[: frame.camera.height, : frame.camera.width] + 0.5
    points_vs = frame.camera.pixel_to_view(x_px, y_px, frame.gbuffer.depth)
    front = frame.views[0][1]
    face_from_view = np.linalg.inv(front.world_from_view) @ frame.camera.world_from_view
    points_face = points_vs @ face_from_view[:3, :3].T + face_from_view[:3, 3]
    x_face, y_face, depth = front.view_to_pixel(points_face)
    assert depth.min() > 0.0
    for value in (x_face, y_face):
        assert value.min() > -CAPTURED_GEOMETRY
        assert value.max() < SIZE + CAPTURED_GEOMETRY
    pose = frame.camera.world_from_view.copy()
    pose[:3, 3] = front.world_from_view[:3, 3]
    assert_surrounds(frame.views, pose)


# --- What is captured -------------------------------------------------------------------------------------


def test_no_surround_is_captured_unless_asked_for(room):
    frame = capture_frame(room, CaptureOptions(samples=1, denoiser="none"))
    assert frame.views == ()
    assert "surround" not in frame.seconds


def test_seconds_of_the_surround_are_told(room):
    assert capture_frame(room, OPTIONS).seconds["surround"] > 0.0


def test_frame_without_surfaces_needs_no_surround(empty_file):
    add_box(empty_file, "Behind", new_material("Clay", WHITE), (-1, -3, -1), (1, -2, 1))
    add_camera(empty_file, (0, 0, 0), (0, 1, 0), lens=50.0)
    empty_file.render.resolution_x, empty_file.render.resolution_y = 8, 8
    assert capture_frame(empty_file, OPTIONS).views == ()


def test_progress_goes_on_through_the_faces(room):
    told = []
    capture_frame(room, OPTIONS, lambda fraction, text: told.append((fraction, text)))
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert [text for _, text in told].count("Surround") == len(CUBE_FACES)


@pytest.mark.parametrize("size", [1, 3])
def test_small_faces_can_be_captured(room, size):
    options = CaptureOptions(samples=1, denoiser="none", surround=size)
    assert all(gbuffer.shape == (size, size) for gbuffer, _ in capture_frame(room, options).views)


@pytest.mark.parametrize(("size", "message"), [(-1, "has no pixels"), (8193, "at most 8192")])
def test_faces_of_impossible_size_are_refused(room, size, message):
    with pytest.raises(SSGIError, match=message):
        capture_frame(room, CaptureOptions(samples=1, denoiser="none", surround=size))


# --- One scene for all renders of a capture ---------------------------------------------------------------


def set_fog(scene):
    tree = node_tree(scene.world)
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 0.3
    tree.links.new(tree.nodes["World Output"].inputs["Volume"], scatter.outputs[0])


@pytest.mark.parametrize("change", [None, set_blur, set_fog])
def test_keeping_cycles_scene_between_renders_changes_no_pixel(room, monkeypatch, change):
    if change is not None:
        change(room)
    kept = capture_frame(room, OPTIONS)
    plain_change = Restorer.change

    def change_all_but_that(self, owner, **values):
        values.pop("use_persistent_data", None)
        plain_change(self, owner, **values)

    monkeypatch.setattr(Restorer, "change", change_all_but_that)
    built_anew = capture_frame(room, OPTIONS)
    pairs = [(kept.gbuffer, built_anew.gbuffer)]
    pairs += [(found, same) for (found, _), (same, _) in zip(kept.views, built_anew.views, strict=True)]
    for found, same in pairs:
        for name in ("depth", "normal", "albedo", "specular", "roughness", "direct", "glossy_source"):
            assert np.array_equal(getattr(found, name), getattr(same, name)), name
