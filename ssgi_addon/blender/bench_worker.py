# SPDX-License-Identifier: GPL-3.0-or-later
"""One process of the benchmark: open a scene, do what the task says, keep the result in a file."""

from __future__ import annotations

import time
from pathlib import Path

import bpy

from ..bench.options import SceneSource
from ..bench.store import load_scene, scene_folder
from ..bench.tasks import Task, read_task
from ..child import ended_with_parent
from ..files import write_json
from ..progress import tell
from ..results import peak_memory_mb
from . import demo_scene
from .bench_renders import borrow_unbiased, run_method
from .bench_scene import SceneBench
from .render_settings import borrow_scene
from .restore import Restorer
from .scene_file import open_scene


def work(task_path: Path) -> None:
    """Do a task; end if the process that waits for it does.

    Raises
    ------
    SSGIError
        If the scene cannot be opened or rendered, or a result cannot be written.
    """
    with ended_with_parent(lambda: None):
        _work(task_path)


def _work(task_path: Path) -> None:
    task = read_task(task_path)
    scene = open_source(task.source, enable_autoexec=task.options.enable_autoexec)
    if task.kind == "cold":
        _measure_cold(scene, task, task_path.with_name("cold.json"))
        return
    state = load_scene(scene_folder(task.options, task.source.name), task.source)
    if task.kind == "flicker":
        from .bench_flicker import measure_flicker

        measure_flicker(scene, task, state, tell)
    else:
        SceneBench(scene, task.options, task.methods(), state, task.deadline, tell).measure()


def open_source(source: SceneSource, *, enable_autoexec: bool = False) -> bpy.types.Scene:
    """Open a scene's file, as in `open_scene`, or build the demo.

    Raises
    ------
    SSGIError
        If the file cannot be opened.
    """
    if source.path is not None:
        open_scene(source.path, enable_autoexec=enable_autoexec)
        return bpy.context.scene
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = demo_scene.build_demo_scene()
    bpy.context.window.scene = scene
    return scene


def _measure_cold(scene: bpy.types.Scene, task: Task, path: Path) -> None:
    """Time the first and only picture of a process, from the open file."""
    method = next(method for method in task.methods() if method.name == task.method)
    with Restorer() as restorer:
        borrow_scene(restorer, scene, resolution=task.options.resolution)
        borrow_unbiased(restorer, scene)
        begun = time.perf_counter()
        run_method(scene, method, task.options.resolution)
        seconds = time.perf_counter() - begun
    write_json(path, {"seconds": seconds, "memory_mb": peak_memory_mb()})
