# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend file from a stranger: its scripts do not run, and its names are names, whatever they hold."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.bench.options import BenchOptions, SceneSource
from ssgi_addon.bench.tasks import Task, write_task
from ssgi_addon.blender.job import run_job
from ssgi_addon.child import environment, ssgi_command
from ssgi_addon.core import Settings
from ssgi_addon.errors import SSGIError
from ssgi_addon.job_options import JobOptions
from ssgi_addon.render_task import COMMAND, RenderTask
from ssgi_addon.render_task import write_task as write_render_task
from tests.scenes import build_closed_room

ROOT = Path(__file__).resolve().parents[2]
TINY = [
    "--resolution", "16x9", "--samples", "1", "--preset", "draft", "--denoiser", "none", "--fill", "0",
    "--surround", "0", "--stations", "0",
]  # fmt: skip
ODD = "../../\x1b]0;owned\x07\x1b[31m\n{0.__class__}%s%n CON "
REGISTERED = """
import bpy
from pathlib import Path
folder = Path({folder!r})
(folder / "text").touch()
def write(*_):
    (folder / "handler").touch()
for handlers in (bpy.app.handlers.load_post, bpy.app.handlers.render_pre, bpy.app.handlers.frame_change_post):
    handlers.append(write)
"""


@pytest.fixture
def traps(tmp_path):
    """A folder where each script that runs leaves a file."""
    folder = tmp_path / "traps"
    folder.mkdir()
    return folder


@pytest.fixture
def blend(empty_file, tmp_path, traps):
    """A room with a registered text, a driver, a handler, and a compositor that writes files."""
    scene = build_closed_room()
    text = bpy.data.texts.new("innocent.py")
    text.write(REGISTERED.format(folder=str(traps)))
    text.use_module = True
    expression = f"__import__('pathlib').Path({str(traps / 'driver')!r}).touch() or 0.0"
    scene.objects[0].driver_add("location", 0).driver.expression = expression
    path = tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def run(command, **more):
    return subprocess.run(
        [*map(str, command)], cwd=ROOT, env=environment(), stdin=subprocess.PIPE, capture_output=True,
        text=True, check=False, **more,
    )  # fmt: skip


def render(blend, output, *more):
    return run([sys.executable, "-m", "ssgi_addon", "render", blend, "--output", output, *TINY, *more])


# --- Scripts ----------------------------------------------------------------------------------------------


def test_scripts_stay_off_and_the_user_is_told(blend, traps, tmp_path):
    done = render(blend, tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert list(traps.iterdir()) == []
    assert "note: Scripts or drivers of this file did not run" in done.stdout
    assert "--enable-autoexec" in done.stdout
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert any("did not run" in note for note in report["frames"][0]["notes"])


def test_scripts_run_where_the_user_says_so(blend, traps, tmp_path):
    """Else the tests beside this one would prove nothing."""
    done = render(blend, tmp_path / "out", "--enable-autoexec")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in traps.iterdir()} == {"text", "driver", "handler"}
    assert "did not run" not in done.stdout


def test_preference_of_a_blender_does_not_count_for_the_module(blend, traps, tmp_path):
    script = f"""
import sys
import bpy
bpy.context.preferences.filepaths.use_scripts_auto_execute = True
from ssgi_addon.bpy_module import leave
from ssgi_addon.cli import main
leave(main(["render", {str(blend)!r}, "--output", {str(tmp_path / "out")!r}, *{TINY!r}]))
"""
    assert run([sys.executable, "-c", script]).returncode == 0
    assert list(traps.iterdir()) == []


@pytest.mark.parametrize("allowed", [False, True])
def test_benchmark_runs_scripts_only_where_the_user_says_so(blend, traps, tmp_path, allowed):
    options = BenchOptions(tmp_path / "bench", scenes=(str(blend),), enable_autoexec=allowed)
    path = tmp_path / "task.json"
    write_task(Task("measure", options, SceneSource("room", blend), 0.0), path)
    script = f"""
from pathlib import Path
from ssgi_addon.bpy_module import leave, require_bpy
require_bpy()
from ssgi_addon.bench.tasks import read_task
from ssgi_addon.blender.bench_worker import open_source
task = read_task(Path({str(path)!r}))
open_source(task.source, enable_autoexec=task.options.enable_autoexec)
leave(0)
"""
    done = run([sys.executable, "-c", script])
    assert done.returncode == 0, done.stderr
    assert bool(list(traps.iterdir())) == allowed


def test_background_process_runs_no_scripts_by_itself(blend, traps, tmp_path):
    options = JobOptions(tmp_path / "out", Settings.preset("draft"), resolution=(16, 9), samples=1, fill=0)
    task = RenderTask(blend, "Closed Room", "ViewLayer", options, scripts_denied=True)
    write_render_task(task, tmp_path / "task.json")
    with subprocess.Popen(
        ssgi_command("", COMMAND, str(tmp_path / "task.json")), env=environment(), stdin=subprocess.PIPE,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process:  # fmt: skip
        told = process.stdout.read()  # not `communicate`, which closes the input
    assert process.returncode == 0, told
    assert list(traps.iterdir()) == []


# --- Names and paths --------------------------------------------------------------------------------------


def odd_scene():
    """Everything that has a name has an odd one, and all that may name a file names one elsewhere."""
    scene = build_closed_room()
    scene.name = ODD
    scene.view_layers[0].name = ODD
    for owner in (*bpy.data.objects, *bpy.data.materials, *bpy.data.cameras, *bpy.data.worlds):
        owner.name = ODD
    return scene


def add_file_output(scene, folder):
    """Let the compositor of a scene write pictures into a folder."""
    from ssgi_addon.blender import compat

    scene.render.use_compositing = True
    tree, outputs = compat.new_compositor_tree(scene)
    source, node = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeOutputFile")
    tree.links.new(outputs[0], source.outputs[0])
    if bpy.app.version >= (5, 0, 0):
        node.directory, node.file_name = str(folder), "stolen"
        node.file_output_items.new("RGBA", "Image")
    else:
        node.base_path = str(folder)
    tree.links.new(node.inputs[0], source.outputs[0])


def test_names_of_the_file_lead_nowhere_and_print_nothing_odd(empty_file, tmp_path):
    scene = odd_scene()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    scene.render.filepath = str(elsewhere / "render")
    add_file_output(scene, elsewhere)
    blend = tmp_path / "in" / "..\x1b[31m {0}%s\nCON.blend"
    blend.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    output = tmp_path / "out"
    done = render(blend, output, "--compare", "--reference-samples", "1", "--passes")
    assert done.returncode == 0, done.stderr
    said = ours(done.stdout + done.stderr)
    assert any("results: " in line for line in said)
    assert all(line.isprintable() for line in said)
    assert list(elsewhere.iterdir()) == []
    assert sorted(os.listdir(tmp_path)) == ["elsewhere", "in", "out"]
    assert sorted(path.name for path in output.glob("*.exr")) == [
        blend.name.removesuffix(".blend") + "_0001.exr"
    ]
    json.loads((output / "report.json").read_text())
    again = run([sys.executable, "-m", "ssgi_addon", "apply", next((output / "passes").glob("*01.exr")),
                 "--output", tmp_path / "b.exr"])  # fmt: skip
    assert again.returncode == 0, again.stderr


def ours(text):
    """Lines of our own: Blender prints names as they are."""
    begins = ("ssgi", "frame", "results", "note")
    return [line for line in text.split("\n") if line.startswith(begins) or line[:4].strip().endswith("%")]


def test_error_about_an_odd_name_is_one_clear_line(empty_file, tmp_path):
    scene = odd_scene()
    scene.camera = None
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"), copy=True)
    done = render(tmp_path / "room.blend", tmp_path / "out")
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.split("\n") if line.startswith("ssgi")]
    assert line.isprintable()
    assert "has no camera" in line
    assert "\\x1b" in line


def test_name_that_is_too_long_for_its_results_is_refused_at_once(empty_file, tmp_path):
    build_closed_room()
    blend = tmp_path / f"{'x' * 244}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    with pytest.raises(SSGIError, match="too long for a file: save the scene under a shorter name"):
        run_job(blend, replace(JobOptions(tmp_path / "out"), resolution=(16, 9)))
    assert not (tmp_path / "out").exists()
