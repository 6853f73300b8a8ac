# SPDX-License-Identifier: GPL-3.0-or-later
"""The manifest of a finished frame: what it was made with, by which machine, and a few samples of it.

It is written last. So a frame with a manifest is whole, and frames that many machines rendered are told apart
and gathered by their manifests alone, without a look into the large files.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from .camera_file import camera_to_json
from .core import Camera
from .errors import SSGIError
from .files import read_json, write_json
from .recipe import Recipe, recipe_hash

#: Folder of the manifests, in that of the results.
FOLDER = "frames"
FORMAT, VERSION = "ssgi-frame", 1


def manifest_path(output: Path, name: str, frame: int) -> Path:
    """Return where the manifest of a frame of the scene `name` lies."""
    return manifest_of(output, stem(name, frame))


def manifest_of(output: Path, files: str) -> Path:
    """Return where the manifest of the frame lies whose files are called `files`, but for their endings."""
    return output / FOLDER / f"{files}.json"


def stem(name: str, frame: int) -> str:
    """Return what the files of a frame are called but for their endings."""
    return f"{name}_{frame:04d}"


def write_manifest(
    output: Path,
    name: str,
    record: Mapping[str, Any],
    camera: Camera,
    recipe: Recipe,
    versions: Mapping[str, str],
) -> None:
    """Write the manifest of a frame whose other files are there.

    Parameters
    ----------
    output, name
        Folder of the results, and the name of the scene file.
    record
        The frame's entry in the report.
    camera
        Of the samples beside the manifest.
    recipe
        What decided the picture.
    versions
        Of all programs, also of those that decide nothing.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    told = _told(name, record["frame"], recipe, versions)
    rest = {"camera": camera_to_json(camera), "record": dict(record), "failure": None}
    write_json(manifest_path(output, name, record["frame"]), {**told, **rest})


def write_failure(
    output: Path, name: str, frame: int, reason: str, recipe: Recipe, versions: Mapping[str, str]
) -> None:
    """Write the manifest of a frame that failed, unless an earlier run has finished it.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    path = manifest_path(output, name, frame)
    if read_manifest(path).get("record") is None:
        told = _told(name, frame, recipe, versions)
        write_json(path, {**told, "camera": None, "record": None, "failure": reason})


def read_manifest(path: Path) -> dict[str, Any]:
    """Read a manifest; nothing where there is none, or it is damaged or of another version."""
    try:
        data = read_json(path)
    except SSGIError:
        return {}
    is_ours = isinstance(data, dict) and (data.get("format"), data.get("version")) == (FORMAT, VERSION)
    return data if is_ours else {}


def _told(name: str, frame: int, recipe: Recipe, versions: Mapping[str, str]) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": name,
        "frame": frame,
        "machine": platform.node(),
        "process": _process(),
        "finished": _text(datetime.now(UTC)),
        "versions": dict(versions),
        "settings_hash": recipe_hash(recipe),
        "settings": dict(recipe),
        "shot": recipe.get("shot"),
    }


@cache
def _process() -> dict[str, Any]:
    """Return what tells this process from all others, and when it began."""
    started = datetime.fromtimestamp(time.time() - _seconds_running(), UTC)
    return {"id": f"{platform.node()}-{os.getpid()}-{int(started.timestamp())}", "started": _text(started)}


def _seconds_running() -> float:
    """Return the age of this process; 0 where the system does not tell."""
    try:
        began = float(
            Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]
        )  # proc(5): starttime
        return float(Path("/proc/uptime").read_text().split()[0]) - began / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return 0.0


def _text(moment: datetime) -> str:
    return moment.isoformat(timespec="milliseconds")
