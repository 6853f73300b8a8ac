# SPDX-License-Identifier: GPL-3.0-or-later
"""The small pictures of a shot's frames."""

from __future__ import annotations

from pathlib import Path

from ..pictures import RGB
from ..png import read_png
from .report import Row


def read_thumbnail(folder: Path, row: Row) -> RGB:
    """Read the small picture of a finished frame.

    Raises
    ------
    SSGIError
        If it is missing or damaged.
    """
    return read_png(folder / row["picture"])
