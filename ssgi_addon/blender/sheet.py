# SPDX-License-Identifier: GPL-3.0-or-later
"""The contact sheet of a frame: pictures side by side, titles above, metrics below, in one PNG."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..heatmap import legend_bar, legend_labels
from ..pictures import RGB, shrunk
from .sheet_canvas import Column, Sheet, TextStyle, text_width, write_sheet

Panel = tuple[str, RGB]

_MARGIN = 32
_GAP = 20
_LARGEST_PANEL_WIDTH = 640
_SMALLEST_COLUMN_WIDTH = 240
_LEGEND_BAR_HEIGHT = 12
_NOTE_GAP = 4
_LEGEND_CAPTION = "squared error relative to the reference, per pixel"

_TITLE = TextStyle(26, 36, (0.94, 0.94, 0.95, 1.0))
_CELL = TextStyle(20, 29, (0.86, 0.86, 0.88, 1.0))
_NOTE = TextStyle(17, 24, (0.66, 0.66, 0.69, 1.0))
_LEGEND = TextStyle(14, 20, (0.60, 0.60, 0.63, 1.0))


def write_contact_sheet(
    path: str | os.PathLike[str],
    panels: Sequence[Panel],
    caption_lines: Sequence[str] = (),
    *,
    legend: bool = True,
) -> None:
    """Write panels side by side, their titles above and captions below, as one PNG.

    Large panels are reduced by whole factors to at most 640 pixels in width, small ones are enlarged.
    Text that is wider than its place is wrapped. The file appears whole or not at all.

    Parameters
    ----------
    path
        The PNG to write.
    panels
        Title and display-referred picture, ``(H, W, 3)`` uint8, of each panel from the left. All
        pictures have one size.
    caption_lines
        Lines from the top. Parts of a line that tabs separate stand under one panel each; a line
        without tabs runs across.
    legend
        Whether the last panel is an error map, so that the scale of its colours stands under it.

    Raises
    ------
    ValueError
        If there is no panel, or a picture is not ``(H, W, 3)`` uint8 or differs in size.
    SSGIError
        If the file cannot be written.
    """
    pictures = [_scaled(picture) for picture in _checked_pictures(panels)]
    width = max(pictures[0].shape[1], _SMALLEST_COLUMN_WIDTH)
    columns = [Column(_MARGIN + index * (width + _GAP), width) for index in range(len(pictures))]
    sheet = Sheet(width=columns[-1].end + _MARGIN)

    top = _lay_out_panels(sheet, columns, [title for title, _ in panels], pictures)
    legend_end = _lay_out_legend(sheet, columns[-1], top) if legend else top
    captions_end = _lay_out_captions(sheet, columns, top, legend_end - top, caption_lines)
    sheet.height = max(legend_end, captions_end) + _GAP
    write_sheet(sheet, Path(path))


def _checked_pictures(panels: Sequence[Panel]) -> list[RGB]:
    pictures = [np.asarray(picture) for _, picture in panels]
    if not pictures:
        raise ValueError("panels: expected at least one, got none")
    for (title, _), picture in zip(panels, pictures):
        if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or picture.size == 0:
            got = f"{picture.shape} {picture.dtype}"
            raise ValueError(f"panel {title!r}: expected (H, W, 3) uint8, got {got}")
        if picture.shape != pictures[0].shape:
            expected, got = pictures[0].shape, picture.shape
            raise ValueError(f"panel {title!r}: expected the first one's shape {expected}, got {got}")
    return pictures


def _scaled(picture: RGB) -> RGB:
    """Bring a picture near the panel size by a whole factor: means of squares, or repeated pixels."""
    height, width = picture.shape[:2]
    shrink = -(-width // _LARGEST_PANEL_WIDTH)
    if shrink > 1:
        return shrunk(picture, shrink)
    grow = max(1, min(_LARGEST_PANEL_WIDTH // 2 // width, _LARGEST_PANEL_WIDTH // 2 // height))
    return picture.repeat(grow, axis=0).repeat(grow, axis=1)


def _lay_out_panels(
    sheet: Sheet, columns: Sequence[Column], titles: Sequence[str], pictures: Sequence[RGB]
) -> int:
    ends = [sheet.add_text(column, _MARGIN - 8, title, _TITLE) for column, title in zip(columns, titles)]
    top = max(ends) + 6
    sheet.pictures += [(column.x, top, picture) for column, picture in zip(columns, pictures)]
    return top + pictures[0].shape[0] + _GAP


def _lay_out_legend(sheet: Sheet, column: Column, top: int) -> int:
    sheet.pictures.append((column.x, top, legend_bar(column.width, _LEGEND_BAR_HEIGHT)))
    labels_top = top + _LEGEND_BAR_HEIGHT + 4
    for position, label in legend_labels():
        # The first label starts at the bar's left end, the last one ends at its right end
        offset = round(position * (column.width - text_width(label, _LEGEND)))
        sheet.texts.append((column.x + offset, labels_top, label, _LEGEND))
    return sheet.add_text(column, labels_top + _LEGEND.line_height, _LEGEND_CAPTION, _LEGEND) + 8


def _lay_out_captions(
    sheet: Sheet, columns: Sequence[Column], top: int, legend_height: int, lines: Sequence[str]
) -> int:
    *others, last = columns
    if others:
        row_top, last_offset = top, legend_height
        across = Column(columns[0].x, (others[-1] if legend_height else last).end - columns[0].x)
    else:
        row_top, last_offset, across = top + legend_height, 0, last

    bottom = row_top
    for line in lines:
        if "\t" in line:
            next_top = row_top + _CELL.line_height
            for column, cell in zip(columns, line.split("\t")):
                offset = last_offset if column is last else 0
                end = sheet.add_text(column, row_top + offset, cell, _CELL)
                next_top, bottom = max(next_top, end - offset), max(bottom, end)
            row_top = next_top
        else:
            row_top = sheet.add_text(across, row_top + _NOTE_GAP, line, _NOTE)
    return max(bottom, row_top)
