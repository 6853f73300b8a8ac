# SPDX-License-Identifier: GPL-3.0-or-later
"""Results that an earlier run left in the folder of a job: refused, or kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .errors import SSGIError
from .files import read_json
from .job_options import JobOptions
from .results import check_writable

Record = dict[str, Any]

SKIPPED = {"what": "frame", "why": "its result was there already"}


def check_output(options: JobOptions, stems: Mapping[int, str]) -> None:
    """Find out before hours of work whether the results can be written.

    Parameters
    ----------
    options
        Folder and frames; with `overwrite` or `resume` earlier results are no reason to refuse.
    stems
        Names of the files of each frame, without their endings.

    Raises
    ------
    SSGIError
        If the folder cannot be written, or holds results that must not be replaced.
    """
    check_writable(options.output)
    if options.overwrite or options.resume:
        return
    for stem in stems.values():
        path = options.output / f"{stem}.exr"
        if path.exists():
            raise SSGIError(
                f"{path} is there already: switch Overwrite on (--overwrite), skip it (--resume), or "
                "choose another folder"
            )


def finished_frames(options: JobOptions, stems: Mapping[int, str]) -> dict[int, Record]:
    """Return the entries in the report of the frames that `resume` skips.

    An entry is that of the run which rendered the frame, where its report is still there.
    """
    if options.overwrite or not options.resume:
        return {}
    last = "_compare.png" if options.compare else ".exr"  # what is written last of a frame
    done = [frame for frame, stem in stems.items() if (options.output / f"{stem}{last}").exists()]
    earlier = _earlier_records(options.output / "report.json") if done else {}
    return {frame: _skipped(earlier.get(frame), frame) for frame in done}


def was_skipped(record: Record) -> bool:
    """Whether a frame's entry in the report says that the run did not render it."""
    return SKIPPED in record.get("skipped", ())


def _earlier_records(path: Path) -> dict[int, Record]:
    """Read the entries of a report; none where it is gone or damaged, for the pictures are what counts."""
    try:
        return {record["frame"]: record for record in read_json(path)["frames"] if record["seconds"]}
    except (SSGIError, KeyError, TypeError):
        return {}


def _skipped(record: Record | None, frame: int) -> Record:
    record = record or {"frame": frame, "seconds": {}, "peak_memory_mb": None, "metrics": None}
    others = [entry for entry in record.get("skipped", ()) if entry != SKIPPED]
    return {**record, "skipped": [*others, SKIPPED]}
