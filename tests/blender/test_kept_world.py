# SPDX-License-Identifier: GPL-3.0-or-later
"""What belongs to the world is kept from frame to frame, until anything but the camera moves."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.build import add_box, new_material
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.job import render_frames
from ssgi_addon.blender.kept_world import KeptWorld, world_state
from ssgi_addon.core import Settings
from ssgi_addon.job_options import JobOptions
from tests.blender.fingerprint import changes, fingerprint
from tests.scenes import build_closed_room

OPTIONS = CaptureOptions(
    samples=1,
    denoiser="none",
    resolution=(32, 18),
    surround=8,
    stations=2,
    view_size=8,
    view_samples=1,
    fill=2,
)


@pytest.fixture
def room(empty_file):
    """A room with a box, a lamp and a camera that moves a little from frame to frame."""
    scene = build_closed_room()
    material = new_material("Box", (0.5, 0.5, 0.5))
    add_box(scene, "Small Box", material, (0.2, 0.2, 0.2), (0.5, 0.5, 0.5))
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x += 0.02
    scene.camera.keyframe_insert("location", frame=3)
    scene.frame_set(1)
    return scene


def state_of(scene) -> bytes:
    return world_state(scene, scene.view_layers[0])


def test_a_camera_that_moves_changes_no_world(room):
    before = state_of(room)
    room.frame_set(3)
    assert state_of(room) == before


def some_material():
    return bpy.data.materials["Box"].node_tree.nodes["Principled BSDF"].inputs


MOVES = {
    "object": lambda: setattr(bpy.data.objects["Small Box"].location, "x", 0.4),
    "mesh": lambda: setattr(bpy.data.objects["Small Box"].data.vertices[0].co, "x", 0.4),
    "colour": lambda: setattr(some_material()["Base Color"], "default_value", (1.0, 0.0, 0.0, 1.0)),
    "number": lambda: setattr(some_material()["Roughness"], "default_value", 0.123),
    "hidden": lambda: setattr(bpy.data.objects["Small Box"], "hide_viewport", True),
    "lamp": lambda: setattr(next(iter(bpy.data.lights)), "energy", 3.0),
    "material": lambda: bpy.data.objects["Small Box"].data.materials.clear(),
}


@pytest.mark.parametrize("name", MOVES)
def test_anything_else_that_moves_makes_another_world(room, name):
    before = state_of(room)
    MOVES[name]()
    bpy.data.objects["Small Box"].data.update()
    assert state_of(room) != before


def test_animated_objects_and_image_sequences_make_another_world_at_each_frame(room):
    box = bpy.data.objects["Small Box"]
    box.keyframe_insert("location", frame=1)
    box.location.x += 0.5
    box.keyframe_insert("location", frame=3)
    room.frame_set(1)
    first = state_of(room)
    room.frame_set(2)
    assert state_of(room) != first
    box.animation_data_clear()
    image = bpy.data.images.new("Film", 4, 4)
    image.source, image.use_fake_user = "SEQUENCE", True
    states = []
    for frame in (1, 2):
        room.frame_set(frame)
        states.append(state_of(room))
    assert states[0] != states[1]


def test_views_are_kept_and_fills_averaged_until_something_moves(room):
    kept = KeptWorld()
    first, second = (capture_frame(room, replace(OPTIONS, frame=frame), None, kept) for frame in (1, 3))
    assert "surround" in first.seconds
    assert "surround" not in second.seconds
    assert ("surround, stations", "kept from frame 1") in second.skipped or (
        "surround",
        "kept from frame 1",
    ) in second.skipped
    for (gbuffer, camera), (other, other_camera) in zip(first.views, second.views, strict=True):
        np.testing.assert_array_equal(gbuffer.depth, other.depth)
        np.testing.assert_array_equal(camera.world_from_view, other_camera.world_from_view)
    assert kept.fills == 2
    assert second.fill.samples.max() == 2 * OPTIONS.fill
    np.testing.assert_array_equal(second.fill.camera.world_from_view, second.camera.world_from_view)
    bpy.data.objects["Small Box"].location.x += 0.3
    third = capture_frame(room, replace(OPTIONS, frame=3), None, kept)
    assert "surround" in third.seconds
    assert kept.fills == 1
    assert third.fill.samples.max() == OPTIONS.fill


def test_frame_that_sees_elsewhere_takes_views_of_its_own(room):
    kept = KeptWorld()
    capture_frame(room, replace(OPTIONS, frame=1), None, kept)
    # From within the box nothing that was seen before is of use
    room.camera.animation_data_clear()
    room.camera.location = bpy.data.objects["Small Box"].location
    frame = capture_frame(room, replace(OPTIONS, frame=1), None, kept)
    assert "surround" in frame.seconds


def test_job_keeps_the_world_only_where_it_may(room, tmp_path):
    pytest.importorskip("OpenEXR")
    before = fingerprint()
    for keeps in (True, False):
        options = JobOptions(
            output=tmp_path / str(keeps), settings=Settings.preset("draft"), resolution=(32, 18), samples=1,
            surround=8, stations=0, back_faces=False, mirrors_only=False, fill=2, budget=1000.0,
            frames=(1, 3), keep_world=keeps,
        )  # fmt: skip
        render_frames(room, options)
        report = json.loads((options.output / "report.json").read_text())
        second = report["frames"][1]
        assert ("surround" in second["seconds"]) is not keeps
        assert any("kept from frame 1" in entry["why"] for entry in second["skipped"]) is keeps
        assert set(report["frames"][0]["gains"]) == {"surround"}
    assert changes(before, fingerprint()) == {}
