# SPDX-License-Identifier: GPL-3.0-or-later
"""Open .blend files, trusted or not: their scripts can do whatever their user can."""

from __future__ import annotations

import hashlib
import itertools
import os
import sys
from pathlib import Path

import bpy

from ..errors import SSGIError


def open_scene(path: Path, *, enable_autoexec: bool = False) -> None:
    """Open a .blend file.

    Parameters
    ----------
    path
        The file.
    enable_autoexec
        Run its scripts and drivers. Else they run where this Blender was told to run those of all files;
        Blender as a Python module does not look for that.

    Raises
    ------
    SSGIError
        If it is missing or is not a file that this Blender reads.
    """
    if not path.is_file():
        raise SSGIError(f"there is no scene {path}: check the path")
    try:
        bpy.ops.wm.open_mainfile(
            filepath=str(path.resolve()),
            load_ui=False,
            use_scripts=enable_autoexec or (not bpy.app.module and scripts_may_run()),
        )
    except RuntimeError as error:
        reason = str(error).strip().removeprefix("Error: ")
        raise SSGIError(
            f"cannot open {path}: {reason}; give a .blend file that Blender {bpy.app.version_string} reads"
        ) from error


def opened_scene(path: Path | None, *, enable_autoexec: bool = False) -> bpy.types.Scene:
    """Return the scene that a command renders: of a file, or with None the open one.

    Parameters and errors are those of `open_scene`.
    """
    if path is None:
        _refuse_unread_file()
    else:
        open_scene(path, enable_autoexec=enable_autoexec)
    return bpy.context.scene


def _refuse_unread_file() -> None:
    """Raise where Blender went on with an empty file, for it could not read the one it was started with."""
    own_arguments = itertools.takewhile(lambda text: text not in ("-c", "--command"), sys.argv[1:])
    named = [text for text in own_arguments if text.endswith(".blend")]
    if named and not bpy.data.filepath:
        raise SSGIError(f"Blender could not open {named[-1]}: check the path")


def content_hash() -> str | None:
    """Return a hash of the open file and of those that it names; None where it was never saved.

    Of the file itself and of its libraries all bytes count, of textures, caches and the like the sizes: they
    may be many and large. Where they lie never counts.
    """
    if not bpy.data.filepath:
        return None
    libraries = {bpy.path.abspath(item.filepath) for item in bpy.data.libraries}
    others = set(bpy.utils.blend_paths(absolute=True, packed=False, local=False)) - libraries
    told = [sorted(_bytes_hash(path) for path in libraries), sorted(_name_and_size(path) for path in others)]
    digest = hashlib.blake2b(repr([_bytes_hash(bpy.data.filepath), *told]).encode(), digest_size=8)
    return digest.hexdigest()


def _bytes_hash(path: str) -> str:
    """Return a hash of a file; of one that is not there, too, for Blender itself goes on without it."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "blake2b").hexdigest()
    except OSError:
        return ""


def _name_and_size(path: str) -> tuple[str, int]:
    return os.path.basename(path), os.path.getsize(path) if os.path.isfile(path) else -1


def scripts_may_run() -> bool:
    """Whether this Blender was told, by option or preference, to run scripts of the files that it opens."""
    own = list(itertools.takewhile(lambda text: text not in ("--", "-c", "--command"), sys.argv[1:]))
    for argument in reversed(own):
        if argument in ("-y", "--enable-autoexec"):
            return True
        if argument in ("-Y", "--disable-autoexec"):
            return False
    return bool(bpy.context.preferences.filepaths.use_scripts_auto_execute)


def denied_scripts() -> tuple[str, ...]:
    """Return a sentence for the report where scripts or drivers of the open file did not run."""
    if not bpy.app.autoexec_fail:
        return ()
    return (
        f"Scripts or drivers of this file did not run ({bpy.app.autoexec_fail_message}). If you trust it, "
        "allow them with --enable-autoexec, or with Auto Run Python Scripts in Blender's preferences.",
    )
