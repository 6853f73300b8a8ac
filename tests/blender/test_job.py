# SPDX-License-Identifier: GPL-3.0-or-later
"""The job leaves the file as it was, writes whole results or none, and copes with any frame."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.blender import job
from ssgi_addon.blender.job import render_frame, render_frames
from ssgi_addon.earlier_results import was_skipped
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.small_jobs import small_job
from tests.blender.test_roughness import add_tile, look_down, material_of
from tests.scenes import build_mirror_floor, build_moving_room


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


@pytest.mark.parametrize(
    "step", ["compute_picture", "write_display_png", "write_picture", "compare_with_cycles"]
)
def test_scene_is_as_before_when_a_step_fails(room, options, monkeypatch, step):
    def fail(*arguments, **named):
        raise ZeroDivisionError

    monkeypatch.setattr(job, step, fail)
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


def test_a_failure_before_the_picture_writes_nothing(room, options, monkeypatch):
    def fail(*arguments, **named):
        raise SSGIError("not enough memory")

    monkeypatch.setattr(job, "compute_picture", fail)
    with pytest.raises(SSGIError):
        render_frames(room, replace(options, save_passes=True))
    assert not options.output.exists()


def test_frames_done_before_a_failure_are_in_the_report(room, options, monkeypatch):
    def fail_later(picture, path, recipe, write=job.write_picture):
        if path.stem.endswith("3"):
            raise SSGIError("no room")
        write(picture, path, recipe)

    monkeypatch.setattr(job, "write_picture", fail_later)
    with pytest.raises(SSGIError):
        render_frames(room, replace(options, frames=(1, 3)))
    assert [record["frame"] for record in read_report(options)["frames"]] == [1]
    assert (options.output / "untitled_0001.exr").exists()
    assert not (options.output / "untitled_0003.exr").exists()


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
        raise SSGIError("no room")

    monkeypatch.setattr(job, "write_picture", fail)
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
