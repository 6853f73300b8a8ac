# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles that fails, disks that fill up, runs that are killed or meet: whole files, the scene as it was."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.blender import one_frame
from ssgi_addon.blender.cycles_passes import cycles_engine
from ssgi_addon.blender.job import render_frames
from ssgi_addon.child import environment
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers
from ssgi_addon.passes import read_passes
from tests import budget
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.small_jobs import small_job
from tests.core.test_disk_faults import error_of, small_disk  # noqa: F401  (a fixture)
from tests.faults import kills
from tests.scenes import build_closed_room, build_moving_room

ROOT = Path(__file__).resolve().parents[2]
STRESS = budget.times() > 1
posix_alone = pytest.mark.skipif(os.name != "posix", reason="signals, limits and mounts of POSIX")


@pytest.fixture
def room(empty_file):
    scene = build_moving_room()
    scene.frame_set(1)
    return scene


@pytest.fixture
def options(tmp_path):
    return small_job(tmp_path / "results", frames=(1, 2), keep_world=False)


@pytest.fixture
def blend(room, tmp_path):
    path = tmp_path / "scene" / "room.blend"
    path.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def names_below(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def pictures_below(folder):
    """What is written of frames that are finished, but for the manifests and what lies beside them."""
    return [name for name in names_below(folder) if not name.startswith("frames/") and name != "report.json"]


# --- Cycles fails -----------------------------------------------------------------------------------------


def test_device_that_fails_in_the_second_frame_costs_that_frame_alone(room, options, monkeypatch):
    """Cycles tells of errors in these two ways at once, and returns."""
    before = fingerprint()
    original = cycles_engine().render

    def render(engine, depsgraph):
        original(engine, depsgraph)
        if depsgraph.scene.frame_current == 2:
            engine.report({"ERROR"}, "Out of memory in cuMemAlloc")
            engine.error_set("Out of memory in cuMemAlloc")

    monkeypatch.setattr(cycles_engine(), "render", render)
    with pytest.raises(
        SSGIError, match="could not render scene 'Closed Room': .*Out of memory in cuMemAlloc"
    ):
        render_frames(room, options)
    assert changes(before, fingerprint()) == {}
    assert pictures_below(options.output) == ["untitled_0001.exr", "untitled_0001.png"]
    monkeypatch.undo()
    render_frames(room, replace(options, resume=True))
    assert "untitled_0002.exr" in names_below(options.output)


@pytest.mark.parametrize("kind", ["render_init", "render_pre", "render_post", "frame_change_post"])
def test_handler_that_raises_changes_nothing(room, options, tmp_path, kind):
    """Blender prints its traceback and goes on; so do we, to the same picture."""
    render_frames(room, replace(options, output=tmp_path / "expected"))

    def fail(*_):
        raise ZeroDivisionError

    before = fingerprint()
    handlers = getattr(bpy.app.handlers, kind)
    handlers.append(fail)
    try:
        render_frames(room, options)
    finally:
        handlers.remove(fail)
    assert changes(before, fingerprint()) == {}
    expected = read_layers(tmp_path / "expected" / "untitled_0002.exr")
    found = read_layers(options.output / "untitled_0002.exr")
    assert all(np.array_equal(found[name], values) for name, values in expected.items())


def test_camera_that_is_lost_between_frames_is_one_clear_line(room, options, monkeypatch):
    def lose(scene, *_):
        if scene.frame_current == 2:
            scene.camera = None

    bpy.app.handlers.frame_change_post.append(lose)
    try:
        with pytest.raises(SSGIError, match="has no camera"):
            render_frames(room, options)
    finally:
        bpy.app.handlers.frame_change_post.remove(lose)
    assert pictures_below(options.output) == ["untitled_0001.exr", "untitled_0001.png"]


@pytest.mark.parametrize("step", ["capture_frame", "compute_picture", "to_display"])
def test_memory_that_runs_out_is_one_clear_line(room, options, monkeypatch, step):
    def run_out(*_arguments, **_named):
        raise MemoryError

    before = fingerprint()
    monkeypatch.setattr(one_frame, step, run_out)
    with pytest.raises(SSGIError, match="not enough memory: render at a lower resolution"):
        render_frames(room, options)
    assert changes(before, fingerprint()) == {}
    assert pictures_below(options.output) == []


# --- The disk fills up ------------------------------------------------------------------------------------


@posix_alone
def test_full_disk_costs_no_finished_frame(room, options, small_disk):  # noqa: F811
    """It fills up with the second frame; with room again, the run goes on."""
    before = fingerprint()
    output = small_disk / "results"
    options = replace(options, output=output, resolution=(128, 72), frames=tuple(range(1, 9)))
    with pytest.raises(SSGIError, match="cannot write .*make room there"):
        render_frames(room, options)
    assert changes(before, fingerprint()) == {}
    whole = sorted(output.glob("*.exr"))
    assert 0 < len(whole) < 8
    for path in whole:
        read_layers(path)
    assert not [name for name in names_below(small_disk) if name.endswith(".tmp")]
    for path in whole:
        path.with_suffix(".png").unlink()
    subprocess.run(["mount", "-o", "remount,size=16m", str(small_disk)], check=True)
    # Of the frame at which it was full, the picture may be whole without its manifest: it is no result yet
    done = [path for path in whole if (output / "frames" / path.with_suffix(".json").name).exists()]
    assert len(done) >= len(whole) - 1
    written = [path.stat().st_mtime_ns for path in done]
    render_frames(room, replace(options, resume=True))
    assert len(list(output.glob("*.exr"))) == 8
    assert [path.stat().st_mtime_ns for path in done] == written


@posix_alone
def test_full_temporary_disk_is_one_clear_line(room, options, small_disk, monkeypatch):  # noqa: F811
    (small_disk / "filler").write_bytes(bytes((1 << 20) - 8192))
    monkeypatch.setattr("tempfile.tempdir", str(small_disk))
    before = fingerprint()
    with pytest.raises(SSGIError, match="(?i)make room there"):
        render_frames(room, replace(options, resolution=(256, 144)))
    assert changes(before, fingerprint()) == {}
    assert names_below(small_disk) == ["filler"]
    assert pictures_below(options.output) == []


LIMITED = """
import resource, signal, sys
from ssgi_addon.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), -1))
sys.exit(main(sys.argv[2:]))
"""


@pytest.fixture(name="compared", scope="module")
def compared_runs(tmp_path_factory):
    """The command of a render with its comparison, its files, and those of an older one."""
    folder = tmp_path_factory.mktemp("compared")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    build_closed_room()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "room.blend"), copy=True)

    def command(output, *more):
        line = kills.render_command(folder / "room.blend", output, "--overwrite", *more)
        return [*line, "--frames", "1-1", "--compare", "--reference-samples", "1"]

    for name, rays in (("old", "3"), ("new", "1")):
        kills.run(command(folder / name, "--rays", rays), folder)
    return command, kills.files_below(folder / "old"), kills.files_below(folder / "new"), folder / "old"


@posix_alone
@pytest.mark.property
@pytest.mark.parametrize("kilobytes", [4, 40] if not STRESS else [*range(0, 100, 4)])
def test_files_that_may_not_grow_leave_what_was_there(compared, tmp_path, kilobytes):
    """Pictures, sheets and reports: each is the old one or the new one, and the error says which failed."""
    command, old, new, folder = compared
    if kilobytes << 10 >= max(map(len, new.values())):
        pytest.skip("no file is larger")
    output = tmp_path / "out"
    shutil.copytree(folder, output)
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(kilobytes << 10), *command(output, "--rays", "1")[3:]],
        cwd=ROOT, env=environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    errors = [line for line in done.stderr.splitlines() if line.startswith("ssgi: error: ")]
    assert (done.returncode, len(errors)) == (1, 1), done.stderr
    assert "Traceback" not in done.stderr
    assert list(kills.half_files(output, old, new)) == []
    assert kills.unfinished(output) == []


# --- Runs that are killed, and runs that meet -------------------------------------------------------------


@posix_alone
@pytest.mark.property
def test_killed_renders_leave_old_or_new_files_and_the_next_run_finishes(blend, tmp_path, rng):
    found = kills.kill_renders(blend, tmp_path / "kills", 20 if STRESS else 2, rng)
    assert found.faults == []


@posix_alone
@pytest.mark.property
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at processes as Linux shows them")
def test_killed_windows_leave_no_process_and_no_file(blend, tmp_path, rng):
    found = kills.kill_windows(blend, tmp_path / "kills", 10 if STRESS else 2, rng)
    assert found.faults == []


def test_two_runs_into_one_folder_leave_whole_files(blend, tmp_path):
    """Of other rays, so that what is of one run can be told from what is of the other."""
    both = tmp_path / "both"
    runs = [
        subprocess.Popen(
            kills.render_command(blend, both, "--overwrite", "--passes", "--rays", rays),
            cwd=ROOT,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        for rays in "23"
    ]
    for process in runs:
        _, error = process.communicate()
        assert process.returncode == 0, error
    alone = []
    for rays in "23":
        kills.run(kills.render_command(blend, tmp_path / rays, "--rays", rays), tmp_path)
        alone.append(kills.files_below(tmp_path / rays))
    files = kills.files_below(both)
    for name in alone[0]:
        assert files[name] in (alone[0][name], alone[1][name]), name
    for path in (both / "passes").glob("room_????.exr"):
        reason = error_of(read_passes, path)
        assert ("of another capture" in reason) == bool(reason)
    assert kills.unfinished(both) == []
