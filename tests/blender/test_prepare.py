# SPDX-License-Identifier: GPL-3.0-or-later
"""What a shot shares is captured once, and its frames come out the same whoever renders which of them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.blender.build import add_box, new_material
from ssgi_addon.blender.job import render_frames, run_job
from ssgi_addon.blender.prepare import key_frames, prepare_shot
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers
from ssgi_addon.prepared import FILE, Shot
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.small_jobs import small_job
from tests.scenes import build_closed_room

FRAMES = tuple(range(1, 6))


@pytest.fixture
def blend(empty_file, tmp_path):
    """A saved room with a box, a lamp and a camera that moves."""
    scene = build_closed_room()
    material = new_material("Box", (0.5, 0.5, 0.5))
    add_box(scene, "Small Box", material, (0.2, 0.2, 0.2), (0.5, 0.5, 0.5))
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x += 0.05
    scene.camera.keyframe_insert("location", frame=5)
    scene.frame_start, scene.frame_end = 1, 5
    path = tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


@pytest.fixture
def options(tmp_path):
    return small_job(
        tmp_path / "results",
        frames=FRAMES,
        fill=4,
        light_views=1,
        budget=1000.0,
        mirrors_only=False,
        resume=True,
    )


def prepare(blend, options, **changes):
    return prepare_shot(blend, replace(options, output=options.output.parent / "shot", **changes), 3)


def pictures(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.exr"))}


def test_key_frames_are_spread_over_the_shot():
    assert key_frames(range(1, 25), 4) == [1, 9, 16, 24]
    assert key_frames((3, 7), 5) == [3, 7]
    assert key_frames((3,), 5) == [3]
    assert key_frames(range(10), 1) == [0]


def test_frames_are_the_same_whoever_renders_them(blend, options):
    """One process, two that take turns, and in another order: bit by bit."""
    shot = prepare(blend, options)
    options = replace(options, shot=shot.path.parent)
    run_job(blend, options)
    apart = replace(options, output=options.output.with_name("apart"))
    for frames in ((4, 5), (2,), (1, 3)):
        run_job(blend, replace(apart, frames=frames))
    assert pictures(apart.output) == pictures(options.output)
    assert len(pictures(apart.output)) == len(FRAMES)


def test_views_of_lamps_are_captured_once(blend, options):
    shot = prepare(blend, options)
    views = list(shot.path.parent.glob("view_*.exr"))
    assert len(views) == 1
    assert [shot.key(frame).view_names for frame in shot.worlds] == [("lights",)] * 3
    report = run_job(blend, replace(options, shot=shot.path.parent))
    for frame in report["frames"]:
        assert "lights" not in frame["seconds"]
        assert any(entry["what"] == "lights" and "kept" in entry["why"] for entry in frame["skipped"])


def test_fills_of_the_shot_leave_less_noise(blend, options):
    """The frames' own fills are of one sample a pixel: the mean of four has about half of its noise."""
    options = replace(options, resolution=(96, 54), light_views=0)
    run_job(blend, options)
    shot = prepare(blend, options)
    together = replace(options, output=options.output.with_name("together"), shot=shot.path.parent)
    run_job(blend, together)
    many = replace(options, output=options.output.with_name("many"), fill=512, frames=(2,))
    run_job(blend, many)
    truth, alone, merged = (
        read_layers(job.output / "room_0002.exr")["diffuse"] for job in (many, options, together)
    )
    assert np.abs(merged - truth).mean() < 0.8 * np.abs(alone - truth).mean()


def test_world_that_moves_is_rendered_frame_by_frame(blend, options):
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    lamp = next(iter(bpy.data.lights))
    lamp.keyframe_insert("energy", frame=3)
    lamp.energy *= 3.0
    lamp.keyframe_insert("energy", frame=5)
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    shot = prepare(blend, options)
    report = run_job(blend, replace(options, shot=shot.path.parent))
    alone = [any("rendered alone" in note for note in frame["notes"]) for frame in report["frames"]]
    # Key frames are 1, 3, 5, and nothing moves before 3
    assert alone == [False, False, False, True, False]


def test_scene_is_as_before(blend, options):
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    before = fingerprint()
    shot = prepare_shot(None, replace(options, output=options.output.parent / "shot"), 2)
    render_frames(bpy.context.scene, replace(options, shot=None))
    assert changes(before, fingerprint()) == {}
    assert list(shot.worlds) == [1, 5]


def test_prepared_shot_is_left_as_it_is_or_refused(blend, options):
    shot = prepare(blend, options)
    files = {path: path.stat().st_mtime_ns for path in shot.path.parent.iterdir()}
    assert prepare(blend, options).hash == shot.hash
    # Frames that are rendered already were rendered with it: more of them are no reason for another
    assert prepare(blend, options, frames=(1, 2, 3)).hash == shot.hash
    assert {path: path.stat().st_mtime_ns for path in shot.path.parent.iterdir()} == files
    with pytest.raises(SSGIError, match="samples 1 instead of 2.*--overwrite"):
        prepare(blend, options, samples=2)
    again = prepare(blend, options, samples=2, overwrite=True)
    assert again.hash != shot.hash
    named = json.loads(again.path.read_text())
    named = {item["passes"] for key in named["keys"] for item in (key["fill"], *key["views"])}
    assert {path.name for path in again.path.parent.iterdir()} == {FILE, *named}


def test_frames_of_other_settings_refuse_the_shot(blend, options, tmp_path):
    with pytest.raises(SSGIError, match="no prepared shot in .*nowhere"):
        run_job(blend, replace(options, shot=tmp_path / "nowhere"))
    shot = prepare(blend, options)
    with pytest.raises(SSGIError, match="was prepared with samples 1 instead of 3"):
        run_job(blend, replace(options, shot=shot.path.parent, samples=3))
    assert not options.output.exists()


def test_frames_with_a_shot_and_without_are_not_mixed(blend, options):
    run_job(blend, replace(options, frames=(1,)))
    shot = prepare(blend, options)
    with pytest.raises(SSGIError, match=f"shot None instead of {shot.hash}"):
        run_job(blend, replace(options, shot=shot.path.parent))


@pytest.mark.parametrize("damage", ["", "[]", '{"format": "ssgi-shot", "version": 1}', '{"version": 2}'])
def test_damaged_shot_is_one_clear_line(tmp_path, damage):
    (tmp_path / FILE).write_text(damage)
    with pytest.raises(SSGIError, match=r"shot\.json"):
        Shot(tmp_path)


def test_lost_capture_is_one_clear_line(blend, options):
    shot = prepare(blend, options)
    next(shot.path.parent.glob("fill_*.exr")).unlink()
    with pytest.raises(SSGIError, match=r"failed: .*fill_\w+\.exr"):
        run_job(blend, replace(options, shot=shot.path.parent))
