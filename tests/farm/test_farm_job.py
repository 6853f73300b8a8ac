# SPDX-License-Identifier: GPL-3.0-or-later
"""A small shot by the template, with the real command: a task fails, and the job goes on with what lacks."""

from __future__ import annotations

import json
import sys

import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.cli import build_parser
from tests.farm.farm_commands import TEMPLATE, needs_bash, needs_openjd, openjd, parameters
from tests.scenes import build_closed_room

pytestmark = [needs_openjd, needs_bash]
if "prepare" not in build_parser().format_help():
    pytest.skip("there is no command that prepares a shot yet", allow_module_level=True)

# Few pixels, one sample, next to nothing beyond the frame
TINY = "--samples 1 --denoiser none --budget 1000 --fill 0 --surround 8 --stations 0 --no-back-faces"
FRAMES = (1, 2, 4)


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


@pytest.mark.parametrize("prepare", ["true", "false"])
def test_job_that_failed_goes_on(scene, tmp_path, prepare):
    output = tmp_path / "rendered shot"
    in_the_way = output / "room_0002.exr"
    in_the_way.mkdir(parents=True)
    job = parameters(
        {
            "Scene": scene,
            "Output": output,
            "Frames": "1-2,4",
            "ChunkSize": 1,
            "Preset": "draft",
            "Resolution": "48x27",
            "Settings": TINY,
            "Prepare": prepare,
            "Program": sys.executable,
        }
    )

    # The second frame cannot be written: the job fails and says why.
    failed = openjd("run", TEMPLATE, *job)
    assert failed.returncode != 0
    assert "openjd_progress: " in failed.stdout
    assert "openjd_fail: " in failed.stdout
    assert (output / "shot" / "shot.json").exists() == (prepare == "true")
    first = stamps(output, "room_0001.*")
    assert {"room_0001.exr", "room_0001.png", "frames/room_0001.json"} <= first.keys()
    assert not (output / "shot_report.json").exists()

    # What was in the way is gone: only what lacks is rendered.
    in_the_way.rmdir()
    shot = stamps(output / "shot", "*")
    done = openjd("run", TEMPLATE, *job)
    assert done.returncode == 0, done.stdout
    assert "frame 1: there already" in done.stdout
    assert stamps(output, "room_0001.*") == first
    assert stamps(output / "shot", "*") == shot
    for frame in FRAMES:
        manifest = json.loads((output / "frames" / f"room_{frame:04}.json").read_text(encoding="utf-8"))
        assert (manifest["frame"], manifest["failure"]) == (frame, None)
        assert (manifest["shot"] is not None) == (prepare == "true")
        assert (output / f"room_{frame:04}.exr").is_file()
    assert (output / "shot_report.json").is_file()
    assert (output / "shot_report.html").is_file()

    # Once more: nothing is left to do.
    everything = stamps(output, "room_*") | stamps(output, "shot/*")
    again = openjd("run", TEMPLATE, *job)
    assert again.returncode == 0, again.stdout
    assert stamps(output, "room_*") | stamps(output, "shot/*") == everything
