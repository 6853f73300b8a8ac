# SPDX-License-Identifier: GPL-3.0-or-later
"""The job leaves the file as it was, writes whole results or none, and copes with any frame."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.blender import one_frame
from ssgi_addon.blender.job import render_frame, render_frames
from ssgi_addon.camera_file import camera_from_json
from ssgi_addon.earlier_results import was_skipped
from ssgi_addon.errors import OutputError, SSGIError
from ssgi_addon.exr import read_layers
from ssgi_addon.files import read_json
from ssgi_addon.manifest import manifest_path, read_manifest
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.small_jobs import small_job
from tests.blender.test_roughness import add_tile, look_down, material_of
from tests.scenes import build_mirror_floor, build_moving_room
from tests.tolerances import FLOAT32_DISTANCE


@pytest.fixture
def room(empty_file):
    scene = build_moving_room()
    scene.frame_set(2)
    return scene


@pytest.fixture
def options(tmp_path):
    return small_job(
        tmp_path / "results",
        denoiser="fast",
        own_geometry=True,
        budget=1000.0,
        mirrors_only=False,
        surround=8,
        back_faces=False,
    )


def read_report(options):
    """The report as strict JSON: NaN and infinity, which Python reads, are none."""

    def refuse(constant):
        pytest.fail(f"the report holds {constant}")

    return json.loads((options.output / "report.json").read_text(), parse_constant=refuse)


# --- The file is as before --------------------------------------------------------------------------------


def test_scene_is_as_before_the_job(room, options):
    before = fingerprint()
    render_frames(room, replace(options, frames=(3, 1), compare=True, save_passes=True))
    assert changes(before, fingerprint()) == {}


def test_scene_is_as_before_when_any_step_is_interrupted(room, options):
    """A progress callback that raises is how a user stops the job."""
    options = replace(options, frames=(3,), compare=True, overwrite=True)
    steps = []
    render_frames(room, options, lambda fraction, text: steps.append(text))
    assert {"Geometry", "Direct light", "Surround", "Writing", "Reference"} <= set(steps)
    before = fingerprint()
    for step in dict.fromkeys(steps):

        def interrupt(fraction, text, step=step):
            if text == step:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            render_frames(room, options, interrupt)
        assert changes(before, fingerprint()) == {}, step


@pytest.mark.parametrize("step", ["compute_picture", "to_display", "write_picture", "compare_with_cycles"])
def test_scene_is_as_before_when_a_step_fails(room, options, monkeypatch, step):
    def fail(*arguments, **named):
        raise ZeroDivisionError

    monkeypatch.setattr(one_frame, step, fail)
    before = fingerprint()
    with pytest.raises(ZeroDivisionError):
        render_frames(room, replace(options, frames=(3,), compare=True))
    assert changes(before, fingerprint()) == {}
    assert not (options.output / "report.json").exists()


def test_materials_of_every_origin_are_as_before(empty_file, options, tmp_path):
    """Linked from a library, made of node groups, without nodes, and none at all."""
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {material_of("nested groups")})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, linked):
        linked.materials = ["nested groups"]
    without_nodes = bpy.data.materials.new("without nodes")
    if bpy.app.version < (5, 0, 0):
        without_nodes.use_nodes = False
    materials = [linked.materials[0], material_of("group used twice"), without_nodes, None]
    for index, material in enumerate(materials):
        add_tile(bpy.context.scene, index, material)
    look_down(bpy.context.scene, len(materials))
    before = fingerprint()
    assert render_frame(bpy.context.scene, options).exr_path.is_file()
    assert changes(before, fingerprint()) == {}


# --- What is written --------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_there", [False, True])
def test_a_failure_before_the_picture_writes_its_reason_at_most(room, options, monkeypatch, is_there):
    def fail(*arguments, **named):
        raise SSGIError("not enough memory")

    if is_there:
        options.output.mkdir()
    monkeypatch.setattr(one_frame, "compute_picture", fail)
    with pytest.raises(SSGIError):
        render_frames(room, replace(options, save_passes=True))
    assert options.output.exists() == is_there
    if is_there:
        written = sorted(path.name for path in options.output.rglob("*") if path.is_file())
        assert written == ["report.json", "untitled_0002.json"]
        assert read_manifest(manifest_path(options.output, "untitled", 2))["failure"] == "not enough memory"


def test_frame_that_fails_does_not_stop_the_others(room, options, monkeypatch):
    def fail_once(*arguments, capture=one_frame.capture_frame):
        if arguments[1].frame == 2:
            raise SSGIError("no camera")
        return capture(*arguments)

    monkeypatch.setattr(one_frame, "capture_frame", fail_once)
    with pytest.raises(SSGIError, match="^frames 2 of 3 failed: no camera$"):
        render_frames(room, replace(options, frames=(1, 2, 3)))
    report = read_report(options)
    assert [record["frame"] for record in report["frames"]] == [1, 3]
    assert report["failures"] == [{"frame": 2, "why": "no camera"}]
    assert read_manifest(manifest_path(options.output, "untitled", 2))["failure"] == "no camera"
    monkeypatch.undo()
    report, results = render_frames(room, replace(options, frames=(1, 2, 3), resume=True))
    assert [result.record["frame"] for result in results] == [2]
    assert "failures" not in report
    assert read_manifest(manifest_path(options.output, "untitled", 2))["failure"] is None


def test_results_that_cannot_be_written_stop_the_job(room, options, monkeypatch):
    tried = []

    def fail(picture, path, recipe):
        tried.append(path.stem)
        raise OutputError("no room")

    monkeypatch.setattr(one_frame, "write_picture", fail)
    with pytest.raises(OutputError, match="^no room$"):
        render_frames(room, replace(options, frames=(1, 3)))
    assert tried == ["untitled_0001"]
    assert not manifest_path(options.output, "untitled", 1).exists()


def test_manifest_tells_what_a_frame_was_made_with_and_samples_it(room, options):
    render_frames(room, replace(options, frames=(2,), resolution=(500, 20), save_passes=True))
    path = manifest_path(options.output, "untitled", 2)
    manifest = read_manifest(path)
    (record,) = read_report(options)["frames"]
    assert manifest["record"] == record
    assert manifest["settings_hash"] == record["settings_hash"]
    assert manifest["settings"]["samples"] == options.samples
    assert manifest["process"]["started"] < manifest["finished"]
    samples = read_layers(path.with_suffix(".exr"))
    whole = read_layers(options.output / "untitled_0002.exr")
    # Every third pixel, the middle one of each block
    np.testing.assert_array_equal(samples["diffuse"], whole["diffuse"][1::3, 1::3])
    camera = camera_from_json(manifest["camera"], path)
    assert (camera.height, camera.width) == samples["depth"].shape
    passes = options.output / "passes" / "untitled_0002.json"
    full = camera_from_json(read_json(passes)["camera"], passes)
    for place in ((0, 0), (5, 80)):
        toward = camera.pixel_to_view(place[1] + 0.5, place[0] + 0.5, 1.0)
        expected = full.pixel_to_view(3 * place[1] + 1.5, 3 * place[0] + 1.5, 1.0)
        np.testing.assert_allclose(toward, expected, rtol=FLOAT32_DISTANCE)


def test_later_frame_that_is_there_already_stops_before_the_first(room, options):
    render_frames(room, replace(options, frames=(3,)))
    with pytest.raises(SSGIError, match=r"untitled_0003\.exr is there already: switch Overwrite on"):
        render_frames(room, replace(options, frames=(1, 3)))
    assert not (options.output / "untitled_0001.exr").exists()


def test_stopped_run_goes_on_where_it_stopped(room, options, monkeypatch):
    render_frames(room, replace(options, frames=(1, 3)))
    first = read_report(options)["frames"]
    picture = options.output / "untitled_0001.exr"
    untouched = picture.stat().st_mtime_ns
    (options.output / "untitled_0003.exr").unlink()

    shown = []
    again = replace(options, frames=(1, 2, 3), resume=True)
    _, results = render_frames(room, again, lambda fraction, text: shown.append(fraction))
    assert [result.record["frame"] for result in results] == [2, 3]
    assert picture.stat().st_mtime_ns == untouched
    records = read_report(options)["frames"]
    assert [record["frame"] for record in records] == [1, 2, 3]
    assert [was_skipped(record) for record in records] == [True, False, False]
    assert records[0]["seconds"] == first[0]["seconds"]
    assert shown == sorted(shown)
    assert shown[-1] == 1.0

    _, results = render_frames(room, again)
    assert results == []
    assert all(was_skipped(record) for record in read_report(options)["frames"])


def test_later_records_outlive_a_second_stop(room, options, monkeypatch):
    render_frames(room, replace(options, frames=(3,)))

    def fail(picture, path, recipe):
        raise OutputError("no room")

    monkeypatch.setattr(one_frame, "write_picture", fail)
    with pytest.raises(SSGIError, match="no room"):
        render_frames(room, replace(options, frames=(1, 3), resume=True))
    assert [record["frame"] for record in read_report(options)["frames"]] == [3]


def test_surround_answers_what_the_frame_cannot(room, options):
    alone = render_frame(room, replace(options, surround=0)).record
    surrounded = render_frame(room, replace(options, surround=16, overwrite=True)).record
    assert "surround" not in alone["seconds"]
    assert surrounded["seconds"]["surround"] > 0.0
    assert surrounded["known"] > alone["known"] + 0.1


def test_fill_costs_seconds_and_does_not_count_as_known(room, options):
    alone = render_frame(room, options).record
    settings = replace(options.settings, fill_mode="level")
    filled = render_frame(room, replace(options, settings=settings, fill=1, overwrite=True)).record
    assert "fill" not in alone["seconds"]
    assert filled["seconds"]["fill"] > 0.0
    assert filled["known"] == alone["known"]


def test_report_tells_the_options_of_the_run(room, options):
    render_frames(room, replace(options, fill=2))
    told = read_report(options)["settings"]
    assert (told["samples"], told["surround"], told["fill"], told["engine"]) == (1, 8, 2, "cycles")
    assert told["diffuse"]["rays"] == options.settings.diffuse.rays


# --- Frames of all kinds ----------------------------------------------------------------------------------


def remove(scene, kind):
    for thing in [thing for thing in scene.objects if thing.type == kind]:
        bpy.data.objects.remove(thing)


@pytest.mark.parametrize("removed", [(), ("LIGHT",), ("LIGHT", "MESH")])
def test_dark_and_empty_frames_are_pictures_too(room, options, removed):
    for kind in removed:
        remove(room, kind)
    # A denoiser finds traces of light in the dark.
    result = render_frame(room, replace(options, compare=True, save_passes=True, denoiser="none"))
    assert result.sheet_path.is_file()
    assert read_layers(result.exr_path)["combined"].any() == (not removed)
    assert read_report(options)["frames"][0]["metrics"].keys() >= {"combined", "direct_only"}


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 2), (33, 19)])
def test_frames_of_odd_size_have_results(empty_file, options, size):
    """A mirror below the sky: background also where the optical axis meets the frame."""
    scene = build_mirror_floor()
    result = render_frame(scene, replace(options, resolution=size, compare=True))
    for name, layer in read_layers(result.exr_path).items():
        assert layer.shape[:2] == size[::-1], name
        assert np.isfinite(layer).all(), name
        assert layer.min() >= 0.0, name
    read_report(options)
