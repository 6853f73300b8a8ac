# SPDX-License-Identifier: GPL-3.0-or-later
"""The report as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..tables import Table
from .points import Point
from .store import SceneState
from .summary import Comparison, Switch
from .tables import (
    apply_table,
    comparison_tables,
    facts_line,
    flicker_table,
    gaps,
    measured_line,
    reference_line,
    scene_table,
    subset_table,
    switch_table,
)


def markdown_of(
    facts: Mapping[str, Any],
    states: Sequence[SceneState],
    points: Mapping[str, Sequence[Point]],
    comparisons: Mapping[str, Sequence[Comparison]],
    switches: Sequence[Switch],
) -> str:
    """Return all tables of a run."""
    parts = ["# Error against time", facts_line(facts)]
    parts += [
        table_text(table) for table in (*comparison_tables(comparisons), switch_table(switches)) if table
    ]
    for state in states:
        parts.append(f"## {state.name}")
        if state.failure:
            parts.append(f"Not measured: {state.failure}")
        if not points[state.name]:
            continue
        own = points[state.name]
        parts.append(f"{reference_line(state)} {measured_line(state)}")
        tables = (scene_table(own), subset_table(own, state), apply_table(own), flicker_table(state))
        parts += [table_text(table, level=3) for table in tables if table]
        missing = gaps(state)
        if missing:
            parts.append("\n".join(["Not measured:", "", *(f"- {line}" for line in missing)]))
    return "\n\n".join(parts) + "\n"


def table_text(table: Table, level: int = 2) -> str:
    """Return one table."""
    rows = [table.head, ("---", *["---:"] * (len(table.head) - 1)), *table.rows]
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join([f"{'#' * level} {table.title}", "", *lines])
