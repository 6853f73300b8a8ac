# SPDX-License-Identifier: GPL-3.0-or-later
"""The Open Job Description template: valid, and each command that it makes is one that we have."""

from __future__ import annotations

import json
import re
import stat
import sys
import time

import pytest

from ssgi_addon.core.settings import PRESETS
from ssgi_addon.job_options import DEFAULT_PRESET
from tests.farm.farm_commands import (
    TEMPLATE,
    needs_bash,
    needs_openjd,
    openjd,
    parameters,
    parsed,
    ssgi_words,
    start_openjd,
)

pytestmark = [needs_openjd, needs_bash]

FRAMES = "-3--1,1-4,7-20:2"
FRAME_NUMBERS = (-3, -2, -1, 1, 2, 3, 4, 7, 9, 11, 13, 15, 17, 19)
# Stands for Python or Blender: notes what it is started with, and fails as the test wants.
RECORDER = """#!{python}
import json, os, sys
with open({log!r}, "a", encoding="utf-8") as log:
    log.write(json.dumps([os.getpid(), *sys.argv[1:]]) + "\\n")
sys.exit(1 if {failing!r} in sys.argv else 0)
"""
# Goes on until it is asked to stop, which it notes
WAITING = """#!{python}
import signal, sys, time
def stop(*_):
    log.write("stopped")
    sys.exit(1)
signal.signal(signal.SIGTERM, stop)
log = open({log!r}, "a", buffering=1)
log.write("started\\n")
time.sleep(600)
"""


def write_program(folder, text, **values):
    program = folder / "program of workers"
    program.write_text(text.format(python=sys.executable, **values))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


@pytest.fixture(name="run_job")
def run_with_a_program_that_records(tmp_path):
    """Run the whole job; return how that ended, and the words of each command."""

    def run(*, failing=None, **given):
        log = tmp_path / "commands"
        log.write_text("")
        program = write_program(tmp_path, RECORDER, log=str(log), failing=failing)
        values = {"Scene": tmp_path / "room.blend", "Output": tmp_path / "out", "Frames": FRAMES}
        done = openjd("run", TEMPLATE, *parameters({**values, "Program": program, **given}))
        started = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
        for process, *_ in started:
            # The farm's signals have to reach the program itself, not a shell before it.
            assert f"Command started as pid: {process}\n" in done.stdout
        return done, [words for _, *words in started]

    return run


def test_template_is_valid():
    done = openjd("check", TEMPLATE)
    assert done.returncode == 0, done.stdout + done.stderr


def test_steps_follow_each_other():
    values = {"Scene": "room.blend", "Output": "out", "Frames": FRAMES}
    done = openjd("summary", TEMPLATE, "--output", "json", *parameters(values))
    summary = json.loads(done.stdout)
    assert summary["status"] == "success"
    steps = {step["name"]: step for step in summary["steps"]}
    assert list(steps) == ["Prepare", "Frames", "Report"]
    assert steps["Frames"]["total_tasks"] == len(FRAME_NUMBERS)
    assert [item["step_name"] for item in steps["Frames"]["dependencies"]] == ["Prepare"]
    assert [item["step_name"] for item in steps["Report"]["dependencies"]] == ["Frames"]


def test_presets_are_those_of_the_command_line():
    import yaml  # comes with openjd

    definitions = yaml.safe_load(TEMPLATE.read_text(encoding="utf-8"))["parameterDefinitions"]
    (preset,) = (item for item in definitions if item["name"] == "Preset")
    assert preset["allowedValues"] == list(PRESETS)
    assert preset["default"] == DEFAULT_PRESET


@pytest.mark.parametrize(
    ("runner", "prepare", "given", "expected"),
    [
        ("module", "true", {}, []),
        ("module", "false", {"Resolution": "96x54", "Preset": "draft"}, ["--resolution=96x54"]),
        (
            "blender",
            "true",
            {"Settings": " --engine eevee   --rays 16 "},
            ["--engine", "eevee", "--rays", "16"],
        ),
        ("blender", "false", {"Settings": "--overwrite"}, ["--overwrite"]),
        ("module", "true", {"RenderOptions": "--passes", "PrepareOptions": "--keys 3"}, []),
    ],
)
def test_parser_takes_every_command(run_job, tmp_path, runner, prepare, given, expected):
    done, commands = run_job(Runner=runner, Prepare=prepare, **given)
    assert done.returncode == 0, done.stdout
    made = []
    for words in commands:
        words, is_blender = ssgi_words(words)
        assert is_blender == (runner == "blender")
        arguments = parsed(words, inside_blender=is_blender)
        made.append(words[0])
        if words[0] == "merge":
            continue
        assert arguments.scene == tmp_path / "room.blend"
        assert f"--preset={given.get('Preset', DEFAULT_PRESET)}" in words
        assert all(word in words for word in expected)
        assert ("--passes" in words) == (words[0] == "render" and "RenderOptions" in given)
        assert ("--keys" in words) == (words[0] == "prepare" and "PrepareOptions" in given)
        folder = tmp_path / "out" / ("shot" if words[0] == "prepare" else "")
        assert arguments.output == folder
        has_shot = f"--shot={tmp_path / 'out' / 'shot'}" in words
        assert has_shot == (words[0] == "render" and prepare == "true")
    assert made == ["prepare"] * (prepare == "true") + ["render"] * 4 + ["merge"]


@pytest.mark.parametrize("chunk_size", [1, 4, 100])
def test_chunks_are_the_frames(run_job, chunk_size):
    done, commands = run_job(ChunkSize=chunk_size)
    assert done.returncode == 0, done.stdout
    rendered = []
    for words in commands:
        words, is_blender = ssgi_words(words)
        frames = parsed(words, inside_blender=is_blender).frames
        if words[0] == "render":
            assert len(frames) <= chunk_size
            rendered += frames
        else:
            assert tuple(frames) == FRAME_NUMBERS
    assert tuple(rendered) == FRAME_NUMBERS


def test_paths_arrive_as_they_are(run_job, tmp_path):
    folder = tmp_path.joinpath("two words", 'o\'clock "now"', "$HOME `id` *;&|<>", "ä—ö", "--help", "{{a}}")
    done, commands = run_job(Scene=folder / "room.blend", Output=folder)
    assert done.returncode == 0, done.stdout
    words = [ssgi_words(words)[0] for words in commands]
    assert words[0][1:3] == [str(folder / "room.blend"), f"--output={folder / 'shot'}"]
    assert words[1][1:3] == [str(folder / "room.blend"), f"--output={folder}"]
    assert words[-1][1] == str(folder)


def test_settings_mean_nothing_to_the_shell(run_job):
    done, commands = run_job(Settings="$HOME * ; true `id` $(id)")
    assert done.returncode == 0, done.stdout
    assert commands[0][-6:] == ["$HOME", "*", ";", "true", "`id`", "$(id)"]


def test_task_that_fails_fails_the_job(run_job):
    done, commands = run_job(failing="--frames=2-4")
    assert done.returncode != 0
    assert [ssgi_words(words)[0][0] for words in commands] == ["prepare", "render", "render"]


def test_request_to_stop_reaches_the_program(tmp_path):
    log = tmp_path / "log"
    log.touch()
    program = write_program(tmp_path, WAITING, log=str(log))
    values = {"Scene": tmp_path / "room.blend", "Output": tmp_path / "out", "Frames": FRAMES}
    process = start_openjd("run", TEMPLATE, *parameters({**values, "Program": program}))
    while not log.read_text() and process.poll() is None:
        time.sleep(0.05)
    process.terminate()
    process.communicate()
    assert process.returncode != 0
    assert log.read_text() == "started\nstopped"


def test_job_without_frames_is_refused():
    done = openjd("summary", TEMPLATE, *parameters({"Scene": "room.blend", "Output": "out"}))
    assert done.returncode != 0
    assert re.search("Frames", done.stdout + done.stderr)
