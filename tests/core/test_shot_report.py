# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a shot: what it counts, sums up and groups, and what is wrong with the shot."""

from __future__ import annotations

import json
from datetime import timedelta

import numpy as np
import pytest

from ssgi_addon import cli
from ssgi_addon.errors import SSGIError
from ssgi_addon.shot import command
from ssgi_addon.shot.cells import cells_of, choose
from ssgi_addon.shot.manifests import read_shot
from ssgi_addon.shot.report import build_report
from tests.core.shot_folders import (
    BEGUN,
    STEPS,
    VERSIONS,
    even_light,
    failed,
    manifest_of,
    write_frame,
    write_manifest,
)

pytest.importorskip("OpenEXR")


def report_of(folder, manifests, expected=None, flicker=None):
    for manifest in manifests:
        write_manifest(folder, manifest)
    return build_report(read_shot(folder), expected, flicker or {})


def at(seconds):
    return (BEGUN + timedelta(seconds=seconds)).isoformat()


@pytest.fixture
def no_blender(monkeypatch):
    def refuse():
        raise SSGIError("there is no Blender here")

    monkeypatch.setattr(command, "require_bpy", refuse)


def test_frames_are_counted(tmp_path):
    manifests = [manifest_of(1), manifest_of(2), failed(4, "no memory"), manifest_of(9)]
    report = report_of(tmp_path, manifests, expected=range(1, 7))
    assert report["counts"] == {"finished": 2, "failed": 1, "missing": 3, "unread": 0}
    assert (report["expected"], report["missing"], report["failed"]) == ("1-6", "3,5-6", "4")
    assert [row["frame"] for row in report["frames"]] == [1, 2, 3, 4, 5, 6]
    assert report["frames"][3]["failure"] == "no memory"


def test_without_expected_frames_none_is_missing(tmp_path):
    report = report_of(tmp_path, [manifest_of(1), manifest_of(9)])
    assert report["counts"] == {"finished": 2, "failed": 0, "missing": 0, "unread": 0}


def test_steps_add_up_to_the_total(tmp_path):
    seconds = STEPS | {"denoise": 0.1, "total": 4.0}
    report = report_of(tmp_path, [manifest_of(1, record={"seconds": seconds}), manifest_of(2)])
    first, second = (row["steps"] for row in report["frames"])
    other = pytest.approx(0.65)
    assert first == {"capture": 2.0, "passes": 1.0, "denoise": 0.1, "write": 0.25, "other": other}
    assert sum(second.values()) == 3.5
    assert report["seconds"]["steps"]["capture"] == 4.0
    assert (report["seconds"]["sum"], report["seconds"]["worst_frame"]) == (7.5, 1)


def test_throughput_counts_time_in_which_a_process_worked(tmp_path):
    """Two processes side by side for 20 s, then nothing for 80 s, then one for 10 s: 6 frames in 30 s."""
    work = [
        ("a", 0.0, [5.0, 10.0]), ("b", 2.0, [12.0, 20.0]), ("c", 100.0, [104.0, 110.0]),
    ]  # fmt: skip
    frames = iter(range(1, 7))
    manifests = [
        manifest_of(
            next(frames), finished=at(end), process={"id": process, "started": at(begin)},
            record={"seconds": {"total": 3.0}},
        )
        for process, begin, ends in work
        for end in ends
    ]  # fmt: skip
    speed = report_of(tmp_path, manifests)["throughput"]
    assert speed["wall_seconds"] == 30.0
    assert speed["frames_per_minute"] == 12.0
    # 10 + 18 + 10 seconds of processes, 18 of frames
    assert speed["overhead_per_frame"] == pytest.approx(20.0 / 6.0)
    assert (speed["begun"], speed["ended"]) == (at(0.0), at(110.0))


def test_reference_is_no_overhead(tmp_path):
    record = {"seconds": {"total": 3.0, "reference": 6.0}}
    speed = report_of(tmp_path, [manifest_of(1, finished=at(10.0), record=record)])["throughput"]
    assert speed["overhead_per_frame"] == 1.0


@pytest.mark.parametrize(
    "changes",
    [
        {"finished": None},
        {"process": {"id": "p"}},
        {"finished": at(-60.0)},
    ],
)
def test_process_whose_times_cannot_be_is_left_out(tmp_path, changes):
    speed = report_of(tmp_path, [manifest_of(1, **changes)])["throughput"]
    assert (speed["frames"], speed["frames_per_minute"], speed["overhead_per_frame"]) == (0, None, None)


def test_mixed_frames_are_named_and_shots_that_share_all_are_not(tmp_path):
    manifests = [manifest_of(frame) for frame in range(1, 6)]
    manifests[3] |= {"settings_hash": "other", "settings": {"samples": 8}}
    manifests[4] |= {"versions": VERSIONS | {"ssgi": "1.1.0"}, "shot": "abc"}
    report = report_of(tmp_path, manifests)
    assert [(entry["hash"], entry["frames"]) for entry in report["settings"]] == [
        ("0123456789abcdef", "1-3,5"), ("other", "4"),
    ]  # fmt: skip
    assert [entry["frames"] for entry in report["versions"]] == ["1-4", "5"]
    assert [(entry["shot"], entry["frames"]) for entry in report["shots"]] == [(None, "1-4"), ("abc", "5")]


def test_machines_have_their_frames_and_seconds(tmp_path):
    names = ["alpha", "beta", "alpha", "alpha"]
    manifests = [manifest_of(frame, machine=name) for frame, name in enumerate(names, start=1)]
    assert report_of(tmp_path, manifests)["machines"] == [
        {"machine": "alpha", "count": 3, "frames": "1,3-4", "processes": 1, "seconds": 10.5, "median": 3.5},
        {"machine": "beta", "count": 1, "frames": "2", "processes": 1, "seconds": 3.5, "median": 3.5},
    ]


def test_what_was_skipped_and_noted_is_grouped(tmp_path):
    skips = [{"what": "fill", "why": "no light"}]
    manifests = [manifest_of(frame, record={"skipped": skips, "notes": ["Glass."]}) for frame in (1, 2, 3)]
    manifests[2]["record"]["notes"] = ["Glass.", "Fog."]
    report = report_of(tmp_path, manifests)
    assert report["skipped"] == [{"what": "fill", "why": "no light", "count": 3, "frames": "1-3"}]
    assert report["notes"] == [
        {"note": "Glass.", "count": 3, "frames": "1-3"}, {"note": "Fog.", "count": 1, "frames": "3"},
    ]  # fmt: skip


def test_texts_that_differ_in_numbers_are_one(tmp_path):
    skips = {1: "of 25,933 pixels, 2 views", 2: "of 9,870 pixels, 2 views", 3: "of 101,000 pixels, 2 views"}
    manifests = [
        manifest_of(frame, record={"skipped": [{"what": what, "why": "black"}]})
        for frame, what in skips.items()
    ]
    manifests[2]["record"]["notes"] = ["A note 1."]
    report = report_of(tmp_path, manifests)
    assert report["skipped"] == [
        {"what": "of 9,870 to 101,000 pixels, 2 views", "why": "black", "count": 3, "frames": "1-3"}
    ]
    assert [entry["note"] for entry in report["notes"]] == ["A note.", "A note 1."]


def test_worst_frames_are_those_beyond_the_median(tmp_path):
    manifests = [
        manifest_of(
            frame,
            record={
                "seconds": {"total": 9.0 if frame == 7 else 3.0},
                "known": 0.5 if frame == 8 else 0.9,
                "metrics": {"combined": {"relmse": frame * 0.001}},
            },
        )
        for frame in range(1, 22)
    ]
    worst = report_of(tmp_path, manifests)["worst"]
    assert worst["seconds"] == [{"frame": 7, "value": 9.0}]
    assert worst["known"] == [{"frame": 8, "value": 0.5}]
    assert [entry["frame"] for entry in worst["error"]] == [21, 20, 19]
    assert worst["flicker"] == []


def test_long_shots_show_an_even_choice_and_all_that_count(tmp_path):
    manifests = [
        failed(frame) if frame % 50 == 0 else manifest_of(frame, record={"known": 0.9 - (frame == 33)})
        for frame in range(1, 401)
    ]
    cells = cells_of(report_of(tmp_path, manifests, expected=range(1, 421)))
    chosen = choose(cells, 120)
    assert len(chosen) == 120
    titles = [cell.title for cell in chosen]
    assert {"33", "401-420", *(str(frame) for frame in range(50, 401, 50))} <= set(titles)
    plain = [int(cell.title) for cell in chosen if not cell.counts]
    assert max(np.diff(plain)) <= 5
    assert choose(cells, 1000) == cells
    assert len(choose(cells, 3)) == sum(cell.counts for cell in cells)


def test_the_same_frames_give_the_same_files(tmp_path, no_blender):
    for frame in range(1, 6):
        write_frame(tmp_path, frame, even_light, speed=0.01)
    texts = []
    for _ in range(2):
        command.merge(tmp_path, range(1, 7), None)
        texts.append([(tmp_path / name).read_bytes() for name in (command.REPORT, command.PAGE)])
    assert texts[0] == texts[1]


def test_folder_is_left_as_it_was_but_for_the_reports(tmp_path, no_blender):
    write_frame(tmp_path, 1, even_light)
    (tmp_path / command.PICTURE).write_bytes(b"of an earlier merge")
    before = sorted((tmp_path / "frames").iterdir())
    command.merge(tmp_path, None, None)
    assert sorted((tmp_path / "frames").iterdir()) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames", command.PAGE, command.REPORT]


def test_whole_shot_is_done_and_the_log_tells_its_figures(tmp_path, no_blender, capsys):
    for frame in range(1, 6):
        write_frame(tmp_path, frame, even_light, machine="alpha" if frame % 2 else "beta")
    assert cli.main(["merge", str(tmp_path), "--frames", "1-5"]) == cli.DONE
    out = capsys.readouterr().out
    assert "room: 5 finished\n" in out
    assert "seconds a frame: median 3.5 s, worst 3.5 s" in out
    assert "frames per minute: 12 by 1 process on 2 machines" in out
    assert "flicker: median" in out
    assert "picture: left out: there is no Blender here" in out
    assert f"page: {tmp_path / command.PAGE}" in out


def test_shot_that_is_not_whole_fails_after_the_reports_are_written(tmp_path, no_blender, capsys):
    for frame in (1, 2, 4):
        write_frame(tmp_path, frame)
    write_manifest(tmp_path, failed(5))
    write_frame(tmp_path, 6, settings_hash="other")
    (tmp_path / "frames" / "room_0008.json").write_text("{")
    assert cli.main(["merge", str(tmp_path), "--frames", "1-9"]) == cli.FAILED
    error = capsys.readouterr().err.splitlines()[-1]
    for told in (
        "frames 3,7-9 missing", "frame 5 failed", "1 manifest cannot be read",
        "different settings: frames 1-2,4 and frame 6",
    ):  # fmt: skip
        assert told in error
    report = json.loads((tmp_path / command.REPORT).read_text())
    assert report["counts"] == {"finished": 4, "failed": 1, "missing": 4, "unread": 1}


@pytest.mark.parametrize("line", ["merge", "merge DIR --frames 5-", "merge DIR --frames 3-1"])
def test_bad_usage_is_told_as_such(line):
    assert cli.main(line.split()) == cli.BAD_USAGE


def test_missing_folder_is_one_line_and_stays_missing(tmp_path, capsys):
    assert cli.main(["merge", str(tmp_path / "nowhere")]) == cli.FAILED
    assert "holds no frames" in capsys.readouterr().err
    assert not (tmp_path / "nowhere").exists()
