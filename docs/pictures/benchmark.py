# SPDX-License-Identifier: GPL-3.0-or-later
"""The plots in README and ``docs/benchmarks``: all scenes together, and the worst one.

Run from the repository's root on the points of a run of the benchmark, with matplotlib (the extra ``bench``):

    python -m docs.pictures.benchmark bench/points.csv docs/benchmarks/results

The worst scene is the one in which the default preset has the largest error beside that of four path-traced
samples, which take about as long.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ssgi_addon.bench.methods import shipped_preset
from ssgi_addon.bench.page import mean_plot
from ssgi_addon.bench.plots import draw_plot
from ssgi_addon.bench.points import Point, dots, read_csv
from ssgi_addon.bench.summary import YARDSTICKS
from ssgi_addon.files import replacing
from ssgi_addon.job_options import DEFAULT_PRESET


def main() -> None:
    """Draw both plots."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("points", type=Path)
    parser.add_argument("output", type=Path)
    arguments = parser.parse_args()
    points: dict[str, list[Point]] = {}
    for point in read_csv(arguments.points):
        points.setdefault(point.scene, []).append(point)
    together = mean_plot(points)
    if together is None:
        parser.error("the points of one scene alone have no mean")
    worst = max(points, key=lambda scene: _ratio(points[scene]))
    print(f"worst: {worst}, {_ratio(points[worst]):.2f}")
    label = "seconds from the open scene to the finished picture"
    for name, plot in (("all", together), ("worst", draw_plot(dots(points[worst], "picture"), label))):
        with replacing(arguments.output / f"{name}.svg") as temporary:
            temporary.write_bytes(plot)


def _ratio(points: list[Point]) -> float:
    errors = {dot.point.method: dot.error for dot in dots(points, "picture")}
    return errors[shipped_preset(DEFAULT_PRESET).name] / errors[YARDSTICKS[1]]


if __name__ == "__main__":
    main()
