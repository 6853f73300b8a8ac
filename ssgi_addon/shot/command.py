# SPDX-License-Identifier: GPL-3.0-or-later
"""The command ``merge`` of the command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..arguments import add_progress, frame_list
from ..bpy_module import require_bpy
from ..errors import SSGIError
from ..files import check_writable, discard, discard_abandoned, replacing, write_json
from ..progress import Progress, printable
from .flicker import measure_flicker
from .lines import problems, summary_lines
from .manifests import read_shot
from .page import page_of
from .report import Report, all_frames, build_report, finished_of

REPORT, PAGE, PICTURE = "shot_report.json", "shot_report.html", "shot_report.png"


@dataclass(frozen=True)
class Merged:
    """The report of a shot, and where it was written; `picture` is None where there is none, and why."""

    report: Report
    page: Path
    picture: Path | None
    no_picture: str = ""


def add_merge(commands: Any) -> None:
    """Add the command to the subparsers of the command line; ``run`` of the result does the work."""
    parser = commands.add_parser(
        "merge", help="gather what many machines rendered of a shot into one report; needs no Blender"
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="the folder that ssgi render wrote to")
    parser.add_argument(
        "--frames",
        metavar="FRAMES",
        type=frame_list,
        help="the frames that should be there (default: those that are)",
    )
    parser.add_argument(
        "--name",
        metavar="STEM",
        help="the scene, where the folder holds frames of several",
    )
    add_progress(parser)
    parser.set_defaults(run=_merge)


def merge(
    folder: Path,
    expected: Sequence[int] | None,
    name: str | None,
    progress: Progress | None = None,
    *,
    draws: bool = True,
) -> Merged:
    """Gather the manifests of a folder to a report, a page and, where Blender is there, a picture.

    Parameters
    ----------
    folder
        Of the results; the reports are written there.
    expected
        Frames that should be there; None means those that are.
    name
        Of the scene; None means the only one that is there.
    progress
        Called with a fraction and a text.
    draws
        Off: no picture.

    Raises
    ------
    SSGIError
        If there is no frame, several scenes are there and none is named, or a report cannot be written.
    """
    check_writable(folder)
    discard_abandoned(folder)
    shot = read_shot(folder, name)
    frames = all_frames(shot, expected)
    flicker, unread = measure_flicker(folder, finished_of(shot, frames), frames, progress)
    if progress is not None:
        progress(0.9, "Writing")
    report = build_report(shot, expected, flicker, unread)
    write_json(folder / REPORT, report)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(page_of(report, folder), encoding="utf-8", errors="replace")
    why = _draw(folder, report) if draws else "it was not asked for"
    return Merged(report, folder / PAGE, None if why else folder / PICTURE, why)


def _draw(folder: Path, report: Report) -> str:
    """Draw the picture, or return why that does not work here."""
    try:
        require_bpy()
    except SSGIError as error:
        # What an earlier merge drew would show other frames
        discard(folder / PICTURE)
        return str(error)
    from ..blender.shot_picture import write_shot_picture

    write_shot_picture(folder / PICTURE, report, folder)
    return ""


def _merge(arguments: argparse.Namespace, progress: Progress) -> None:
    merged = merge(arguments.folder, arguments.frames, arguments.name, progress)
    progress.close()
    for line in summary_lines(merged.report):
        print(printable(line))
    print(f"report: {printable(arguments.folder / REPORT)}")
    print(f"page: {printable(merged.page)}")
    print(f"picture: {printable(merged.picture or f'left out: {merged.no_picture}')}")
    found = problems(merged.report)
    if found:
        raise SSGIError(f"the shot is not whole: {'; '.join(found)}")
