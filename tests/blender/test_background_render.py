# SPDX-License-Identifier: GPL-3.0-or-later
"""A render in the background: the same picture, the open file as it was, nothing left over at any end."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.blender.background import BackgroundRender, blender_options
from ssgi_addon.blender.job import render_frames
from ssgi_addon.child import environment, ssgi_command
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers
from ssgi_addon.progress import understand
from ssgi_addon.render_task import COMMAND, RenderTask, write_task
from tests.blender.extension_fixtures import installed_extension  # noqa: F401  (a fixture)
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.small_jobs import small_job
from tests.scenes import build_closed_room

# Seconds after which what a test waits for counts as never coming
PATIENCE = 100.0


@pytest.fixture
def room(empty_file):
    return build_closed_room()


@pytest.fixture
def options(tmp_path):
    return small_job(tmp_path / "results", frames=(1,), back_faces=False)


@pytest.fixture
def start(tmp_path):
    """Start a render in a process of this Python; none outlives the test."""
    renders = []

    def begin(scene, options):
        renders.append(BackgroundRender(scene, scene.view_layers[0], options, tmp_path / "cache", blender=""))
        return renders[-1]

    yield begin
    for render in renders:
        render.close()


def wait_for_the_end(render, until=lambda: False):
    end = time.monotonic() + PATIENCE
    while not render.update() and not until():
        assert time.monotonic() < end, "never came"
        time.sleep(0.01)


def files_below(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


# --- How it ends ------------------------------------------------------------------------------------------


def test_picture_is_that_of_this_process_and_the_file_as_before(room, options, start, tmp_path):
    here = replace(options, output=tmp_path / "here")
    render_frames(room, here)
    before = fingerprint()
    was_dirty = bpy.data.is_dirty
    preferences = bpy.context.preferences
    preferred = preferences.filepaths.file_preview_type, preferences.is_dirty
    render = start(room, options)
    wait_for_the_end(render)
    assert render.failure() is None
    assert (render.fraction, render.text) == (1.0, "Done")
    render.close()
    assert changes(before, fingerprint()) == {}
    assert (bpy.data.filepath, bpy.data.is_dirty) == ("", was_dirty)
    assert (preferences.filepaths.file_preview_type, preferences.is_dirty) == preferred
    assert files_below(tmp_path / "cache") == []
    assert files_below(options.output) == files_below(here.output)
    expected = read_layers(here.output / "untitled_0001.exr")
    found = read_layers(render.result)
    assert found.keys() == expected.keys()
    for name, layer in expected.items():
        assert np.array_equal(found[name], layer), name


def test_error_of_the_process_is_its_reason(room, options, start, tmp_path):
    room.camera = None
    before = fingerprint()
    render = start(room, options)
    wait_for_the_end(render)
    assert "camera" in render.failure()
    render.close()
    assert changes(before, fingerprint()) == {}
    assert files_below(tmp_path) == []


def test_cancelled_render_leaves_finished_frames_alone(room, options, start, tmp_path):
    """Cancelled while the second frame is at work."""
    before = fingerprint()
    first = options.output / "untitled_0001.exr"
    render = start(room, replace(options, frames=tuple(range(1, 200))))
    wait_for_the_end(render, first.exists)
    wait_for_the_end(render, lambda: render.text != "Writing")
    render.close()
    assert changes(before, fingerprint()) == {}
    assert files_below(tmp_path / "cache") == []
    left = files_below(options.output)
    assert "untitled_0001.exr" in left
    assert not [name for name in left if name.endswith(".tmp")]
    read_layers(first)


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(("number", "reason"), [("SIGKILL", "killed"), ("SIGSEGV", "crashed (SIGSEGV)")])
def test_killed_process_costs_nothing(room, options, start, tmp_path, number, reason):
    options.output.mkdir()
    (options.output / "untitled_0001.exr").write_bytes(b"old")
    before = fingerprint()
    render = start(room, replace(options, frames=tuple(range(1, 200)), overwrite=True))
    wait_for_the_end(render, lambda: render.text == "Direct light" or render.fraction > 0.0)
    os.kill(render.pid, getattr(signal, number))
    wait_for_the_end(render)
    assert reason in render.failure()
    render.close()
    assert changes(before, fingerprint()) == {}
    assert set(files_below(tmp_path / "cache")) <= {"last_crash.txt"}
    assert files_below(options.output) == ["untitled_0001.exr"]
    assert (options.output / "untitled_0001.exr").read_bytes() == b"old"


def test_process_ends_and_cleans_up_when_nobody_listens_any_more(room, options, tmp_path):
    """Its standard input closes, as when the process that started it dies."""
    cache = tmp_path / "cache"
    cache.mkdir()
    copy, task = cache / "room.blend", cache / "task.json"
    bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True)
    many = replace(options, frames=tuple(range(1, 200)))
    write_task(RenderTask(copy, room.name, room.view_layers[0].name, many), task)
    with subprocess.Popen(
        ssgi_command("", COMMAND, str(task)),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment(),
    ) as process:  # fmt: skip
        for line in process.stdout:
            if (told := understand(line)) and told[0] > 0.0:
                break
        process.stdin.close()
        process.stdout.read()
    assert process.returncode == 1
    assert not cache.exists()
    assert not [name for name in files_below(options.output) if name.endswith(".tmp")]


# --- What it renders --------------------------------------------------------------------------------------


def test_scene_and_view_layer_are_those_of_the_window(room, options, start):
    """The file's first scene has no camera, and the room's first view layer shows nothing."""
    bpy.context.window.scene = bpy.data.scenes.new("A")
    room.view_layers[0].layer_collection.exclude = True
    shown = room.view_layers.new("shown")
    render = BackgroundRender(room, shown, options, options.output.parent / "cache", blender="")
    wait_for_the_end(render)
    assert render.failure() is None
    render.close()
    assert read_layers(render.result)["albedo"].any()


def test_relative_paths_lead_where_they_led(room, options, start, tmp_path):
    (tmp_path / "textures").mkdir()
    image = bpy.data.images.new("Wood", 2, 2)
    image.filepath_raw, image.file_format = str(tmp_path / "textures" / "wood.png"), "PNG"
    image.save()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    image.filepath = "//textures/wood.png"
    image.use_fake_user = True
    start(room, options)
    assert image.filepath == "//textures/wood.png"
    (copy,) = (tmp_path / "cache").glob("ssgi-*/room.blend")
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    found = Path(bpy.path.abspath(bpy.data.images["Wood"].filepath)).resolve()
    assert found == (tmp_path / "textures" / "wood.png").resolve()


@pytest.mark.parametrize("is_denied_here", [True, False])
def test_drivers_that_run_in_the_window_alone_are_an_error(room, options, tmp_path, is_denied_here):
    """Denied in both, the picture is the same."""
    room.objects[0].driver_add("location", 0).driver.expression = "bpy.app.version[0]"
    copy, task = tmp_path / "room.blend", tmp_path / "task.json"
    bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True)
    write_task(RenderTask(copy, room.name, room.view_layers[0].name, options, is_denied_here), task)
    command = ssgi_command("", COMMAND, str(task))
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(),
    ) as process:  # fmt: skip
        # Not `communicate`, which closes the input
        told = process.stderr.read()
    assert ("may not in the background" in told) != is_denied_here
    assert (process.returncode == 0) == is_denied_here


def test_images_with_unsaved_changes_are_refused_by_name(room, options, start, tmp_path):
    bpy.data.images.new("untouched", 2, 2)
    for name in ("Wood", "Dirt"):
        bpy.data.images.new(name, 2, 2).pixels[0] = 0.5
    with pytest.raises(SSGIError, match="unsaved changes .*'Dirt', 'Wood'. Save or pack them"):
        start(room, options)
    assert files_below(tmp_path) == []
    for name in ("Wood", "Dirt"):
        bpy.data.images[name].pack()
    start(room, options)


def test_what_cannot_be_written_is_refused_before_a_process_starts(room, options, start, read_only_folder):
    with pytest.raises(SSGIError, match="cannot write"):
        start(room, replace(options, output=read_only_folder))
    with pytest.raises(SSGIError, match="cannot write"):
        BackgroundRender(room, room.view_layers[0], options, read_only_folder, blender="")
    options.output.mkdir()
    (options.output / "untitled_0001.exr").touch()
    with pytest.raises(SSGIError, match="is there already"):
        start(room, options)


def test_program_that_does_not_start_leaves_nothing(room, options, tmp_path):
    cache = tmp_path / "cache"
    with pytest.raises(SSGIError, match="cannot start a background Blender: No such file"):
        BackgroundRender(room, room.view_layers[0], options, cache, blender=str(tmp_path / "blender"))
    assert files_below(tmp_path) == []


def test_shown_result_is_of_the_current_frame_or_the_last(room, options, start):
    room.frame_set(2)
    assert start(room, replace(options, frames=(1, 2, 3))).result.name == "untitled_0002.exr"
    assert start(room, replace(options, frames=(3, 5))).result.name == "untitled_0005.exr"


# --- The other Blender is like this one -------------------------------------------------------------------


def test_other_blender_has_the_add_ons_and_threads_of_this_one(empty_file):
    options = blender_options(None)
    assert "cycles" in options[options.index("--addons") + 1].split(",")
    assert "--factory-startup" not in options
    assert "--threads" not in options
    options = blender_options(3)
    assert options[options.index("--threads") + 1] == "3"


def test_scripts_run_there_only_if_they_may_run_here(empty_file):
    filepaths = bpy.context.preferences.filepaths
    before = filepaths.use_scripts_auto_execute
    try:
        filepaths.use_scripts_auto_execute = True
        assert "--enable-autoexec" in blender_options(None)
        filepaths.use_scripts_auto_execute = False
        assert "--disable-autoexec" in blender_options(None)
    finally:
        filepaths.use_scripts_auto_execute = before


# --- The operators of the installed extension -------------------------------------------------------------


def test_animation_skips_what_is_there_unless_it_may_replace_it(extension, tmp_path):
    script = """
scene = make_scene()
scene.frame_start, scene.frame_end, scene.frame_step = 1, 3, 2
scene.ssgi.output = str(out / "frames")
done = [sorted(bpy.ops.ssgi.render(animation=True))]
names = sorted(path.name for path in (out / "frames").glob("*.exr"))
def times():
    return [path.stat().st_mtime_ns for path in sorted((out / "frames").glob("*.exr"))]
first = times()
scene.ssgi.overwrite = False
done.append(sorted(bpy.ops.ssgi.render(animation=True)))
second = times()
scene.ssgi.overwrite = True
done.append(sorted(bpy.ops.ssgi.render(animation=True)))
replaced = not set(second) & set(times())
result = [done, names, first == second, replaced, Path(scene.ssgi.result).name]
"""
    finished = [["FINISHED"]] * 3
    names = ["untitled_0001.exr", "untitled_0003.exr"]
    assert extension.run(script, tmp_path) == [finished, names, True, True, names[0]]


def test_one_render_at_a_time_and_cancel_ends_it(extension, tmp_path):
    script = """
from bl_ext.user_default.ssgi.ssgi_addon.blender import background
class Render:
    closed = False
    def close(self):
        self.closed = True
scene = make_scene()
result = [bpy.ops.ssgi.cancel_render.poll()]
render = Render()
background.start(render)
try:
    bpy.ops.ssgi.render()
except RuntimeError as error:
    result.append(str(error))
result += [sorted(bpy.ops.ssgi.cancel_render()), render.closed, bpy.ops.ssgi.render.poll()]
"""
    first, message, *rest = extension.run(script, tmp_path)
    assert not first
    assert "A render runs in the background" in message
    assert rest == [["FINISHED"], True, True]


def test_progress_takes_the_place_of_the_second_button(extension, tmp_path):
    script = """
from bl_ext.user_default.ssgi.ssgi_addon import progress_panel
from bl_ext.user_default.ssgi.ssgi_addon.blender import background
class Layout:
    def __init__(self):
        self.drawn = []
    def operator(self, name, **_):
        getattr(bpy.ops.ssgi, name.partition(".")[2]).get_rna_type()
        self.drawn.append(name)
        return self
    def progress(self, factor, text):
        self.drawn.append([factor, text])
    def row(self, **_):
        return self
class Render:
    fraction, text = 0.25, "Direct light"
    def close(self): pass
result = []
for render in (None, Render()):
    background.stop()
    if render:
        background.start(render)
    layout = Layout()
    progress_panel.draw_render_buttons(layout)
    result.append(layout.drawn)
"""
    assert extension.run(script, tmp_path) == [
        ["ssgi.render", "ssgi.render"],
        ["ssgi.render", [0.25, "Direct light · 25%"], "ssgi.cancel_render"],
    ]


def test_without_a_blender_program_an_invoked_render_runs_here(extension, tmp_path):
    script = """
scene = make_scene()
result = [sorted(bpy.ops.ssgi.render("INVOKE_DEFAULT")), Path(scene.ssgi.result).is_file()]
"""
    assert extension.run(script, tmp_path) == [["FINISHED"], True]


def test_preferences_name_threads_and_a_cache_outside_the_extension(extension, tmp_path):
    script = """
from bl_ext.user_default.ssgi.ssgi_addon import preferences
own = bpy.context.preferences.addons["bl_ext.user_default.ssgi"].preferences
package = Path(preferences.__file__).parents[1]
default = preferences.cache_folder()
result = [default.is_relative_to(package), default.exists(), preferences.threads()]
own.threads, own.cache_folder = 3, str(out / "cache")
result += [preferences.threads(), preferences.cache_folder() == out / "cache"]
"""
    assert extension.run(script, tmp_path) == [False, False, None, 3, True]
