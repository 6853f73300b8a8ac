# SPDX-License-Identifier: GPL-3.0-or-later
"""What a log says of a shot."""

from __future__ import annotations

from typing import Any

from ..tables import number
from .cells import percent, seconds_text
from .report import FAILED, MISSING, Report, is_mixed

# More files that could not be read are counted, not named
_NAMED_FILES = 3


def summary_lines(report: Report) -> list[str]:
    """Return the figures of a shot, one line each."""
    seconds, speed = report["seconds"], report["throughput"]
    lines = [f"{report['name']}: {_counts(report['counts'])}"]
    if seconds["frames"]:
        worst = f"{seconds_text(seconds['worst'])} (frame {seconds['worst_frame']})"
        lines.append(f"seconds a frame: median {seconds_text(seconds['median'])}, worst {worst}")
    if speed["frames_per_minute"] is not None:
        machines, processes = len(report["machines"]), speed["processes"]
        where = f"{_plural(processes, 'process', 'processes')} on {_plural(machines, 'machine', 'machines')}"
        beyond = f"{seconds_text(speed['overhead_per_frame'])} a frame beyond its own"
        lines.append(f"frames per minute: {number(speed['frames_per_minute'])} by {where}, {beyond}")
    for name, text in (("flicker", percent), ("error", number), ("known", percent)):
        own = report[name]
        if own["frames"]:
            worst = f"{text(own['worst'])} (frame {own['worst_frame']})"
            lines.append(f"{name}: median {text(own['median'])}, worst {worst}")
    for entry in report["unread"]:
        files = entry["files"]
        more = f" and {len(files) - _NAMED_FILES} more" if len(files) > _NAMED_FILES else ""
        lines.append(f"not read: {', '.join(files[:_NAMED_FILES])}{more}: {entry['why']}")
    return lines


def problems(report: Report) -> list[str]:
    """Return what is not as it should be, shortly; nothing where the shot is whole."""
    found = [f"{_frames(report[state])} {state}" for state in (MISSING, FAILED) if report[state]]
    if report["counts"]["unread"]:
        count = report["counts"]["unread"]
        found.append(f"{_plural(count, 'manifest', 'manifests')} cannot be read")
    for name in is_mixed(report):
        told = " and ".join(_frames(entry["frames"]) for entry in report[name])
        found.append(f"different {name}: {told}")
    return found


def _counts(counts: dict[str, int]) -> str:
    named = (f"{count} {state}" for state, count in counts.items() if count or state == "finished")
    return ", ".join(named)


def _frames(ranges: str) -> str:
    return f"frame {ranges}" if ranges.lstrip("-").isdigit() else f"frames {ranges}"


def _plural(count: int, one: str, many: str) -> Any:
    return f"{count} {one if count == 1 else many}"
