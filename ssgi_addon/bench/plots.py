# SPDX-License-Identifier: GPL-3.0-or-later
"""Error over time, drawn by matplotlib: an extra, so it is loaded late and asked for early."""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core.settings import PRESETS
from ..errors import SSGIError
from .frontier import frontier
from .points import Dot

_INCHES = (9.2, 5.6)
_STYLES: dict[str, dict[str, Any]] = {
    "Cycles GI": {"color": "#7aa6d6", "marker": "o"},
    "Cycles GI + fastest denoise": {"color": "#1f5fa8", "marker": "o"},
    "Cycles GI + best denoise": {"color": "#0b2d57", "marker": "o"},
    "Cycles direct only": {"color": "#c9c9c9", "marker": "s"},
    "Cycles direct only + fastest denoise": {"color": "#8f8f8f", "marker": "s"},
    "Cycles direct only + best denoise": {"color": "#5c5c5c", "marker": "s"},
    "Cycles Fast GI + fastest denoise": {"color": "#7d4ea3", "marker": "D"},
    "EEVEE": {"color": "#3a8f57", "marker": "^"},
    "EEVEE + raytracing": {"color": "#1c5c33", "marker": "^"},
}
_OURS = ("#f0a030", "#e2571f", "#a3142c", "#6a0f3c", "#d8569b")
_SWITCH = "#e2571f"


def require_matplotlib() -> None:
    """Refuse to start where the plots could not be drawn in the end.

    Raises
    ------
    SSGIError
        Saying what to install.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise SSGIError("the benchmark draws with matplotlib: pip install 'ssgi[bench]'")


def as_jpeg(path: Path) -> bytes:
    """Return a PNG file's picture as JPEG, a fifth as large."""
    # matplotlib requires it
    from PIL import Image

    buffer = io.BytesIO()
    with Image.open(path) as picture:
        picture.convert("RGB").save(buffer, "JPEG", quality=92, subsampling=0)
    return buffer.getvalue()


def draw_plot(
    dots: Sequence[Dot],
    seconds_label: str,
    level: float | None = None,
    error_label: str = "relMSE (without the worst 0.1 %)",
) -> bytes:
    """Draw a plot as SVG.

    Parameters
    ----------
    dots
        In the order of lines and samples.
    seconds_label
        Of the time axis.
    level
        Error of the picture without any indirect light, drawn across.
    error_label
        Of the error axis.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=_INCHES, layout="constrained")
    FigureCanvasSVG(figure)
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlabel=seconds_label, ylabel=error_label)
    front = frontier(dots)
    axes.plot(
        [dot.seconds for dot in front], [dot.error for dot in front],
        color="#111111", linewidth=5.0, alpha=0.13, solid_capstyle="round", label="the frontier", zorder=1,
    )  # fmt: skip
    _draw_lines(axes, dots)
    _draw_switches(axes, [dot for dot in dots if dot.point.role == "switch"])
    if level:
        axes.axhline(level, color="#8f8f8f", linestyle=":", linewidth=1.0, label="no indirect light")
    axes.grid(which="major", color="#dddddd", linewidth=0.7)
    axes.grid(which="minor", color="#eeeeee", linewidth=0.5)
    axes.set_axisbelow(True)
    _number_axes(axes)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.legend(loc="outside right upper", frameon=False, fontsize=7.5, labelspacing=0.45)
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "ssgi"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _draw_lines(axes: Any, dots: Sequence[Dot]) -> None:
    """Draw each ladder as a line; numbers beside its points are samples."""
    lines = dict.fromkeys(dot.point.line for dot in dots if dot.point.role != "switch")
    for line in lines:
        own = [dot for dot in dots if dot.point.line == line]
        style = _style(line)
        is_ours = own[0].point.kind == "ours"
        axes.plot(
            [dot.seconds for dot in own], [dot.error for dot in own], label=line,
            linewidth=2.0 if is_ours else 1.2, markersize=5.0, zorder=4 if is_ours else 3, **style,
        )  # fmt: skip
        for dot in own:
            _label(axes, dot, str(dot.point.samples), style["color"], 6.5)
            if dot.point.role == "preset":
                axes.plot(
                    dot.seconds, dot.error, marker="*", markersize=15, color=style["color"],
                    markeredgecolor="white", zorder=6,
                )  # fmt: skip


def _draw_switches(axes: Any, dots: Sequence[Dot]) -> None:
    """Draw single points by letters, which the legend explains."""
    for index, dot in enumerate(dots):
        letter = chr(ord("a") + index % 26)
        axes.plot(
            dot.seconds, dot.error, marker="o", markersize=4.0, color=_SWITCH, markerfacecolor="white",
            linestyle="none", label=f"{letter}  {dot.point.method}", zorder=5,
        )  # fmt: skip
        _label(axes, dot, letter, _SWITCH, 7.5)


def _label(axes: Any, dot: Dot, text: str, color: str, size: float) -> None:
    axes.annotate(
        text, (dot.seconds, dot.error), xytext=(3.5, 3.5), textcoords="offset points", fontsize=size,
        color=color, zorder=7,
    )  # fmt: skip


def _number_axes(axes: Any) -> None:
    """Write plain numbers, also between the decades, where the axes span few of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
        axis.set_tick_params(labelsize=8)


def _style(line: str) -> dict[str, Any]:
    if line in _STYLES:
        return _STYLES[line]
    preset = line.removeprefix("ours, ")
    index = list(PRESETS).index(preset) if preset in PRESETS else 0
    return {"color": _OURS[index % len(_OURS)], "marker": "o"}
