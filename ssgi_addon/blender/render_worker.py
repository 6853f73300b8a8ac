# SPDX-License-Identifier: GPL-3.0-or-later
"""The background process of the window: render a saved copy of the file, tell how far it is."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
from pathlib import Path
from typing import NoReturn

import bpy

from ..child import ended_with_parent
from ..errors import SSGIError
from ..files import discard_unfinished
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
    atexit.register(_end, 1)  # after an error
    task = read_task(task_path)

    def clean() -> None:
        discard_unfinished(task.options.output, os.getpid())
        shutil.rmtree(task.blend.parent, ignore_errors=True)

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
    _end(0)


def _end(status: int) -> NoReturn:
    """End at once: how Blender itself ends must change nothing, and 4.5 as a module may wait for ever."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
