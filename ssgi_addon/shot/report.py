# SPDX-License-Identifier: GPL-3.0-or-later
"""One report of a shot, as plain data: that of ``shot_report.json``, which page and picture show."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ..arguments import frame_text
from ..manifest import FOLDER
from .flicker import Flicker
from .grouping import grouped
from .manifests import Manifest, Shot, Unread
from .throughput import throughput

Report = dict[str, Any]
Row = dict[str, Any]

FORMAT, VERSION = "ssgi-shot", 1
FINISHED, FAILED, MISSING = "finished", "failed", "missing"
#: The steps that a frame's time is made of, in their order; what is left of the total is `OTHER`.
MAIN_STEPS = ("capture", "passes", "denoise", "write")
OTHER = "other"
# A shot's worst frames by each figure: one in so many, but no more than `_MOST_WORST`
_WORST_SHARE, _MOST_WORST = 10, 5
# Less beyond the median is chance
_CLEARLY = 1.1


def build_report(
    shot: Shot,
    expected: Sequence[int] | None,
    flicker: Mapping[int, Flicker],
    unread: Iterable[Unread] = (),
) -> Report:
    """Return the report of a shot; the same inputs give the same report.

    Parameters
    ----------
    shot
        What was read.
    expected
        Frames that should be there; None means those that are.
    flicker
        By frame, where it could be told.
    unread
        Files beside the manifests that could not be read.
    """
    frames = all_frames(shot, expected)
    finished = finished_of(shot, frames)
    rows = [_row(shot, frame, flicker.get(frame)) for frame in frames]
    unread = (*shot.unread, *unread)
    counts = {state: sum(row["state"] == state for row in rows) for state in (FINISHED, FAILED, MISSING)}
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": shot.name,
        "expected": None if expected is None else frame_text(expected),
        "counts": {**counts, "unread": sum(entry.counts for entry in unread)},
        "failed": _ranges_of(rows, FAILED),
        "missing": _ranges_of(rows, MISSING),
        "seconds": _seconds(rows),
        "throughput": throughput(finished),
        "peak_memory_mb": max(_told(rows, "peak_memory_mb").values(), default=None),
        "known": _summary(_told(rows, "known"), min),
        "error": _summary(_told(rows, "error"), max),
        "flicker": _summary(_told(rows, "flicker"), max),
        "worst": _worst(rows),
        "settings": _settings(finished),
        "versions": _kinds(finished, "versions", lambda one: one.versions),
        "shots": _kinds(finished, "shot", lambda one: one.shot),
        "machines": _machines(finished),
        "skipped": grouped((entry, one.frame) for one in finished for entry in one.record["skipped"]),
        "notes": grouped(({"note": note}, one.frame) for one in finished for note in one.record["notes"]),
        "unread": _unread(unread),
        "frames": rows,
    }


def all_frames(shot: Shot, expected: Sequence[int] | None) -> list[int]:
    """Return the numbers of all frames that are there or should be; with `expected`, of those alone."""
    return sorted(set(shot.manifests if expected is None else expected))


def finished_of(shot: Shot, frames: Iterable[int]) -> list[Manifest]:
    """Return the manifests of those of some frames that are finished."""
    found = (shot.manifests.get(frame) for frame in frames)
    return [manifest for manifest in found if manifest is not None and manifest.record]


def is_mixed(report: Report) -> list[str]:
    """Return of which things the frames should share there are several."""
    return [name for name in ("settings", "versions", "shots") if len(report[name]) > 1]


def _row(shot: Shot, frame: int, flicker: Flicker | None) -> Row:
    """Return a frame's entry."""
    manifest = shot.manifests.get(frame)
    if manifest is None:
        return {"frame": frame, "state": MISSING}
    row = {
        "frame": frame,
        "state": FAILED,
        "machine": manifest.machine,
        "finished": manifest.finished.isoformat() if manifest.finished else None,
        "process": manifest.process,
        "settings_hash": manifest.settings_hash,
    }
    record = manifest.record
    if record is None:
        return {**row, "failure": manifest.failure}
    error = ((record["metrics"] or {}).get("combined") or {}).get("relmse")
    return {
        **row,
        "state": FINISHED,
        "picture": f"{FOLDER}/{manifest.stem}.png",
        "seconds": record["seconds"],
        "steps": _steps(record["seconds"]),
        "peak_memory_mb": record["peak_memory_mb"],
        "known": record["known"],
        "error": error,
        "flicker": flicker.value if flicker else None,
        "flicker_seen": flicker.seen if flicker else None,
        "metrics": record["metrics"],
        "skipped": record["skipped"],
        "notes": record["notes"],
    }


def _steps(seconds: Mapping[str, float]) -> dict[str, float]:
    """Return what a frame's total is made of."""
    steps = {name: seconds[name] for name in MAIN_STEPS if name in seconds}
    return {**steps, OTHER: max(0.0, seconds["total"] - sum(steps.values()))}


def _told(rows: Iterable[Row], name: str) -> dict[int, float]:
    """Return a figure of the frames that have it."""
    return {row["frame"]: row[name] for row in rows if row.get(name) is not None}


def _totals(rows: Iterable[Row]) -> dict[int, float]:
    return {row["frame"]: row["seconds"]["total"] for row in rows if row["state"] == FINISHED}


def _seconds(rows: Sequence[Row]) -> dict[str, Any]:
    totals = _totals(rows)
    steps = {
        name: sum(row["steps"].get(name, 0.0) for row in rows if row["state"] == FINISHED)
        for name in (*MAIN_STEPS, OTHER)
    }
    return {"sum": sum(totals.values()), **_summary(totals, max), "steps": steps}


def _summary(values: Mapping[int, float], worst: Callable[..., float]) -> dict[str, Any]:
    """Return median, and the worst one with its frame; None where nothing is told."""
    if not values:
        return {"frames": 0, "median": None, "worst": None, "worst_frame": None}
    extreme = worst(values.values())
    frame = next(number for number, value in values.items() if value == extreme)
    median = statistics.median(values.values())
    return {"frames": len(values), "median": median, "worst": extreme, "worst_frame": frame}


def _worst(rows: Sequence[Row]) -> dict[str, list[dict[str, float]]]:
    """Return the worst frames by each figure, the worst first: of those clearly worse than the median."""
    unknown = {frame: 1.0 - value for frame, value in _told(rows, "known").items()}
    figures = {
        "error": _told(rows, "error"),
        "flicker": _told(rows, "flicker"),
        "seconds": _totals(rows),
        "known": unknown,
    }
    found = {}
    for name, values in figures.items():
        bound = _CLEARLY * statistics.median(values.values()) if values else 0.0
        ranked = sorted(values.items(), key=lambda item: -item[1])
        most = min(_MOST_WORST, -(-len(ranked) // _WORST_SHARE))
        found[name] = [
            {"frame": frame, "value": 1.0 - value if name == "known" else value}
            for frame, value in ranked[:most]
            if value > bound
        ]
    return found


def _settings(finished: Iterable[Manifest]) -> list[dict[str, Any]]:
    """Return each kind of settings, by its hash: the most frequent first."""
    found = _kinds(finished, "hash", lambda one: one.settings_hash)
    of_hash = {one.settings_hash: one.settings for one in finished}
    return [{**entry, "settings": of_hash[entry["hash"]]} for entry in found]


def _kinds(finished: Iterable[Manifest], name: str, kind: Callable[[Manifest], Any]) -> list[dict[str, Any]]:
    """Return each value that frames have, with its frames: the most frequent first."""
    groups: list[tuple[Any, list[int]]] = []
    for manifest in finished:
        value = kind(manifest)
        for other, frames in groups:
            if other == value:
                frames.append(manifest.frame)
                break
        else:
            groups.append((value, [manifest.frame]))
    groups.sort(key=lambda group: (-len(group[1]), group[1][0]))
    return [{name: value, "frames": frame_text(frames)} for value, frames in groups]


def _machines(finished: Iterable[Manifest]) -> list[dict[str, Any]]:
    by_name: dict[str, list[Manifest]] = {}
    for manifest in finished:
        by_name.setdefault(manifest.machine, []).append(manifest)
    return [
        {
            "machine": name,
            "count": len(own),
            "frames": frame_text(manifest.frame for manifest in own),
            "processes": len({manifest.process for manifest in own}),
            "seconds": sum(manifest.seconds["total"] for manifest in own),
            "median": statistics.median(manifest.seconds["total"] for manifest in own),
        }
        for name, own in sorted(by_name.items())
    ]


def _unread(entries: Iterable[Unread]) -> list[dict[str, Any]]:
    """Return the reasons why files could not be read, each with its files."""
    reasons: dict[str, list[str]] = {}
    for entry in entries:
        reasons.setdefault(entry.why, []).append(entry.file)
    return [{"why": why, "files": sorted(files)} for why, files in reasons.items()]


def _ranges_of(rows: Iterable[Row], state: str) -> str:
    return frame_text(row["frame"] for row in rows if row["state"] == state)
