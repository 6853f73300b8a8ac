# SPDX-License-Identifier: GPL-3.0-or-later
"""Manifests are read, and whatever else a folder holds is one clear line."""

from __future__ import annotations

import json
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon import manifest
from ssgi_addon.camera_file import camera_to_json
from ssgi_addon.errors import SSGIError
from ssgi_addon.shot.command import merge
from ssgi_addon.shot.manifests import read_manifest, read_shot
from tests.budget import examples
from tests.core.shot_folders import BEGUN, VERSIONS, camera_at, failed, manifest_of, write_manifest


def test_manifest_tells_what_it_says(tmp_path):
    write_manifest(tmp_path, manifest_of(3, machine="beta", shot="abc"))
    write_manifest(tmp_path, failed(12, "no memory"))
    shot = read_shot(tmp_path)
    assert (shot.name, list(shot.manifests), shot.unread) == ("room", [3, 12], [])
    third = shot.manifests[3]
    assert (third.stem, third.machine, third.shot, third.started) == ("room_0003", "beta", "abc", BEGUN)
    assert third.seconds["total"] == 3.5
    assert (shot.manifests[12].failure, shot.manifests[12].record) == ("no memory", None)


def test_what_runs_write_is_read(tmp_path):
    camera = camera_at(4)
    recipe = {"ssgi": "1.0.0", "shot": "abc", "diffuse": {"rays": 4}}
    record = manifest_of(4)["record"] | {"metrics": {"combined": {"relmse": 0.1, "flip": None}}}
    manifest.write_manifest(tmp_path, "hall", record, camera, recipe, VERSIONS)
    manifest.write_failure(tmp_path, "hall", 5, "no memory", recipe, VERSIONS)
    shot = read_shot(tmp_path)
    assert (shot.name, list(shot.manifests), shot.unread) == ("hall", [4, 5], [])
    fourth, fifth = shot.manifests.values()
    assert (fourth.shot, fourth.settings, fourth.seconds) == ("abc", recipe, record["seconds"])
    assert fourth.started < fourth.finished
    assert fourth.settings_hash == fifth.settings_hash
    assert fourth.process == fifth.process
    assert camera_to_json(camera) == fourth.camera
    assert (fifth.failure, fifth.record) == ("no memory", None)


def test_frames_below_zero_and_beyond_four_digits_are_read(tmp_path):
    for frame in (-12, 0, 123456):
        write_manifest(tmp_path, manifest_of(frame))
    assert list(read_shot(tmp_path).manifests) == [-12, 0, 123456]


def test_names_may_hold_anything_that_files_may(tmp_path):
    name = "a.b <c> 'ü' [1]"
    write_manifest(tmp_path, manifest_of(1, name))
    assert read_shot(tmp_path).name == name
    assert read_shot(tmp_path, name).name == name


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "not JSON"),
        ('{"format": "ssgi-frame", "version": 1, "na', "not JSON"),
        ("[" * 100_000, "not JSON"),
        (json.dumps(manifest_of(1)).replace(": 3.5", ": NaN"), "the number NaN"),
        (json.dumps(manifest_of(1)).replace(": 3.5", ": 1e999"), "out of range"),
        (json.dumps(manifest_of(1)).replace(": 3.5", ": " + "9" * 999), "out of range"),
        (json.dumps(manifest_of(1) | {"version": 2}), "version 2, this is for 1"),
        (json.dumps(manifest_of(1) | {"record": None}), "neither a record nor a failure"),
        (json.dumps(manifest_of(1) | {"frame": "1"}), "frame"),
        (json.dumps(manifest_of(1) | {"frame": True}), "frame"),
        (json.dumps(manifest_of(1) | {"finished": "yesterday"}), "finished"),
        (json.dumps(manifest_of(1) | {"process": 7}), "process"),
        (json.dumps(manifest_of(1, record={"seconds": {"capture": 1.0}})), "seconds"),
        (json.dumps(manifest_of(1, record={"known": "all"})), "known"),
        (json.dumps(manifest_of(1, record={"notes": [3]})), "notes"),
        (json.dumps(manifest_of(2)), "renamed or copied"),
    ],
)
def test_damaged_manifest_is_one_line_and_stops_no_other(tmp_path, text, why):
    write_manifest(tmp_path, manifest_of(5))
    (tmp_path / "frames" / "room_0001.json").write_text(text)
    shot = read_shot(tmp_path)
    assert list(shot.manifests) == [5]
    (entry,) = shot.unread
    assert (entry.file, entry.counts) == ("room_0001.json", True)
    assert why in entry.why
    assert "\n" not in entry.why


def test_file_that_is_no_text_is_one_line(tmp_path):
    write_manifest(tmp_path, manifest_of(5))
    (tmp_path / "frames" / "room_0001.json").write_bytes(b"\xff\x00\xfe")
    assert "not a text file" in read_shot(tmp_path).unread[0].why


def test_foreign_files_are_told_and_do_not_count(tmp_path):
    write_manifest(tmp_path, manifest_of(5))
    frames = tmp_path / "frames"
    (frames / "other_0001.json").write_text('{"format": "something else"}')
    (frames / "list_0001.json").write_text("[1, 2]")
    (frames / "broken_0001.json").write_text("{")
    (frames / "notes.json").write_text("{")
    (frames / ".hidden_0001.json").write_text("{")
    (frames / "folder_0001.json").mkdir()
    shot = read_shot(tmp_path)
    assert list(shot.manifests) == [5]
    assert sorted((entry.file, entry.counts) for entry in shot.unread) == [
        ("broken_0001.json", False), ("list_0001.json", False), ("other_0001.json", False),
    ]  # fmt: skip


def test_file_that_goes_away_is_no_fault(tmp_path, monkeypatch):
    write_manifest(tmp_path, manifest_of(5))
    write_manifest(tmp_path, manifest_of(6))
    read_bytes = Path.read_bytes

    def vanish(path):
        if path.name == "room_0005.json":
            raise FileNotFoundError(path)
        return read_bytes(path)

    monkeypatch.setattr(Path, "read_bytes", vanish)
    shot = read_shot(tmp_path)
    assert (list(shot.manifests), shot.unread) == ([6], [])


def test_several_scenes_want_a_name(tmp_path):
    for name in ("room", "room_2", "hall"):
        write_manifest(tmp_path, manifest_of(1, name))
    with pytest.raises(SSGIError, match=r"hall, room, room_2.*--name"):
        read_shot(tmp_path)
    assert read_shot(tmp_path, "room").name == "room"
    assert list(read_shot(tmp_path, "room_2").manifests) == [1]
    with pytest.raises(SSGIError, match="no frames of attic"):
        read_shot(tmp_path, "attic")


@pytest.mark.parametrize("inside", [False, True])
def test_folder_without_frames_is_one_line(tmp_path, inside):
    if inside:
        (tmp_path / "frames").mkdir()
    with pytest.raises(SSGIError, match="holds no frames"):
        read_shot(tmp_path)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


def _places(value, path=()):
    """Every place in nested data."""
    yield path
    if isinstance(value, (dict, list)):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from _places(value[key], (*path, key))


def _replaced(value, path, new):
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = _replaced(copy[path[0]], path[1:], new)
    return copy


@given(st.data())
@examples(60)
def test_any_change_is_read_or_one_line_and_the_report_is_written(data):
    whole = manifest_of(1, record={"metrics": {"combined": {"relmse": 0.1, "flip": None}}})
    place = data.draw(st.sampled_from(list(_places(whole))))
    changed = _replaced(whole, place, data.draw(_JSON))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_manifest(folder, manifest_of(2))
        path = folder / "frames" / "room_0001.json"
        path.write_text(json.dumps(changed), encoding="utf-8")
        with suppress(SSGIError):
            read_manifest(path)
        merged = merge(folder, None, "room", draws=False)
        json.loads((folder / "shot_report.json").read_text(), parse_constant=pytest.fail)
        assert merged.report["counts"]["finished"] >= 1
