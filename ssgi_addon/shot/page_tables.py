# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of a shot's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..recipe import named_differences
from ..tables import NOTHING, Table, number
from .cells import MARKS, percent, seconds_text
from .report import FINISHED, MAIN_STEPS, MISSING, OTHER, Report, Row


def detail_tables(report: Report) -> list[Table]:
    """Return the tables of a report that have rows."""
    tables = (
        _worst_table(report),
        _machine_table(report),
        _settings_table(report),
        _versions_table(report),
        _shots_table(report),
        _grouped_table("Skipped", ("What and why", "Count", "Frames"), report["skipped"], _skipped_text),
        _grouped_table("Notes", ("Note", "Count", "Frames"), report["notes"], lambda entry: entry["note"]),
        _unread_table(report),
        _failure_table(report),
    )
    return [table for table in tables if table.rows]


def frame_table(report: Report) -> Table:
    """Return all frames that left something, with their figures."""
    steps = [
        name
        for name in (*MAIN_STEPS, OTHER)
        if any(row["steps"].get(name) for row in report["frames"] if row["state"] == FINISHED)
    ]
    head = ("Frame", "State", "Machine", "Seconds", *(name.capitalize() for name in steps), "Flicker",
            "Flicker seen", "Error", "Known", "Peak MB", "Finished")  # fmt: skip
    rows = tuple(_frame_row(row, steps) for row in report["frames"] if row["state"] != MISSING)
    return Table(f"All frames ({len(rows)})", head, rows)


def _frame_row(row: Row, steps: Sequence[str]) -> tuple[str, ...]:
    start = (str(row["frame"]), row["state"], row.get("machine", NOTHING))
    if row["state"] != FINISHED:
        return (*start, *[NOTHING] * (len(steps) + 6), row.get("finished") or NOTHING)
    return (
        *start,
        number(row["seconds"]["total"]),
        *(number(row["steps"].get(name)) for name in steps),
        percent(row["flicker"]),
        percent(row["flicker_seen"]),
        number(row["error"]),
        percent(row["known"]),
        number(row["peak_memory_mb"], 4),
        row["finished"] or NOTHING,
    )


def _spaced(ranges: str) -> str:
    """Return ranges of frames so that a line may break between them."""
    return ranges.replace(",", ", ")


def _worst_table(report: Report) -> Table:
    texts = {"seconds": seconds_text, "flicker": percent, "error": number, "known": percent}
    rows = tuple(
        (f"{MARKS[name]} {rank}", str(entry["frame"]), texts[name](entry["value"]))
        for name in MARKS
        for rank, entry in enumerate(report["worst"][name], start=1)
    )
    return Table("Worst frames", ("By", "Frame", "Value"), rows)


def _machine_table(report: Report) -> Table:
    head = ("Machine", "Frames", "Seconds together", "Median of a frame", "Processes", "Which")
    rows = tuple(
        (entry["machine"], str(entry["count"]), number(entry["seconds"], 4), number(entry["median"]),
         str(entry["processes"]), _spaced(entry["frames"]))
        for entry in report["machines"]
    )  # fmt: skip
    return Table("Machines", head, rows)


def _settings_table(report: Report) -> Table:
    """Return each kind of settings; of several, in what they differ."""
    first = report["settings"][0]["settings"] if report["settings"] else {}
    rows = tuple(
        (
            kind["hash"],
            named_differences(kind["settings"], first) or NOTHING,
            _spaced(kind["frames"]),
        )
        for kind in report["settings"]
    )
    return Table("Settings", ("Hash", "Differs from the first in", "Frames"), rows)


def _versions_table(report: Report) -> Table:
    rows = tuple(
        (
            ", ".join(f"{name} {version}" for name, version in entry["versions"].items()),
            _spaced(entry["frames"]),
        )
        for entry in report["versions"]
    )
    return Table("Versions", ("Versions", "Frames"), rows)


def _shots_table(report: Report) -> Table:
    """Return the captures that frames share, where there are any."""
    kinds = report["shots"]
    is_told = any(entry["shot"] is not None for entry in kinds)
    rows = tuple((entry["shot"] or "none", _spaced(entry["frames"])) for entry in kinds) if is_told else ()
    return Table("Captured once for the shot", ("Hash", "Frames"), rows)


def _grouped_table(title: str, head: tuple[str, ...], entries: Sequence[Any], text: Any) -> Table:
    rows = tuple((text(entry), str(entry["count"]), _spaced(entry["frames"])) for entry in entries)
    return Table(title, head, rows)


def _skipped_text(entry: Mapping[str, str]) -> str:
    return f"{entry['what']}: {entry['why']}"


def _unread_table(report: Report) -> Table:
    rows = tuple((entry["why"], ", ".join(entry["files"])) for entry in report["unread"])
    return Table("Files that could not be read", ("Why", "Files"), rows)


def _failure_table(report: Report) -> Table:
    rows = tuple(
        (str(row["frame"]), row["machine"], row["failure"]) for row in report["frames"] if row.get("failure")
    )
    return Table("Failures", ("Frame", "Machine", "Why"), rows)
