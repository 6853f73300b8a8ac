# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of reports as rows of texts."""

from __future__ import annotations

from dataclasses import dataclass

NOTHING = "–"


@dataclass(frozen=True)
class Table:
    """Rows of texts under a head; the first column names the row, the others hold numbers."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent where it is short."""
    if value is None:
        return NOTHING
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text else text
