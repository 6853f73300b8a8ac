# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a run: a page, a Markdown table, a CSV file of every point, and all of it as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..files import replacing, write_json
from .machine import describe_machine, describe_versions
from .markdown import markdown_of
from .methods import Method
from .options import BenchOptions
from .page import mean_plot, page_of
from .points import points_of, write_csv
from .store import SceneState
from .summary import compare_all, compare_switches


def write_report(options: BenchOptions, states: Sequence[SceneState], methods: Sequence[Method]) -> Path:
    """Write ``index.html``, ``results.md``, ``points.csv``, ``report.json``, ``all.svg``; return the page.

    ``all.svg`` shows all scenes together, where there are more than one.

    Raises
    ------
    SSGIError
        If a file cannot be written.
    """
    points = {state.name: points_of(state, methods) for state in states}
    facts = describe_run(options)
    comparisons, switches = compare_all(points), compare_switches(points)
    write_csv([point for own in points.values() for point in own], options.output / "points.csv")
    write_json(
        options.output / "report.json",
        {
            **facts,
            "comparisons": {
                target: [
                    {"title": row.title, "ratios": dict(row.ratios), "mean": row.mean, "worst": row.worst,
                     "wins": row.wins, "losses": row.losses, "missing": row.missing}
                    for row in rows
                ]
                for target, rows in comparisons.items()
            },
            "switches": [asdict(switch) for switch in switches],
            "scenes": [asdict(state) for state in states],
        },
    )  # fmt: skip
    _write_text(options.output / "results.md", markdown_of(facts, states, points, comparisons, switches))
    together = mean_plot(points)
    if together is not None:
        with replacing(options.output / "all.svg") as temporary:
            temporary.write_bytes(together)
    page = options.output / "index.html"
    _write_text(page, page_of(options, facts, states, points, comparisons, switches, together))
    return page


def describe_run(options: BenchOptions) -> dict[str, Any]:
    """Return what a reader must know of where and how it was measured."""
    return {
        "benchmark": "error against time",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": describe_machine(),
        "versions": describe_versions(),
        "options": {
            "quick": options.quick,
            "resolution": list(options.resolution),
            "repeats": options.repeats,
            "reference_samples": options.reference_samples,
            "minutes": options.minutes,
        },
    }


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
