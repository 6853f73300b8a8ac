# SPDX-License-Identifier: GPL-3.0-or-later
"""What an earlier run left is refused, replaced or kept, as asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ssgi_addon.core import Settings
from ssgi_addon.earlier_results import check_output, finished_frames, was_skipped
from ssgi_addon.errors import SSGIError
from ssgi_addon.files import write_json
from ssgi_addon.job_options import JobOptions
from ssgi_addon.render_task import RenderTask, read_task, write_task

STEMS = {1: "room_0001", 2: "room_0002", 3: "room_0003"}


@pytest.fixture
def options(tmp_path):
    """Frames 1 and 3 are there, the report knows the first."""
    for frame in (1, 3):
        (tmp_path / f"{STEMS[frame]}.exr").touch()
    record = {"frame": 1, "seconds": {"total": 2.0}, "skipped": [{"what": "fill", "why": "0 samples"}]}
    write_json(tmp_path / "report.json", {"frames": [record]})
    return JobOptions(tmp_path)


def test_earlier_results_are_refused_unless_replaced_or_kept(options):
    with pytest.raises(SSGIError, match=r"room_0001\.exr is there already: switch Overwrite on"):
        check_output(options, STEMS)
    for change in ({"overwrite": True}, {"resume": True}):
        check_output(replace(options, **change), STEMS)


def test_without_resume_or_with_overwrite_nothing_is_kept(options):
    assert finished_frames(options, STEMS) == {}
    assert finished_frames(replace(options, resume=True, overwrite=True), STEMS) == {}


def test_finished_frames_keep_their_entry_and_say_that_they_were_skipped(options):
    kept = finished_frames(replace(options, resume=True), STEMS)
    assert kept.keys() == {1, 3}
    assert all(was_skipped(record) for record in kept.values())
    assert kept[1]["seconds"] == {"total": 2.0}
    assert kept[1]["skipped"][0]["what"] == "fill"
    assert (kept[3]["frame"], kept[3]["seconds"], kept[3]["metrics"]) == (3, {}, None)


def test_frame_that_is_skipped_again_says_so_once(options):
    options = replace(options, resume=True)
    first = finished_frames(options, STEMS)
    write_json(options.output / "report.json", {"frames": list(first.values())})
    assert finished_frames(options, STEMS) == first


def test_frame_without_its_comparison_is_not_finished(options):
    (options.output / f"{STEMS[3]}_compare.png").touch()
    assert finished_frames(replace(options, resume=True, compare=True), STEMS).keys() == {3}


@pytest.mark.parametrize("text", ["", "{", "[]", '{"frames": [{}]}', '{"frames": 1}'])
def test_damaged_report_costs_its_entries_alone(options, text):
    (options.output / "report.json").write_text(text)
    assert finished_frames(replace(options, resume=True), STEMS).keys() == {1, 3}


def test_task_reads_back(tmp_path):
    options = JobOptions.preset(
        "final",
        tmp_path / "out",
        settings=replace(Settings.preset("draft"), threads=3),
        resolution=(48, 27),
        frames=(1, 3),
        resume=True,
        engine="eevee",
    )
    for wanted in (options, JobOptions(tmp_path)):
        task = RenderTask(tmp_path / "Größe.blend", "Scene", "View Layer", wanted)
        write_task(task, tmp_path / "task.json")
        assert read_task(tmp_path / "task.json") == task


def test_task_names_files_wherever_the_process_starts(tmp_path):
    write_task(RenderTask(Path("a.blend"), "", "", JobOptions(Path("out"))), tmp_path / "task.json")
    task = read_task(tmp_path / "task.json")
    assert (task.blend, task.options.output) == (Path("a.blend").absolute(), Path("out").absolute())
