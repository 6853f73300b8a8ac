# SPDX-License-Identifier: GPL-3.0-or-later
"""Every measured point as one flat record, and as the rows of a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ..files import replacing
from .methods import Method
from .scores import METRICS, SUBSETS, TARGETS, Scores
from .store import Record, SceneState

# A reference's own error must be this many times smaller than what is told by it.
REFERENCE_MARGIN = 10.0
# Of a subtraction of two times; below, their difference is the clock's.
_SHORTEST = 1e-3


@dataclass(frozen=True)
class Point:
    """One method on one scene.

    Attributes
    ----------
    scene
        Its name.
    method, line, kind, role, samples, denoiser, preset
        As in `Method`.
    seconds
        The best of the timed runs: from the open scene to the finished picture.
    spread
        Of the timed runs: the slowest over the fastest, less 1.
    runs
        How many there were.
    beyond_direct
        Seconds beyond those of the direct light's render; None for what has none.
    passes
        Seconds of our passes alone, on what is captured; None for others.
    memory_mb, cold_seconds, cold_memory_mb
        Largest resident size while it ran; the first picture of a process, and that process's size.
    is_above_reference
        The reference's own error is less than a tenth of the picture's.
    scores
        By target, part of the pixels and metric.
    """

    scene: str
    method: str
    line: str
    kind: str
    role: str
    samples: int
    denoiser: str
    preset: str | None
    seconds: float
    spread: float
    runs: int
    beyond_direct: float | None
    passes: float | None
    memory_mb: float | None
    cold_seconds: float | None
    cold_memory_mb: float | None
    is_above_reference: bool
    scores: dict[str, Scores] = field(default_factory=dict, compare=False)

    def score(self, target: str, metric: str = "relmse", subset: str = "all") -> float | None:
        """Return one figure; None where it was not measured."""
        return self.scores.get(target, {}).get(subset, {}).get(metric)


@dataclass(frozen=True)
class Dot:
    """A point of a plot: its own seconds and error, both above zero."""

    point: Point
    seconds: float
    error: float


def dots(points: Iterable[Point], target: str) -> list[Dot]:
    """Return what a plot shows: the whole time over the picture's error, or the time of what is replaced.

    Parameters
    ----------
    points
        Of one scene.
    target
        ``"picture"``, ``"replaced"`` (seconds beyond the direct light) or ``"passes"`` (seconds of our
        passes, error of the picture).
    """
    found = []
    for point in points:
        seconds = {"picture": point.seconds, "replaced": point.beyond_direct, "passes": point.passes}[target]
        error = point.score("replaced" if target == "replaced" else "picture")
        if seconds and error:
            found.append(Dot(point, seconds, error))
    return found


def points_of(state: SceneState, methods: Sequence[Method]) -> list[Point]:
    """Return the measured points of a scene in the order of the methods."""
    measured = [method for method in methods if _is_measured(state.records.get(method.name))]
    return [_point(state, method) for method in measured]


def _is_measured(record: Record | None) -> bool:
    return record is not None and bool(record.seconds) and record.failure is None


def _point(state: SceneState, method: Method) -> Point:
    record = state.records[method.name]
    best, cold = record.best, record.cold or {}
    beyond = best.get("beyond_direct")
    partner = state.records.get(method.direct_partner or "")
    if _is_measured(partner):
        beyond = best["seconds"] - min(partner.seconds)
    scores = {**record.passes, **best["scores"]}
    error = scores["picture"]["all"]["relmse"] or 0.0
    return Point(
        scene=state.name,
        **{name: getattr(method, name) for name in ("line", "kind", "role", "samples", "denoiser", "preset")},
        method=method.name,
        seconds=best["seconds"],
        spread=max(record.seconds) / min(record.seconds) - 1.0,
        runs=len(record.seconds),
        beyond_direct=None if beyond is None else max(beyond, _SHORTEST),
        passes=best.get("passes"),
        memory_mb=best["memory_mb"],
        cold_seconds=cold.get("seconds"),
        cold_memory_mb=cold.get("memory_mb"),
        is_above_reference=error >= REFERENCE_MARGIN * state.reference["own_error"]["combined"],
        scores=scores,
    )


_PLAIN = [item.name for item in fields(Point) if item.name != "scores"]
_SCORED = [(target, subset, metric) for target in TARGETS for subset in SUBSETS for metric in METRICS]


def write_csv(points: Iterable[Point], path: Path) -> None:
    """Write all figures of all points, one row each; what was not measured is empty.

    Raises
    ------
    SSGIError
        If the file cannot be written.
    """
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow([*_PLAIN, *(".".join(name) for name in _SCORED)])
        for point in points:
            scored = [point.score(target, metric, subset) for target, subset, metric in _SCORED]
            rows.writerow([*(getattr(point, name) for name in _PLAIN), *scored])


def read_csv(path: Path) -> list[Point]:
    """Read what `write_csv` wrote."""
    with path.open(encoding="utf-8", newline="") as file:
        return [_from_row(row) for row in csv.DictReader(file)]


def _from_row(row: dict[str, str]) -> Point:
    scores: dict[str, Scores] = {}
    for target, subset, metric in _SCORED:
        text = row[f"{target}.{subset}.{metric}"]
        scores.setdefault(target, {}).setdefault(subset, {})[metric] = float(text) if text else None
    return Point(**{name: _value(name, row[name]) for name in _PLAIN}, scores=scores)


def _value(name: str, text: str) -> Any:
    if name in ("samples", "runs"):
        return int(text)
    if name == "is_above_reference":
        return text == "True"
    if name in ("scene", "method", "line", "kind", "role", "denoiser"):
        return text
    if not text:
        return None
    return text if name == "preset" else float(text)
