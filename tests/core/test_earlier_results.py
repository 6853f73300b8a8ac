# SPDX-License-Identifier: GPL-3.0-or-later
"""What an earlier run left is refused, replaced or kept, as asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("OpenEXR")

from ssgi_addon.core import Camera, Settings
from ssgi_addon.earlier_results import SKIPPED, check_output, finished_frames, was_skipped
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import write_layers
from ssgi_addon.files import read_json, write_json
from ssgi_addon.job_options import JobOptions
from ssgi_addon.manifest import manifest_path, read_manifest, write_failure, write_manifest
from ssgi_addon.recipe import recipe_hash, recipe_text
from ssgi_addon.render_task import RenderTask, read_task, write_task

STEMS = {1: "room_0001", 2: "room_0002", 3: "room_0003"}
RECIPE = {
    "ssgi": "1.2.3",
    "scene": "Room\n",
    "samples": 4,
    "settings": {"diffuse": {"rays": 2, "far": "inf"}},
}


def write_result(path, recipe=RECIPE):
    told = {} if recipe is None else {"ssgi.made_with": recipe_text(recipe)}
    write_layers(path, {"combined": np.zeros((3, 4, 3), np.float32)}, told)


@pytest.fixture
def options(tmp_path):
    """Frames 1 and 3 are there."""
    camera = Camera.perspective(4, 3, 1.0)
    for frame in (1, 3):
        write_result(tmp_path / f"{STEMS[frame]}.exr")
        record = {
            "frame": frame,
            "seconds": {"total": 2.0},
            "skipped": [{"what": "fill", "why": "0 samples"}],
        }
        write_manifest(tmp_path, "room", record, camera, RECIPE, {"ssgi": "1.2.3"})
    return JobOptions(tmp_path)


def test_earlier_results_are_refused_unless_replaced_or_kept(options):
    with pytest.raises(SSGIError, match=r"room_0001\.exr is there already: switch Overwrite on"):
        check_output(options, STEMS, RECIPE)
    for change in ({"overwrite": True}, {"resume": True}):
        check_output(replace(options, **change), STEMS, RECIPE)


def test_without_resume_or_with_overwrite_nothing_is_kept(options):
    assert finished_frames(options, STEMS, RECIPE) == {}
    assert finished_frames(replace(options, resume=True, overwrite=True), STEMS, RECIPE) == {}


def test_finished_frames_keep_their_entry_and_say_that_they_were_skipped(options):
    kept = finished_frames(replace(options, resume=True), STEMS, RECIPE)
    assert kept.keys() == {1, 3}
    assert all(was_skipped(record) for record in kept.values())
    assert kept[1]["seconds"] == {"total": 2.0}
    assert kept[1]["skipped"][0]["what"] == "fill"
    assert kept[3]["frame"] == 3


def test_frame_that_is_skipped_says_so_once(options):
    path = manifest_path(options.output, "room", 1)
    manifest = read_json(path)
    manifest["record"]["skipped"].append(SKIPPED)
    write_json(path, manifest)
    assert finished_frames(replace(options, resume=True), STEMS, RECIPE)[1]["skipped"].count(SKIPPED) == 1


def test_frame_without_its_comparison_is_not_finished(options):
    (options.output / f"{STEMS[3]}_compare.png").touch()
    assert finished_frames(replace(options, resume=True, compare=True), STEMS, RECIPE).keys() == {3}


def test_frame_without_its_passes_is_not_finished(options):
    (options.output / "passes").mkdir()
    (options.output / "passes" / f"{STEMS[1]}.json").touch()
    wanted = replace(options, resume=True, save_passes=True)
    assert finished_frames(wanted, STEMS, RECIPE).keys() == {1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"samples": 32}, r"room_0001\.exr was rendered with samples 4 instead of 32: give the same"),
        ({"ssgi": "2.0.0"}, "ssgi 1.2.3 instead of 2.0.0"),
        ({"settings": {"diffuse": {"rays": 8, "far": "inf"}}}, "settings.diffuse.rays 2 instead of 8"),
        ({"scene": "Other", "a": 1, "b": 2, "c": 3, "d": 4}, "and 1 more: .*--overwrite"),
    ],
)
def test_resume_refuses_frames_of_other_settings_and_names_them(options, change, message):
    wanted = {**RECIPE, **change}
    with pytest.raises(SSGIError, match=message):
        check_output(replace(options, resume=True), STEMS, wanted)
    check_output(replace(options, overwrite=True), STEMS, wanted)
    assert recipe_hash(wanted) != recipe_hash(RECIPE)


def test_resume_refuses_a_picture_that_does_not_say_how_it_was_made(options):
    write_result(options.output / f"{STEMS[2]}.exr", None)
    with pytest.raises(SSGIError, match="was rendered with no settings"):
        check_output(replace(options, resume=True), STEMS, RECIPE)


def test_picture_that_is_not_whole_is_rendered_again(options):
    for frame, length in ((1, 0), (3, 300)):
        path = options.output / f"{STEMS[frame]}.exr"
        path.write_bytes(path.read_bytes()[:length])
    resumed = replace(options, resume=True)
    check_output(resumed, STEMS, RECIPE)
    assert finished_frames(resumed, STEMS, RECIPE) == {}


def test_name_that_no_disk_takes_is_refused_before_the_work(options):
    with pytest.raises(SSGIError, match="too long for a file"):
        check_output(options, {1: "x" * 250}, RECIPE)
    with pytest.raises(SSGIError, match="too long for a file"):
        check_output(options, {1: "ß" * 121}, RECIPE)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "ssgi-frame", "version": 1}', '{"frames": 1}'])
def test_frame_without_a_whole_manifest_is_rendered_again(options, text):
    manifest_path(options.output, "room", 1).write_text(text)
    resumed = replace(options, resume=True)
    check_output(resumed, STEMS, RECIPE)
    assert finished_frames(resumed, STEMS, RECIPE).keys() == {3}


def test_manifest_of_other_settings_is_none_of_a_picture(options):
    """As where a run that replaces results was killed between the two."""
    camera = Camera.perspective(4, 3, 1.0)
    record = {"frame": 1, "seconds": {}, "skipped": []}
    write_manifest(options.output, "room", record, camera, {**RECIPE, "samples": 5}, {})
    assert finished_frames(replace(options, resume=True), STEMS, RECIPE).keys() == {3}


def test_failure_is_told_but_not_of_a_frame_that_is_finished(options):
    for frame in (1, 2):
        write_failure(options.output, "room", frame, "no camera", RECIPE, {})
    first, second = (read_manifest(manifest_path(options.output, "room", frame)) for frame in (1, 2))
    assert (first["failure"], first["record"]["frame"]) == (None, 1)
    assert (second["failure"], second["record"]) == ("no camera", None)
    assert finished_frames(replace(options, resume=True), STEMS, RECIPE).keys() == {1, 3}


def test_task_reads_back(tmp_path):
    options = JobOptions.preset(
        "final",
        tmp_path / "out",
        settings=replace(Settings.preset("draft"), threads=3),
        resolution=(48, 27),
        frames=(1, 3),
        resume=True,
        engine="eevee",
        shot=tmp_path / "shot",
    )
    for wanted in (options, JobOptions(tmp_path)):
        task = RenderTask(tmp_path / "Größe.blend", "Scene", "View Layer", wanted)
        write_task(task, tmp_path / "task.json")
        assert read_task(tmp_path / "task.json") == task


def test_task_names_files_wherever_the_process_starts(tmp_path):
    write_task(RenderTask(Path("a.blend"), "", "", JobOptions(Path("out"))), tmp_path / "task.json")
    task = read_task(tmp_path / "task.json")
    assert (task.blend, task.options.output) == (Path("a.blend").absolute(), Path("out").absolute())
