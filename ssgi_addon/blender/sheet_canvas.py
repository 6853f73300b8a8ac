# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets of pictures and texts as one PNG.

Text is drawn by Blender's own font module into an image buffer, which needs no display.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import blf
import imbuf
import numpy as np

from ..files import replacing
from ..pictures import RGB
from ..png import check_whole, write_png

BACKGROUND = (26, 26, 29)
_FONT = 0  # Blender's interface font; its fallbacks cover names in any script


@dataclass(frozen=True)
class TextStyle:
    """Size and line height in pixels, and colour."""

    size: int
    line_height: int
    color: tuple[float, float, float, float]


@dataclass(frozen=True)
class Column:
    """Where something goes, pixels from the left."""

    x: int
    width: int

    @property
    def end(self) -> int:
        """First pixel after it."""
        return self.x + self.width


@dataclass
class Sheet:
    """Where everything goes, in pixels from the top left corner."""

    width: int
    height: int = 0
    pictures: list[tuple[int, int, RGB]] = field(default_factory=list)
    texts: list[tuple[int, int, str, TextStyle]] = field(default_factory=list)

    def add_text(self, column: Column, top: int, text: str, style: TextStyle) -> int:
        """Place `text`, wrapped to the column; the result is the first free row below it."""
        for line in wrap(text, style, column.width):
            self.texts.append((column.x, top, line, style))
            top += style.line_height
        return top


def wrap(text: str, style: TextStyle, width: int) -> Iterator[str]:
    """Break `text` at spaces into lines of at most `width` pixels; longer words stay whole."""
    line = ""
    for word in text.split():
        longer = f"{line} {word}" if line else word
        if line and text_width(longer, style) > width:
            yield line
            line = word
        else:
            line = longer
    if line:
        yield line


def shortened(text: str, style: TextStyle, width: int) -> str:
    """Return `text`, cut so that it is at most `width` pixels wide."""
    if text_width(text, style) <= width:
        return text
    short = text
    while short and text_width(f"{short}…", style) > width:
        short = short[:-1]
    return f"{short}…"


def text_width(text: str, style: TextStyle) -> float:
    """Return how wide a line is, pixels."""
    blf.size(_FONT, style.size)
    return float(blf.dimensions(_FONT, text)[0])


def write_sheet(sheet: Sheet, path: Path) -> None:
    """Paint the sheet and put it in place of the file in one step."""
    canvas = np.full((sheet.height, sheet.width, 3), BACKGROUND, dtype=np.uint8)
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


def _draw_texts(buffer: imbuf.types.ImBuf, sheet: Sheet) -> None:
    with blf.bind_imbuf(_FONT, buffer):
        for x, y, text, style in sheet.texts:
            blf.size(_FONT, style.size)
            blf.color(_FONT, *style.color)
            blf.position(_FONT, x, sheet.height - y - style.size, 0)
            blf.draw_buffer(_FONT, text)
