# SPDX-License-Identifier: GPL-3.0-or-later
"""Render in a background Blender on a saved copy of the open file, so that the window stays alive."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import bpy

from ..child import Child, environment, ssgi_command
from ..earlier_results import check_output
from ..errors import SSGIError
from ..files import check_writable, discard_unfinished, new_folder
from ..job_options import JobOptions
from ..render_task import COMMAND, RenderTask, write_task
from .job import shown_result
from .one_frame import frame_stems, made_with
from .restore import Restorer
from .scene_file import scripts_may_run

_running: BackgroundRender | None = None


class BackgroundRender:
    """A render in another process, of the file as it was when the render began.

    Parameters
    ----------
    scene, view_layer
        Of the open file; nothing in it changes.
    options
        What to render.
    cache
        Folder for the copy; what is written there is gone after `close`.
    blender
        The program that renders, with this extension; empty: this Python.
    threads
        Most threads that it uses; None means all.

    Attributes
    ----------
    scene_uid
        Identifies the scene as long as the file is open.
    result
        As of `job.shown_result`.
    fraction, text
        How much is done (0 to 1), and what is at hand.

    Raises
    ------
    SSGIError
        If the file cannot be copied as it is, the results could not be written, or no process starts.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        view_layer: bpy.types.ViewLayer,
        options: JobOptions,
        cache: Path,
        *,
        blender: str,
        threads: int | None = None,
    ) -> None:
        check_output(options, frame_stems(scene, options), made_with(scene, view_layer, options))
        _refuse_unsaved_images()
        self.scene_uid = scene.session_uid
        self.result = shown_result(scene, options)
        self.fraction, self.text = 0.0, "Starting"
        self._output = options.output
        self._folder = _new_folder(cache)
        try:
            copy = _save_copy(self._folder)
            task = self._folder / "task.json"
            names = scene.name, view_layer.name
            write_task(RenderTask(copy, *names, options, bpy.app.autoexec_fail), task)
            command = ssgi_command(blender, COMMAND, str(task), options=blender_options(threads))
            # What it writes into its temporary folder is gone with ours, also after a crash
            temporary = dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(self._folder))
            self._child = Child(command, environment(**temporary))
        except OSError as error:
            self._discard_folder()
            raise SSGIError(f"cannot start a background Blender: {error.strerror or error}") from error
        except BaseException:
            self._discard_folder()
            raise

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._child.pid

    def update(self) -> bool:
        """Take in what the process has told; return whether it has ended. Does not wait."""
        has_ended = self._child.has_ended()
        self.fraction, self.text = self._child.news() or (self.fraction, self.text)
        return has_ended

    def failure(self) -> str | None:
        """Return why it failed, once it has ended; None where it did not.

        Where Blender left a report of a crash, that is kept in the cache folder, in place of an older one.
        """
        failure = self._child.failure()
        for report in self._folder.glob("*.crash.txt"):
            kept = report.replace(self._folder.parent / "last_crash.txt")
            return f"{failure}; Blender's report: {kept}"
        return failure

    def close(self) -> None:
        """End the process if it still runs, and delete all that is not a whole result."""
        self._child.kill()
        discard_unfinished(self._output, self._child.pid)
        self._discard_folder()

    def _discard_folder(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)


def running() -> BackgroundRender | None:
    """Return the render that this Blender waits for; None where there is none."""
    return _running


def start(render: BackgroundRender) -> None:
    """Make a render the one that this Blender waits for."""
    global _running
    _running = render


def stop() -> None:
    """Wait for no render any more, and close the one that there was."""
    global _running
    if _running is not None:
        _running.close()
        _running = None


def find_blender() -> str:
    """Return the Blender program whose window this is; empty where there is no window or no program."""
    return "" if bpy.app.background else bpy.app.binary_path


def blender_options(threads: int | None) -> list[str]:
    """Return the arguments that make another Blender like this one: scripts, add-ons, threads.

    Scripts run only if they may run here: where they were allowed for this one file alone, they do not.
    """
    preferences = bpy.context.preferences
    is_allowed = scripts_may_run() and not bpy.app.autoexec_fail
    options = ["-noaudio", "--enable-autoexec" if is_allowed else "--disable-autoexec"]
    # Also those that are enabled for this session alone
    options += ["--addons", ",".join(addon.module for addon in preferences.addons)]
    if preferences.app_template:
        options += ["--app-template", preferences.app_template]
    if threads is not None:
        options += ["--threads", str(threads)]
    return options


def _refuse_unsaved_images() -> None:
    """Raise where a copy of the file would lack what was painted or computed into an image."""
    unsaved = [image.name_full for image in bpy.data.images if image.is_dirty and image.source != "VIEWER"]
    if unsaved:
        raise SSGIError(
            f"Images with unsaved changes cannot be rendered in the background: {_listed(unsaved)}. "
            "Save or pack them in the Image Editor (menu Image)"
        )


def _listed(names: Iterable[str], most: int = 5) -> str:
    names = sorted(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(f"'{name}'" for name in names[:most]) + more


def _new_folder(cache: Path) -> Path:
    check_writable(cache)
    cache.mkdir(parents=True, exist_ok=True)
    return new_folder(cache)


def _save_copy(folder: Path) -> Path:
    """Save the open file as a copy of the same name, whose relative paths lead where they led."""
    path = folder / (Path(bpy.data.filepath).name or "untitled.blend")
    preferences = bpy.context.preferences
    try:
        with Restorer() as restorer:
            restorer.callback(setattr, preferences, "is_dirty", preferences.is_dirty)
            # No preview of the scene: drawing it holds the window up (1.4 s of 1.5 s by software OpenGL)
            restorer.change(preferences.filepaths, file_preview_type="NONE")
            bpy.ops.wm.save_as_mainfile(
                filepath=str(path), copy=True, relative_remap=True, check_existing=False
            )
    except RuntimeError as error:
        reason = str(error).strip().removeprefix("Error: ")
        raise SSGIError(f"cannot save a copy of the file in {folder.parent}: {reason}") from error
    return path
