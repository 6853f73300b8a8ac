# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark's figures as tables, from the points of its last published run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from docs.site.links import ROOT
from ssgi_addon.bench.points import Dot, Point, dots, read_csv
from ssgi_addon.bench.summary import YARDSTICKS, Comparison, compare_all, mean_dots
from ssgi_addon.tables import number

POINTS = ROOT / "docs" / "benchmarks" / "results" / "points.csv"
# Of the methods over all scenes, those that a reader chooses between.
_SAMPLES = (1, 4, 16, 64)


def benchmark_tables() -> str:
    """Return times and errors over all scenes, and each scene's at equal time, Markdown."""
    points: dict[str, list[Point]] = {}
    for point in read_csv(POINTS):
        points.setdefault(point.scene, []).append(point)
    return f"{_means(points)}\n\n{_by_scene(points)}"


def _means(points: Mapping[str, Sequence[Point]]) -> str:
    found = [dot for dot in mean_dots(points) if _is_told(dot)]
    rows = [f"| {dot.point.method} | {number(dot.seconds)} | {number(dot.error)} |" for dot in found]
    title = f"Over {len(points)} scenes, relative to {YARDSTICKS[0]} (geometric means):"
    return "\n".join([title, "", "| method | time | error |", "| --- | ---: | ---: |", *rows])


def _is_told(dot: Dot) -> bool:
    point = dot.point
    if point.kind == "ours":
        return point.role == "preset"
    return point.denoiser == "fastest" and point.samples in _SAMPLES


def _by_scene(points: Mapping[str, Sequence[Point]]) -> str:
    rows = [_row(row) for row in compare_all(points)["picture"]]
    nearest = [
        f"| {scene} | " + " | ".join(_seconds_and_error(own, name) for name in _columns(points)) + " |"
        for scene, own in points.items()
    ]
    columns = _columns(points)
    return "\n".join(
        [
            "Ours over theirs, below 1 ours is better:",
            "",
            "| | mean | worst scene | ours is better in |",
            "| --- | ---: | --- | --- |",
            *rows,
            "",
            "Seconds and relMSE of the picture:",
            "",
            "| scene | " + " | ".join(columns) + " |",
            "| --- |" + " --- |" * len(columns),
            *nearest,
        ]
    )


def _row(row: Comparison) -> str:
    """Return one comparison; where some scene has no ratio, with what that means."""
    mean, worst = row.mean, row.worst
    missing = len(row.ratios) - len(row.known)
    note = f", {missing} without: {row.missing}" if missing else ""
    shown = "–" if worst is None else f"{number(worst[1])} ({worst[0]})"
    return f"| {row.title} | {number(mean)} | {shown} | {row.wins} of {len(row.ratios)}{note} |"


def _columns(points: Mapping[str, Sequence[Point]]) -> list[str]:
    """Return the methods that every scene has of those that are told."""
    return [dot.point.method for dot in mean_dots(points) if _is_told(dot)]


def _seconds_and_error(points: Sequence[Point], method: str) -> str:
    (dot,) = (dot for dot in dots(points, "picture") if dot.point.method == method)
    return f"{number(dot.seconds)} s, {number(dot.error)}"
