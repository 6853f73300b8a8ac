# SPDX-License-Identifier: GPL-3.0-or-later
"""Error over time as one plot: a panel for each scene, a line for each method's ladder of samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ssgi_addon.bench.frontier import on_frontier
from ssgi_addon.files import replacing

_COLUMNS = 3
_PANEL_INCHES = (4.2, 3.4)


@dataclass(frozen=True)
class Point:
    """One measured point: the panel and the line that it belongs to, seconds and error."""

    panel: str
    line: str
    seconds: float
    error: float


def draw_frontiers(points: Sequence[Point], path: Path) -> None:
    """Draw all panels, both axes logarithmic; points on the frontier are filled.

    Parameters
    ----------
    points
        In the order of panels, lines and samples.
    path
        The picture; its ending chooses the format.
    """
    # An extra of the benchmarks, and slow to load
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = list(dict.fromkeys(point.panel for point in points))
    lines = list(dict.fromkeys(point.line for point in points))
    rows = -(-len(panels) // _COLUMNS)
    size = (_PANEL_INCHES[0] * _COLUMNS, _PANEL_INCHES[1] * rows + 0.3 * len(lines) / _COLUMNS)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, _COLUMNS, squeeze=False)
    for axes, panel in zip(grid.flat, panels):
        _draw_panel(axes, [point for point in points if point.panel == panel], lines)
        axes.set_title(panel)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    for axes in grid[:, 0]:
        axes.set_ylabel("relMSE")
    for axes in grid[-1]:
        axes.set_xlabel("seconds of the pass")
    handles, labels = grid.flat[0].get_legend_handles_labels()
    title = "filled: no other point is as fast and as near"
    figure.legend(handles, labels, loc="outside lower center", ncols=_COLUMNS, frameon=False, title=title)
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix(".") or "png", dpi=110)
    print(f"drawn in {path}")


def _draw_panel(axes, points: Sequence[Point], lines: Sequence[str]) -> None:
    best = dict(zip(points, on_frontier(points)))
    for number, line in enumerate(lines):
        color = f"C{number % 10}"
        own = [point for point in points if point.line == line]
        axes.plot([point.seconds for point in own], [point.error for point in own], color=color, label=line)
        for point in own:
            face = color if best[point] else "white"
            axes.plot(point.seconds, point.error, "o", color=color, markerfacecolor=face, markersize=5)
    axes.set_xscale("log")
    axes.set_yscale("log")
    # Seconds span less than two decades: their own ticks would print over each other
    axes.set_xticks([0.1, 0.2, 0.5, 1.0, 2.0, 5.0], ["0.1", "0.2", "0.5", "1", "2", "5"])
    axes.set_xticks([], minor=True)
    axes.grid(which="both", alpha=0.2)
