# SPDX-License-Identifier: GPL-3.0-or-later
"""A small shot by the template, with the real command: a task fails, and the job goes on with what lacks."""

from __future__ import annotations

import json
import sys

import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from tests.farm.farm_commands import TEMPLATE, needs_bash, needs_openjd, openjd, parameters
from tests.scenes import build_closed_room

pytestmark = [needs_openjd, needs_bash]

# Few pixels, one sample, next to nothing beyond the frame
TINY = "--samples 1 --denoiser none --budget 1000 --fill 0 --surround 8 --stations 0 --no-back-faces"


@pytest.fixture(name="scene")
def saved_room(tmp_path):
    """A closed room whose camera moves, in a file that a shell would stumble over."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = build_closed_room()
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x += 0.6
    scene.camera.keyframe_insert("location", frame=4)
    folder = tmp_path / "the artist's scenes"
    folder.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "room.blend"))
    return folder / "room.blend"


def stamps(folder, pattern):
    """What changes of a file when it is written again, though with the same content."""
    found = {}
    for path in folder.rglob(pattern):
        if path.is_file():
            state = path.stat()
            found[path.relative_to(folder).as_posix()] = (state.st_ino, state.st_mtime_ns, state.st_size)
    return found


def job(scene, output, **changes):
    """The parameters of a small job."""
    values = {
        "Scene": scene,
        "Output": output,
        "Preset": "draft",
        "Resolution": "48x27",
        "Settings": TINY,
        "Program": sys.executable,
    }
    return parameters({**values, **changes})


def manifest(output, frame):
    return json.loads((output / "frames" / f"room_{frame:04}.json").read_text(encoding="utf-8"))


def test_job_that_failed_goes_on(scene, tmp_path):
    output = tmp_path / "rendered shot"
    in_the_way = output / "room_0002.exr"
    in_the_way.mkdir(parents=True)
    given = job(scene, output, Frames="1-2,4", ChunkSize=1)

    # The second frame cannot be written: the job fails and says why.
    failed = openjd("run", TEMPLATE, *given)
    assert failed.returncode != 0
    assert "openjd_progress: " in failed.stdout
    assert "openjd_fail: " in failed.stdout
    first, shot = stamps(output, "room_0001.*"), stamps(output / "shot", "*")
    assert {"room_0001.exr", "room_0001.png", "frames/room_0001.json"} <= first.keys()
    assert "shot.json" in shot
    assert not (output / "shot_report.json").exists()

    # What was in the way is gone: only what lacks is rendered.
    in_the_way.rmdir()
    done = openjd("run", TEMPLATE, *given)
    assert done.returncode == 0, done.stdout
    assert "frame 1: there already" in done.stdout
    assert stamps(output, "room_0001.*") == first
    assert stamps(output / "shot", "*") == shot
    hashes = {manifest(output, frame)["shot"] for frame in (1, 2, 4)}
    assert len(hashes) == 1
    assert None not in hashes
    assert all(manifest(output, frame)["failure"] is None for frame in (1, 2, 4))
    assert {"shot_report.json", "shot_report.html"} <= stamps(output, "shot_report.*").keys()


def test_frames_render_alone_where_nothing_is_prepared(scene, tmp_path):
    output = tmp_path / "rendered shot"
    done = openjd("run", TEMPLATE, *job(scene, output, Frames="1,3", ChunkSize=2, Prepare="false"))
    assert done.returncode == 0, done.stdout
    assert not (output / "shot").exists()
    assert [manifest(output, frame)["shot"] for frame in (1, 3)] == [None, None]
    assert {"shot_report.json", "shot_report.html"} <= stamps(output, "shot_report.*").keys()
