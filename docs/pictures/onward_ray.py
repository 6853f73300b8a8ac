# SPDX-License-Identifier: GPL-3.0-or-later
"""The figure in ``docs/beyond_the_frame.md``: a ray that goes out of sight behind a thing, from above."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle, Wedge

Point = tuple[float, float]

_CAMERA, _STATION = (0.6, 0.4), (1.7, 3.7)
_AXIS, _ANGLE = 30.0, 90.0  # of both views, degrees
_WALL = 4.95
_START, _HIT = (2.6, _WALL), (5.2, 3.0)
_THING = (2.3, 1.6, 1.0, 1.4)  # left, low, width, height
_HIDDEN_THING = (5.2, 2.8, 0.7, 0.5)
_SIZE = (7.0, 5.6)
_OPEN, _FOUND, _DARK, _PALE = "#2f6db3", "#1b7f3b", "#444444", "#e4e4e4"


def draw_figure(path: Path) -> None:
    """Draw what the frame sees of a ray, what it does not, and how a station sees it go on."""
    figure, axes = pyplot.subplots(figsize=(_SIZE[0], _SIZE[1] + 0.2), dpi=100)
    left, low, width, height = _THING
    # What the thing hides from the camera, between the lines past its outermost corners
    lower, upper = (left + width, low), (left, low + height)
    axes.add_patch(Polygon([upper, _past(upper), _past(lower), lower], color=_PALE, zorder=0))
    axes.add_patch(Rectangle((left, low), width, height, color="#8c8c8c", zorder=3))
    axes.add_patch(Rectangle(_HIDDEN_THING[:2], *_HIDDEN_THING[2:], color="#d9a441", zorder=3))
    axes.plot([0.0, _SIZE[0]], [_WALL + 0.04] * 2, color=_DARK, linewidth=5, zorder=3)
    for place, color in ((_CAMERA, _OPEN), (_STATION, _FOUND)):
        axes.add_patch(
            Wedge(place, 0.9, _AXIS - 0.5 * _ANGLE, _AXIS + 0.5 * _ANGLE, color=color, alpha=0.25, zorder=1)
        )
        axes.plot(*place, "o", color=color, markersize=8, zorder=5)
    lost = _where_lost(upper)
    _line(axes, _START, lost, color=_OPEN)
    _line(axes, lost, _HIT, color=_FOUND)
    for seen in (lost, _HIT):
        _line(axes, _STATION, seen, color=_FOUND, linewidth=1.0, linestyle=":")
    _line(axes, _CAMERA, lost, color=_OPEN, linewidth=1.0, linestyle=":")
    axes.plot(*_HIT, "*", color=_FOUND, markersize=13, zorder=6)
    _write(axes)
    axes.set(xlim=(0.0, _SIZE[0]), ylim=(0.0, _SIZE[1]), aspect="equal")
    axes.axis("off")
    figure.tight_layout(pad=0.2)
    figure.savefig(path)
    pyplot.close(figure)


def _write(axes: Axes) -> None:
    """Name what is drawn."""
    (left, low, width, height), (far, bottom, *_) = _THING, _HIDDEN_THING
    for place, text, color in (
        ((_CAMERA[0] - 0.45, _CAMERA[1] - 0.3), "camera", _OPEN),
        ((_STATION[0] - 1.2, _STATION[1] - 0.35), "station", _FOUND),
        ((left + 0.5 * width - 0.27, low + 0.5 * height - 0.05), "thing", "white"),
        ((far - 0.25, bottom - 0.75), "hit: the station shows it", _FOUND),
        ((4.9, 3.75), "hidden from the camera", _DARK),
        ((_START[0] - 0.2, _WALL + 0.25), "the ray starts", _OPEN),
        ((3.4, 4.42), "out of the frame's sight; the station sees it", _DARK),
    ):
        axes.text(*place, text, color=color, fontsize=10, zorder=7)


def _where_lost(corner: Point) -> Point:
    """Return where the ray crosses the line of sight past a corner."""
    ray, sight = np.subtract(_HIT, _START), np.subtract(corner, _CAMERA)
    along, _ = np.linalg.solve(np.column_stack([ray, -sight]), np.subtract(_CAMERA, _START))
    return _point(np.asarray(_START) + along * ray)


def _past(corner: Point) -> Point:
    away = np.subtract(corner, _CAMERA)
    return _point(np.asarray(_CAMERA) + 20.0 * away / math.hypot(*away))


def _point(place: NDArray[np.float64]) -> Point:
    return float(place[0]), float(place[1])


def _line(axes: Axes, begin: Point, end: Point, **style: object) -> None:
    axes.plot(*zip(begin, end, strict=True), **{"linewidth": 2.5, "zorder": 4, **style})
