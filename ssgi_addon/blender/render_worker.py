# SPDX-License-Identifier: GPL-3.0-or-later
"""The background process of the window: render a saved copy of the file, tell how far it is."""

from __future__ import annotations

import atexit
import os
from pathlib import Path
from typing import NoReturn

import bpy

from ..bpy_module import end_at_once
from ..child import ended_with_parent
from ..errors import SSGIError
from ..files import discard_folder, discard_unfinished, stop_writing
from ..progress import tell
from ..render_task import read_task
from .job import render_frames
from .scene_file import open_scene

# Steps towards less important: the window comes first where cores are few.
_NICENESS = 5


def work(task_path: Path) -> NoReturn:
    """Do a task, and end the process.

    Raises
    ------
    SSGIError
        If the copy cannot be opened or rendered as in the window, or a result cannot be written.
    """
    # How Blender itself ends must change nothing: also after an error
    atexit.register(end_at_once, 1)
    task = read_task(task_path)

    def clean() -> None:
        stop_writing()
        discard_unfinished(task.options.output, os.getpid())
        discard_folder(task.blend.parent)

    with ended_with_parent(clean):
        if hasattr(os, "nice"):
            os.nice(_NICENESS)
        tell(0.0, "Opening")
        open_scene(task.blend)
        scene = bpy.data.scenes[task.scene]
        bpy.context.window.scene = scene
        bpy.context.window.view_layer = scene.view_layers[task.view_layer]
        bpy.context.view_layer.update()
        if bpy.app.autoexec_fail and not task.scripts_denied:
            raise SSGIError(
                "this file's scripts or drivers run in the window but may not in the background: switch on "
                "Auto Run Python Scripts in the preferences (Save & Load)"
            )
        render_frames(scene, task.options, tell)
    end_at_once(0)
