# SPDX-License-Identifier: GPL-3.0-or-later
"""Flamenco's job type, compiled by a stand-in for Flamenco: each command of it is one that we have."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ssgi_addon.core.settings import PRESETS
from ssgi_addon.job_options import DEFAULT_PRESET
from tests.farm.farm_commands import ROOT, parsed, ssgi_words

# An engine without Node's modules, as Flamenco's own is.
quickjs = pytest.importorskip("quickjs", reason="Flamenco's job type needs pip install quickjs-ng")

SCRIPT = ROOT / "farm" / "ssgi_flamenco.js"
STUB = Path(__file__).with_name("flamenco_stub.js")
# What the add-on sends: whatever the artist left alone has its default.
SUBMITTED = {
    "frames": "1-4, 7, 9..12",
    "chunk_size": 3,
    "preset": "final",
    "resolution": "",
    "further_settings": "",
    "render_options": "",
    "prepare_options": "",
    "prepare": True,
    "output_root": "/shared/two words",
    "output_path": "/shared/two words/a job/{timestamp}",
    "blendfile": "/shared/jobs/the room.blend",
}
FRAME_NUMBERS = (1, 2, 3, 4, 7, 9, 10, 11, 12)
OUTPUT = "/shared/two words/a job/2024-02-29_123005"
# Fields of a setting that Flamenco's add-on and web interface know.
FIELDS = {
    "key", "type", "subtype", "choices", "propargs", "description", "label", "default", "eval", "evalInfo",
    "visible", "required", "editable",
}  # fmt: skip


@pytest.fixture(name="engine")
def engine_with_the_script():
    engine = quickjs.Context()
    engine.eval(STUB.read_text(encoding="utf-8"))
    # Flamenco runs scripts in strict mode.
    engine.eval('"use strict";\n' + SCRIPT.read_text(encoding="utf-8"))
    return engine


@pytest.fixture(name="compiled")
def compile_a_job(engine):
    """Compile a job with some settings changed, None: left out; return its settings and its tasks by name."""

    def compiled(**changes):
        settings = {key: value for key, value in {**SUBMITTED, **changes}.items() if value is not None}
        job = json.loads(engine.get("compile")(json.dumps(settings)))
        return job["settings"], {task["name"]: task for task in job["tasks"]}

    return compiled


def words_of(task):
    """Return the words of a task's ssgi command, as the parser takes them, and what it makes of them."""
    assert task["type"] == "blender"
    (command,) = task["commands"]
    assert command["name"] == "blender-render"
    given = command["parameters"]
    assert (given["exe"], given["exeArgs"]) == ("{blender}", "{blenderArgs}")
    assert given["blendfile"] == SUBMITTED["blendfile"]
    assert all(isinstance(word, str) for word in given["argsBefore"] + given["args"])
    words, is_blender = ssgi_words(given["args"])
    assert is_blender
    return words, parsed(words, inside_blender=True)


def test_settings_have_what_flamenco_knows(engine):
    job_type = json.loads(engine.eval("JSON.stringify(JOB_TYPE)"))
    settings = {setting["key"]: setting for setting in job_type["settings"]}
    assert len(settings) == len(job_type["settings"])
    assert settings.keys() == SUBMITTED.keys()
    for setting in settings.values():
        assert setting.keys() <= FIELDS
        assert setting["type"] in ("string", "int32", "bool")
        assert setting.get("visible", "visible") in ("visible", "hidden", "submission", "web")
        # Who submits has to be able to give it, or it comes by itself.
        assert setting.get("required") or "default" in setting or "eval" in setting
        compile(setting.get("eval", "0"), setting["key"], "eval")
    assert settings["preset"]["choices"] == list(PRESETS)
    assert settings["preset"]["default"] == DEFAULT_PRESET


def test_tasks_follow_each_other(compiled):
    settings, tasks = compiled()
    renders = ["render-1-3", "render-4,7,9", "render-10-12"]
    assert list(tasks) == ["prepare", *renders, "report"]
    assert tasks["prepare"]["dependencies"] == []
    assert all(tasks[name]["dependencies"] == ["prepare"] for name in renders)
    assert tasks["report"]["dependencies"] == renders
    assert settings["output_path"] == OUTPUT


def test_parser_takes_every_command(compiled):
    _, tasks = compiled(
        resolution="96x54",
        further_settings=" --engine eevee  --rays 16 ",
        render_options="--passes",
        prepare_options="--keys 3",
    )
    rendered = []
    for name, task in tasks.items():
        words, arguments = words_of(task)
        if name == "report":
            assert words[:2] == ["merge", OUTPUT]
            assert tuple(arguments.frames) == FRAME_NUMBERS
            continue
        assert (arguments.preset, arguments.resolution) == ("final", (96, 54))
        assert (arguments.engine, arguments.rays) == ("eevee", 16)
        # Where Flamenco translates paths between platforms, each has to be a word of its own.
        if name == "prepare":
            assert words[0] == "prepare"
            assert f"{OUTPUT}/shot" in words
            assert tuple(arguments.frames) == FRAME_NUMBERS
            assert arguments.keys == 3
        else:
            assert words[0] == "render"
            assert words[words.index("--output") + 1] == OUTPUT
            assert words[words.index("--shot") + 1] == f"{OUTPUT}/shot"
            assert arguments.save_passes
            rendered += arguments.frames
    assert tuple(rendered) == FRAME_NUMBERS


def test_frames_render_alone_where_nothing_is_prepared(compiled):
    _, tasks = compiled(prepare=False, chunk_size=1)
    assert "prepare" not in tasks
    assert len(tasks) == len(FRAME_NUMBERS) + 1
    for name, task in tasks.items():
        words, _ = words_of(task)
        assert "--shot" not in words
        assert "--resolution" not in words
        if name != "report":
            assert task["dependencies"] == []


def test_settings_left_out_have_their_defaults(compiled):
    left_out = dict.fromkeys(SUBMITTED.keys() - {"frames", "output_root", "output_path", "blendfile"})
    settings, tasks = compiled(frames="1-8", **left_out)
    assert list(tasks) == ["prepare", "render-1-4", "render-5-8", "report"]
    assert settings["preset"] == DEFAULT_PRESET
    for task in tasks.values():
        words_of(task)


@pytest.mark.parametrize(
    "changes", [{"frames": "-3-4"}, {"frames": "1-8:2"}, {"frames": ""}, {"chunk_size": 0}]
)
def test_what_flamenco_cannot_divide_is_refused(compiled, changes):
    with pytest.raises(quickjs.JSException):
        compiled(**changes)
