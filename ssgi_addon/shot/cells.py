# SPDX-License-Identifier: GPL-3.0-or-later
"""What a contact sheet shows of each frame, for the page and for the picture alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from ..arguments import frame_text
from ..tables import number
from .report import FINISHED, MISSING, Report, Row

#: What the worst frames by each figure are called.
MARKS = {
    "seconds": "slowest",
    "flicker": "most flicker",
    "error": "largest error",
    "known": "least known",
}


@dataclass(frozen=True)
class Cell:
    """One frame, or missing ones in a row.

    Attributes
    ----------
    title
        Its number.
    state
        As in the report.
    row
        Its entry there; of missing frames the first one's.
    figures
        Seconds, flicker and so on, as texts by what they are called.
    marks
        By which figures it is one of the worst, as texts.
    """

    title: str
    state: str
    row: Row
    figures: Mapping[str, str]
    marks: tuple[str, ...]

    @property
    def counts(self) -> bool:
        """Whether a choice of cells must hold it: something is wrong with it, or it is one of the worst."""
        return self.state != FINISHED or bool(self.marks)


def cells_of(report: Report) -> list[Cell]:
    """Return the cells of a shot in the frames' order; missing frames that follow one another share one."""
    marks = marks_of(report)
    cells = []
    for is_missing, group in groupby(report["frames"], key=lambda row: row["state"] == MISSING):
        rows = list(group)
        if is_missing:
            title = frame_text(row["frame"] for row in rows)
            cells.append(Cell(title, MISSING, rows[0], {}, ()))
        else:
            cells += [_cell(row, marks.get(row["frame"], ())) for row in rows]
    return cells


def marks_of(report: Report) -> dict[int, tuple[str, ...]]:
    """Return for each of the worst frames by which figures it is one."""
    found: dict[int, tuple[str, ...]] = {}
    for name, text in MARKS.items():
        for entry in report["worst"][name]:
            found[entry["frame"]] = (*found.get(entry["frame"], ()), text)
    return found


def choose(cells: Sequence[Cell], most: int) -> list[Cell]:
    """Return so many cells: all that count, and of the others an even choice, in their order."""
    if len(cells) <= most:
        return list(cells)
    others = [index for index, cell in enumerate(cells) if not cell.counts]
    left = max(0, most - (len(cells) - len(others)))
    chosen = {others[(2 * slot + 1) * len(others) // (2 * left)] for slot in range(min(left, len(others)))}
    return [cell for index, cell in enumerate(cells) if cell.counts or index in chosen]


def percent(value: float | None) -> str:
    """Return a share with two digits."""
    return number(None) if value is None else f"{number(100.0 * value, 2)} %"


def seconds_text(value: float) -> str:
    """Return seconds as they are read at a glance."""
    return f"{number(value)} s" if value < 100.0 else f"{value:.0f} s"


def _cell(row: Row, marks: tuple[str, ...]) -> Cell:
    figures: dict[str, Any] = {}
    if row["state"] == FINISHED:
        figures["seconds"] = seconds_text(row["seconds"]["total"])
        if row["flicker"] is not None:
            figures["flicker"] = percent(row["flicker"])
        if row["error"] is not None:
            figures["error"] = number(row["error"])
    return Cell(str(row["frame"]), row["state"], row, figures, marks)
