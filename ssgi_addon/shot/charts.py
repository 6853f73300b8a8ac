# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures over the frames of a shot as SVG, which is part of the page's own text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

from ..tables import number
from .report import FAILED, MISSING, Row

# In the units of the drawing, which is as wide as the page
_WIDTH, _HEIGHT = 1000.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 56.0, 6.0, 14.0, 22.0
_TICKS, _FRAME_LABELS = 4, 12
_BAR_SHARE = 0.86
_MARK_SIZE = 4.0


def bar_chart(
    title: str,
    rows: Sequence[Row],
    layers: Mapping[str, Mapping[int, float]],
    marked: Sequence[int] = (),
    *,
    scale: float = 1.0,
    unit: str = "",
) -> str:
    """Return bars over the frames, of one figure or of several upon one another.

    Parameters
    ----------
    title
        What is drawn.
    rows
        All frames, in their order. Failed and missing ones are marked.
    layers
        Values of frames by the layer's name, the lowest layer first. Names decide the colours.
    marked
        Frames that get a mark above their bar.
    scale, unit
        Values are drawn times the one, in the other.
    """
    place = {row["frame"]: index for index, row in enumerate(rows)}
    sums = [0.0] * len(rows)
    for values in layers.values():
        for frame, value in values.items():
            sums[place[frame]] += max(0.0, value) * scale
    step = _tick_step(max(sums, default=0.0))
    axis = _Axis(len(rows), step * max(1, math.ceil(max(sums, default=0.0) / step - 1e-9)))
    parts = [_grid(axis, step, unit), _frame_labels(axis, rows), _gaps(axis, rows)]
    parts += _bars(axis, place, layers, scale)
    parts += [_mark(axis, place[frame], sums[place[frame]]) for frame in marked]
    parts.append(_tips(axis, rows, layers, scale, unit))
    legend = _legend(layers) if len(layers) > 1 else ""
    alt = f"{title}, frame by frame. The numbers stand in the table below."
    return (
        f'<figure class="chart"><figcaption>{escape(title)}{legend}</figcaption>'
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" aria-label="{escape(alt)}">'
        f"{''.join(parts)}</svg></figure>"
    )


class _Axis:
    """Where frames and values are in the drawing."""

    def __init__(self, count: int, top: float) -> None:
        self.pitch = (_WIDTH - _LEFT - _RIGHT) / max(count, 1)
        self.width = self.pitch * _BAR_SHARE
        self.top = top

    def x(self, index: int) -> float:
        return _LEFT + self.pitch * index + 0.5 * (self.pitch - self.width)

    def y(self, value: float) -> float:
        return _HEIGHT - _BOTTOM - value / self.top * (_HEIGHT - _TOP - _BOTTOM)


def _tick_step(largest: float) -> float:
    """Return a round number that fits about `_TICKS` times into the largest value."""
    if not largest > 0.0:
        return 1.0
    raw = largest / _TICKS
    decade = 10.0 ** math.floor(math.log10(raw))
    return next(decade * factor for factor in (1.0, 2.0, 5.0, 10.0) if decade * factor >= raw * (1.0 - 1e-9))


def _grid(axis: _Axis, step: float, unit: str) -> str:
    lines = []
    for tick in range(round(axis.top / step) + 1):
        y = axis.y(tick * step)
        text = f"{number(tick * step)} {unit}".strip()
        lines.append(f'<path class="grid" d="M{_LEFT:g} {y:.1f}H{_WIDTH - _RIGHT:g}"/>')
        lines.append(f'<text x="{_LEFT - 6:g}" y="{y + 4:.1f}" text-anchor="end">{escape(text)}</text>')
    return "".join(lines)


def _frame_labels(axis: _Axis, rows: Sequence[Row]) -> str:
    every = max(1, -(-len(rows) // _FRAME_LABELS))
    return "".join(
        f'<text x="{axis.x(index) + 0.5 * axis.width:.1f}" y="{_HEIGHT - 6:g}" text-anchor="middle">'
        f"{rows[index]['frame']}</text>"
        for index in range(0, len(rows), every)
    )


def _gaps(axis: _Axis, rows: Sequence[Row]) -> str:
    """Draw columns where there is no picture."""
    parts = []
    for state in (MISSING, FAILED):
        bars = [_bar(axis, index, 0.0, axis.top) for index, row in enumerate(rows) if row["state"] == state]
        if bars:
            parts.append(f'<path class="{state}" d="{"".join(bars)}"/>')
    return "".join(parts)


def _bars(
    axis: _Axis, place: Mapping[int, int], layers: Mapping[str, Mapping[int, float]], scale: float
) -> list[str]:
    """Draw each layer as one shape."""
    below = [0.0] * len(place)
    parts = []
    for name, values in layers.items():
        bars = []
        for frame, value in values.items():
            index, height = place[frame], max(0.0, value) * scale
            bars.append(_bar(axis, index, below[index], below[index] + height))
            below[index] += height
        parts.append(f'<path class="bar {escape(name)}" d="{"".join(bars)}"/>')
    return parts


def _bar(axis: _Axis, index: int, low: float, high: float) -> str:
    return f"M{axis.x(index):.2f} {axis.y(low):.2f}V{axis.y(high):.2f}h{axis.width:.2f}V{axis.y(low):.2f}z"


def _mark(axis: _Axis, index: int, value: float) -> str:
    x, y = axis.x(index) + 0.5 * axis.width, axis.y(value) - 3.0
    size = _MARK_SIZE
    return f'<path class="mark" d="M{x:.2f} {y:.2f}l{-size:g} {-1.6 * size:g}h{2 * size:g}z"/>'


def _tips(
    axis: _Axis, rows: Sequence[Row], layers: Mapping[str, Mapping[int, float]], scale: float, unit: str
) -> str:
    """Lay an invisible column over each frame that tells its values."""
    parts = []
    for index, row in enumerate(rows):
        if row["state"] == MISSING:
            continue  # there may be very many, and their column tells enough
        frame = row["frame"]
        told = [
            f"{name} {number(values[frame] * scale)} {unit}".rstrip()
            for name, values in layers.items()
            if frame in values
        ]
        text = f"frame {frame}: {', '.join(told) or row['state']}"
        x = _LEFT + axis.pitch * index
        parts.append(
            f'<rect class="tip" x="{x:.2f}" y="{_TOP:g}" width="{axis.pitch:.2f}" '
            f'height="{_HEIGHT - _TOP - _BOTTOM:g}"><title>{escape(text)}</title></rect>'
        )
    return "".join(parts)


def _legend(layers: Mapping[str, Mapping[int, float]]) -> str:
    return "".join(f'<span class="key {escape(name)}">{escape(name)}</span>' for name in layers)
