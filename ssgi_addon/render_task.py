# SPDX-License-Identifier: GPL-3.0-or-later
"""What the background process of the window is asked to render."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from .files import read_json, write_json
from .job_options import JobOptions
from .passes import settings_from_json, settings_to_json

COMMAND = "render-worker"


@dataclass(frozen=True)
class RenderTask:
    """A job on a saved copy of a file.

    Attributes
    ----------
    blend
        The copy. Its folder is the task's own: it goes when the task ends.
    scene, view_layer
        Names of what to render.
    options
        What to render, and where to write it.
    scripts_denied
        The file's scripts or drivers may not run in the window either.
    """

    blend: Path
    scene: str
    view_layer: str
    options: JobOptions
    scripts_denied: bool = False


def write_task(task: RenderTask, path: Path) -> None:
    """Write a task for `read_task`."""
    options = {item.name: _plain(getattr(task.options, item.name)) for item in fields(JobOptions)}
    options["settings"] = settings_to_json(task.options.settings)
    data = {item.name: _plain(getattr(task, item.name)) for item in fields(RenderTask)}
    write_json(path, {**data, "options": options})


def read_task(path: Path) -> RenderTask:
    """Read what `write_task` wrote."""
    data = read_json(path)
    options = {
        name: tuple(value) if isinstance(value, list) else value for name, value in data["options"].items()
    }
    options["output"] = Path(options["output"])
    options["shot"] = options["shot"] and Path(options["shot"])
    options["settings"] = settings_from_json(options["settings"])
    return RenderTask(**{**data, "blend": Path(data["blend"]), "options": JobOptions(**options)})


def _plain(value: Any) -> Any:
    return str(value.absolute()) if isinstance(value, Path) else value
