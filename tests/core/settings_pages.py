# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages in docs/ that describe a settings dataclass, switch by switch."""

from __future__ import annotations

import dataclasses
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def text_of(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8")


def switches_of(settings: type) -> list[dataclasses.Field]:
    return [item for item in dataclasses.fields(settings) if item.name != "enabled"]


def section_of(text: str, name: str) -> str:
    return text.split(f"\n### {name}\n")[1].split("\n## ")[0].split("\n### ")[0]


def table_row(item: dataclasses.Field) -> str:
    """Return how the table of a page begins the row of a switch, with its default."""
    value = item.default
    if isinstance(value, bool):
        shown = "on" if value else "off"
    else:
        shown = f"`{value}`" if isinstance(value, str) else f"{value:g}"
    return f"| [`{item.name}`](#{item.name}) | {shown} |"
