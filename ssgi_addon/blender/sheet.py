# SPDX-License-Identifier: GPL-3.0-or-later
"""The contact sheet: pictures side by side, titles above, metrics below, in one PNG.

Text is drawn by Blender's own font module into an image buffer, which needs no display.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import blf
import imbuf
import numpy as np
import numpy.typing as npt

from ..files import replacing
from ..heatmap import legend_bar, legend_labels
from ..png import check_whole, write_png

_Picture = npt.NDArray[np.uint8]
Panel = tuple[str, _Picture]

_MARGIN = 32
_GAP = 20
_LARGEST_PANEL_WIDTH = 640
_SMALLEST_COLUMN_WIDTH = 240
_LEGEND_BAR_HEIGHT = 12
_NOTE_GAP = 4
_LEGEND_CAPTION = "squared error relative to the reference, per pixel"

_BACKGROUND = (26, 26, 29)
_FONT = 0  # Blender's interface font; its fallbacks cover names in any script


@dataclass(frozen=True)
class _TextStyle:
    size: int
    line_height: int
    color: tuple[float, float, float, float]


_TITLE = _TextStyle(26, 36, (0.94, 0.94, 0.95, 1.0))
_CELL = _TextStyle(20, 29, (0.86, 0.86, 0.88, 1.0))
_NOTE = _TextStyle(17, 24, (0.66, 0.66, 0.69, 1.0))
_LEGEND = _TextStyle(14, 20, (0.60, 0.60, 0.63, 1.0))


@dataclass(frozen=True)
class _Column:
    x: int
    width: int

    @property
    def end(self) -> int:
        return self.x + self.width


@dataclass
class _Sheet:
    """Where everything goes, in pixels from the top left corner."""

    width: int
    height: int = 0
    pictures: list[tuple[int, int, _Picture]] = field(default_factory=list)
    texts: list[tuple[int, int, str, _TextStyle]] = field(default_factory=list)

    def add_text(self, column: _Column, top: int, text: str, style: _TextStyle) -> int:
        """Place `text`, wrapped to the column; the result is the first free row below it."""
        for line in _wrap(text, style, column.width):
            self.texts.append((column.x, top, line, style))
            top += style.line_height
        return top


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
    columns = [_Column(_MARGIN + index * (width + _GAP), width) for index in range(len(pictures))]
    sheet = _Sheet(width=columns[-1].end + _MARGIN)

    top = _lay_out_panels(sheet, columns, [title for title, _ in panels], pictures)
    legend_end = _lay_out_legend(sheet, columns[-1], top) if legend else top
    captions_end = _lay_out_captions(sheet, columns, top, legend_end - top, caption_lines)
    sheet.height = max(legend_end, captions_end) + _GAP
    _write(sheet, Path(path))


def _checked_pictures(panels: Sequence[Panel]) -> list[_Picture]:
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


def _scaled(picture: _Picture) -> _Picture:
    """Bring a picture near the panel size by a whole factor: means of squares, or repeated pixels."""
    height, width = picture.shape[:2]
    shrink = -(-width // _LARGEST_PANEL_WIDTH)
    if shrink > 1:
        rows, columns = max(height // shrink, 1), width // shrink
        # Rows and columns that fill no whole square are left out
        squares = picture[: rows * shrink, : columns * shrink].reshape(rows, -1, columns, shrink, 3)
        return np.rint(squares.mean(axis=(1, 3))).astype(np.uint8)
    grow = max(1, min(_LARGEST_PANEL_WIDTH // 2 // width, _LARGEST_PANEL_WIDTH // 2 // height))
    return picture.repeat(grow, axis=0).repeat(grow, axis=1)


def _lay_out_panels(
    sheet: _Sheet, columns: Sequence[_Column], titles: Sequence[str], pictures: Sequence[_Picture]
) -> int:
    ends = [sheet.add_text(column, _MARGIN - 8, title, _TITLE) for column, title in zip(columns, titles)]
    top = max(ends) + 6
    sheet.pictures += [(column.x, top, picture) for column, picture in zip(columns, pictures)]
    return top + pictures[0].shape[0] + _GAP


def _lay_out_legend(sheet: _Sheet, column: _Column, top: int) -> int:
    sheet.pictures.append((column.x, top, legend_bar(column.width, _LEGEND_BAR_HEIGHT)))
    labels_top = top + _LEGEND_BAR_HEIGHT + 4
    for position, label in legend_labels():
        # The first label starts at the bar's left end, the last one ends at its right end
        offset = round(position * (column.width - _text_width(label, _LEGEND)))
        sheet.texts.append((column.x + offset, labels_top, label, _LEGEND))
    return sheet.add_text(column, labels_top + _LEGEND.line_height, _LEGEND_CAPTION, _LEGEND) + 8


def _lay_out_captions(
    sheet: _Sheet, columns: Sequence[_Column], top: int, legend_height: int, lines: Sequence[str]
) -> int:
    *others, last = columns
    if others:
        row_top, last_offset = top, legend_height
        across = _Column(columns[0].x, (others[-1] if legend_height else last).end - columns[0].x)
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


def _wrap(text: str, style: _TextStyle, width: int) -> Iterator[str]:
    """Break `text` at spaces into lines of at most `width` pixels; longer words stay whole."""
    line = ""
    for word in text.split():
        longer = f"{line} {word}" if line else word
        if line and _text_width(longer, style) > width:
            yield line
            line = word
        else:
            line = longer
    if line:
        yield line


def _text_width(text: str, style: _TextStyle) -> float:
    blf.size(_FONT, style.size)
    return float(blf.dimensions(_FONT, text)[0])


def _write(sheet: _Sheet, path: Path) -> None:
    """Paint the sheet and put it in place of the file in one step."""
    canvas = np.full((sheet.height, sheet.width, 3), _BACKGROUND, dtype=np.uint8)
    for x, y, picture in sheet.pictures:
        canvas[y : y + picture.shape[0], x : x + picture.shape[1]] = picture

    with replacing(path) as unfinished:
        write_png(unfinished, canvas)
        buffer = imbuf.load(str(unfinished))
        try:
            _draw_texts(buffer, sheet)
            imbuf.write(buffer, filepath=str(unfinished))
        finally:
            buffer.free()
        check_whole(unfinished)


def _draw_texts(buffer: imbuf.types.ImBuf, sheet: _Sheet) -> None:
    with blf.bind_imbuf(_FONT, buffer):
        for x, y, text, style in sheet.texts:
            blf.size(_FONT, style.size)
            blf.color(_FONT, *style.color)
            blf.position(_FONT, x, sheet.height - y - style.size, 0)
            blf.draw_buffer(_FONT, text)
