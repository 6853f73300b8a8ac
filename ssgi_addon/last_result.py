# SPDX-License-Identifier: GPL-3.0-or-later
"""What lies beside a result file: the reference of its comparison, and its entry in the report."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from .errors import SSGIError
from .files import read_json

REFERENCE_FOLDER = "reference"
# What reports call the captures that switches of `JobOptions` stand for.
_REPORTED = {"light_views": "lights", "back_faces": "back faces"}


def reference_path(result: Path) -> Path:
    """Return where the reference of a result is, if it was compared."""
    return result.parent / REFERENCE_FOLDER / result.name


def modified(path: Path) -> int | None:
    """Return when a file was written last, nanoseconds; None if there is none."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None


def frame_record(result: Path) -> dict[str, Any] | None:
    """Return a result's entry in the ``report.json`` beside it, None where there is none.

    Panels ask at every redraw: the file is read again only when it has been written since.
    """
    report = result.parent / "report.json"
    written = modified(report)
    frames = () if written is None else _frames(report, written)
    number = result.stem.rpartition("_")[2]
    if not number.isdecimal():
        return None
    return next((record for record in frames if record["frame"] == int(number)), None)


def reasons_skipped(record: dict[str, Any] | None, switch: str) -> list[str]:
    """Return why a frame was rendered without what a switch asks for, as its entry in the report says."""
    if record is None:
        return []
    name = _REPORTED.get(switch, switch)
    return [
        note["why"]
        for note in record.get("skipped", ())
        if any(part == name or part.endswith(f" {name}") for part in note["what"].split(", "))
    ]


@lru_cache(maxsize=4)
def _frames(report: Path, _written: int) -> tuple[dict[str, Any], ...]:
    """Return the frames of a report; none where it is not one of ours."""
    try:
        return tuple(record for record in read_json(report)["frames"] if "frame" in record)
    except (SSGIError, KeyError, TypeError):
        return ()
