# SPDX-License-Identifier: GPL-3.0-or-later
"""The contact sheet of a shot as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import SSGIError
from ..pictures import RGB, shrunk
from ..progress import printable
from ..shot.cells import Cell, cells_of, choose
from ..shot.lines import problems, summary_lines
from ..shot.report import FAILED, FINISHED, MISSING, Report
from ..shot.thumbnails import read_thumbnail
from .sheet_canvas import Column, Sheet, TextStyle, shortened, text_width, wrap, write_sheet

_MOST_CELLS = 120
# With more cells than these, pictures are half as wide
_LARGE_CELLS = 30
_LEAST_CELL_WIDTH = 128
_ASPECT = 16.0 / 9.0

_MARGIN, _GAP, _PADDING = 24, 12, 4
_BAR_HEIGHT, _BAR_GAP = 4, 2
_OUTLINE = 2
_MOST_REASON_LINES = 3

_TITLE = TextStyle(24, 34, (0.94, 0.94, 0.95, 1.0))
_LINE = TextStyle(15, 22, (0.72, 0.72, 0.75, 1.0))
_BAD_LINE = TextStyle(15, 22, (1.0, 0.45, 0.36, 1.0))
_NUMBER = TextStyle(14, 18, (0.94, 0.94, 0.95, 1.0))
_FIGURE = TextStyle(12, 16, (0.72, 0.72, 0.75, 1.0))
_BAD = TextStyle(12, 16, (1.0, 0.45, 0.36, 1.0))

_BAD_COLOR = (214, 62, 45)
_BAR_COLORS = {"seconds": (86, 148, 214), "flicker": (170, 120, 205)}
_BAR_GROUND = (48, 48, 53)
_EMPTY_COLORS = {MISSING: (44, 44, 49), FAILED: (66, 31, 29), FINISHED: (44, 44, 49)}


@dataclass(frozen=True)
class _Grid:
    """Sizes of the cells, pixels, and how many stand in a row."""

    columns: int
    width: int
    picture_height: int
    height: int


def write_shot_picture(path: Path, report: Report, folder: Path) -> None:
    """Write the contact sheet of a shot as one PNG.

    Long shots show an even choice of their frames, and always those that failed, are missing, or are among
    the worst by a figure.

    Parameters
    ----------
    path
        The PNG to write; it appears whole or not at all.
    report
        Of the shot.
    folder
        Of its results, which holds the small pictures.

    Raises
    ------
    SSGIError
        If the file cannot be written.
    """
    cells = cells_of(report)
    chosen = choose(cells, _MOST_CELLS)
    pictures = [_small_picture(cell, folder, 2 if len(chosen) > _LARGE_CELLS else 1) for cell in chosen]
    grid = _grid(chosen, [picture for picture in pictures if not isinstance(picture, str)])
    sheet = Sheet(width=2 * _MARGIN + grid.columns * (grid.width + _GAP) - _GAP)
    top = _lay_out_summary(sheet, report, len(chosen), len(cells))
    largest = _largest(report)
    for index, (cell, picture) in enumerate(zip(chosen, pictures)):
        row, column = divmod(index, grid.columns)
        place = Column(_MARGIN + column * (grid.width + _GAP), grid.width)
        _lay_out_cell(sheet, place, top + row * (grid.height + _GAP), grid, cell, picture, largest)
    rows = math.ceil(len(chosen) / grid.columns)
    sheet.height = top + rows * (grid.height + _GAP) - _GAP + _MARGIN
    write_sheet(sheet, path)


def _small_picture(cell: Cell, folder: Path, factor: int) -> RGB | str:
    """Return a frame's picture, or the reason why there is none."""
    if cell.state != FINISHED:
        return str(cell.row.get("failure") or "")
    try:
        picture = shrunk(read_thumbnail(folder, cell.row), factor)
    except SSGIError as error:
        return f"no picture: {error}"
    grow = max(1, _LEAST_CELL_WIDTH // picture.shape[1])
    return picture.repeat(grow, axis=0).repeat(grow, axis=1)


def _grid(cells: Sequence[Cell], pictures: Sequence[RGB]) -> _Grid:
    width = max([_LEAST_CELL_WIDTH, *(picture.shape[1] for picture in pictures)])
    flat = round(_LEAST_CELL_WIDTH / _ASPECT)
    picture_height = max((picture.shape[0] for picture in pictures), default=flat)
    figures = max((len(cell.figures) - 1 for cell in cells), default=0)
    marks = max((len(cell.marks) for cell in cells), default=0)
    bars = len(_BAR_COLORS) * (_BAR_HEIGHT + _BAR_GAP)
    texts = _NUMBER.line_height + max(figures, 0) * _FIGURE.line_height + marks * _BAD.line_height
    height = picture_height + bars + texts + _PADDING
    # As many in a row as make the whole about as wide as a screen
    columns = round(math.sqrt(len(cells) * _ASPECT * (height + _GAP) / (width + _GAP)))
    return _Grid(min(max(1, columns), max(1, len(cells))), width, picture_height, height)


def _lay_out_summary(sheet: Sheet, report: Report, shown: int, count: int) -> int:
    """Place what is said of the whole shot; return the first row below."""
    sheet.width = max(sheet.width, 2 * _MARGIN + 4 * _LEAST_CELL_WIDTH)
    across = Column(_MARGIN, sheet.width - 2 * _MARGIN)
    title, *others = summary_lines(report)
    top = sheet.add_text(across, _MARGIN - 8, printable(title), _TITLE)
    if shown < count:
        others.append(f"{shown} of {count} frames are shown: an even choice, and all that are marked")
    top = sheet.add_text(across, top, printable(" · ".join(others)), _LINE)
    for problem in problems(report):
        top = sheet.add_text(across, top, printable(f"{problem[0].upper()}{problem[1:]}."), _BAD_LINE)
    return top + _GAP


def _largest(report: Report) -> dict[str, float]:
    """Return the values of full bars."""
    return {name: report[name]["worst"] or 0.0 for name in _BAR_COLORS}


def _lay_out_cell(
    sheet: Sheet,
    place: Column,
    top: int,
    grid: _Grid,
    cell: Cell,
    picture: RGB | str,
    largest: dict[str, float],
) -> None:
    if isinstance(picture, str):
        _lay_out_empty(sheet, place, top, grid, cell, picture)
    else:
        left = place.x + (place.width - picture.shape[1]) // 2
        down = top + (grid.picture_height - picture.shape[0]) // 2
        if cell.marks:
            _outline(sheet, left, down, picture)
        sheet.pictures.append((left, down, picture))
    below = top + grid.picture_height + _BAR_GAP
    if cell.state == FINISHED:
        below = _lay_out_bars(sheet, place, below, cell, largest)
    else:
        below += len(_BAR_COLORS) * (_BAR_HEIGHT + _BAR_GAP)
    sheet.texts.append((place.x, below, shortened(cell.title, _NUMBER, place.width), _NUMBER))
    figures = dict(cell.figures)
    seconds = figures.pop("seconds", "")
    if seconds:
        x = place.end - math.ceil(text_width(seconds, _FIGURE))
        sheet.texts.append((x, below + 2, seconds, _FIGURE))
    below += _NUMBER.line_height
    for line, style in (
        *((f"{name} {text}", _FIGURE) for name, text in figures.items()),
        *((mark, _BAD) for mark in cell.marks),
    ):
        sheet.texts.append((place.x, below, shortened(line, style, place.width), style))
        below += style.line_height


def _lay_out_empty(sheet: Sheet, place: Column, top: int, grid: _Grid, cell: Cell, reason: str) -> None:
    """Place what stands for a picture: why there is none."""
    ground = np.full((grid.picture_height, place.width, 3), _EMPTY_COLORS[cell.state], dtype=np.uint8)
    sheet.pictures.append((place.x, top, ground))
    inner = Column(place.x + _PADDING, place.width - 2 * _PADDING)
    lines = [*([] if cell.state == FINISHED else [cell.state]), *wrap(printable(reason), _BAD, inner.width)]
    most = min(_MOST_REASON_LINES + 1, max(1, (grid.picture_height - 2 * _PADDING) // _BAD.line_height))
    for index, line in enumerate(lines[:most]):
        at = top + _PADDING + index * _BAD.line_height
        is_cut = index == most - 1 and len(lines) > most
        text = shortened(f"{line} …" if is_cut else line, _BAD, inner.width)
        sheet.texts.append((inner.x, at, text, _BAD))


def _outline(sheet: Sheet, left: int, top: int, picture: RGB) -> None:
    height, width = picture.shape[:2]
    around = np.full((height + 2 * _OUTLINE, width + 2 * _OUTLINE, 3), _BAD_COLOR, dtype=np.uint8)
    sheet.pictures.append((left - _OUTLINE, top - _OUTLINE, around))


def _lay_out_bars(sheet: Sheet, place: Column, top: int, cell: Cell, largest: dict[str, float]) -> int:
    """Place bars for time and flicker, relative to the largest of the shot."""
    values = {"seconds": cell.row["seconds"]["total"], "flicker": cell.row["flicker"]}
    for name, color in _BAR_COLORS.items():
        value = values[name]
        if value is not None and largest[name] > 0.0:
            bar = np.full((_BAR_HEIGHT, place.width, 3), _BAR_GROUND, dtype=np.uint8)
            bar[:, : round(place.width * min(max(value / largest[name], 0.0), 1.0))] = color
            sheet.pictures.append((place.x, top, bar))
        top += _BAR_HEIGHT + _BAR_GAP
    return top
