# SPDX-License-Identifier: GPL-3.0-or-later
"""The report as one page that needs nothing but itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from ..tables import number
from ..web_page import image_html, page_html, table_html
from .options import BenchOptions
from .plots import as_jpeg, draw_plot
from .points import Point, dots
from .store import SceneState, picture_path, scene_folder
from .summary import YARDSTICKS, Comparison, Switch, mean_dots
from .tables import (
    apply_table,
    comparison_tables,
    facts_line,
    flicker_table,
    gaps,
    measured_line,
    reference_line,
    scene_table,
    subset_table,
    switch_table,
)

_READING = """<p>Each point is one way to a picture: the seconds from the open scene to the finished
picture in memory, and how far that picture is from the reference. Left and low is better. The grey band is
the frontier: what no other method beats. Stars are our presets as they are shipped; numbers beside points are
samples.</p>
<p>All seconds in plots are warm: the scene is resident, the best of several runs in turns. Cold ones, from a
process of its own, stand in the table. Clamping, adaptive sampling and the light threshold are off for
all.</p>"""


def page_of(
    options: BenchOptions,
    facts: Mapping[str, Any],
    states: Sequence[SceneState],
    points: Mapping[str, Sequence[Point]],
    comparisons: Mapping[str, Sequence[Comparison]],
    switches: Sequence[Switch],
    together: bytes | None = None,
) -> str:
    """Return the page's text; `together` is what `mean_plot` drew."""
    links = " ".join(f'<a href="#{_anchor(state)}">{escape(state.name)}</a>' for state in states)
    summary = [
        table_html(table) for table in (*comparison_tables(comparisons), switch_table(switches)) if table
    ]
    sections = [_section(options, state, points[state.name]) for state in states]
    body = f"""<header>
<h1>Error against time</h1>
<p class="facts">{escape(facts_line(facts))}</p>
<nav>{links}</nav>
</header>
<main>
<section>
<h2>Over all scenes</h2>
{_READING}
<p>Ratios below are ours over theirs: below 1 ours is better. Between measured points the frontier is followed
along straight lines of the plot.</p>
{_together(together)}
{"".join(summary)}
</section>
{"".join(sections)}
</main>"""
    return page_html("Error against time", body)


def mean_plot(points: Mapping[str, Sequence[Point]]) -> bytes | None:
    """Draw all scenes together as SVG; None where there is nothing that two scenes share."""
    found = mean_dots(points)
    if not found:
        return None
    return draw_plot(
        found, f"time relative to {YARDSTICKS[0]}", error_label=f"relMSE relative to {YARDSTICKS[0]}"
    )


def _together(plot: bytes | None) -> str:
    if plot is None:
        return ""
    title = "All scenes: geometric means of what every scene has"
    picture = image_html(plot, "image/svg+xml", f"{title}. The ratios stand in the tables below.")
    return f'<figure class="plot"><figcaption>{escape(title)}</figcaption>{picture}</figure>'


def _anchor(state: SceneState) -> str:
    return "scene-" + "".join(letter if letter.isalnum() else "-" for letter in state.name)


def _section(options: BenchOptions, state: SceneState, points: Sequence[Point]) -> str:
    parts = [f'<section id="{_anchor(state)}">', f"<h2>{escape(state.name)}</h2>"]
    if state.failure:
        parts.append(f'<p class="failure">Not measured: {escape(state.failure)}</p>')
    if points:
        parts.append(f"<p>{escape(reference_line(state))} {escape(measured_line(state))}</p>")
        parts += _plots(state, points)
        parts.append(_pictures(options, state, points))
        folded = (scene_table(points), subset_table(points, state))
        open_ = (apply_table(points), flicker_table(state))
        parts += [table_html(table) for table in open_ if table]
        parts += [
            f"<details><summary>{escape(table.title)}</summary>{table_html(table, titled=False)}</details>"
            for table in folded
        ]
    missing = gaps(state)
    if missing:
        items = "".join(f"<li>{escape(line)}</li>" for line in missing)
        parts.append(f"<details><summary>Not measured ({len(missing)})</summary><ul>{items}</ul></details>")
    return "\n".join([*parts, "</section>"])


def _plots(state: SceneState, points: Sequence[Point]) -> list[str]:
    level = state.reference["without_indirect"]["all"]["relmse"]
    titles = {
        "picture": ("The picture", "seconds from the open scene to the finished picture", None),
        "replaced": (
            "What we replace: the indirect light, in the reference's direct light",
            "seconds beyond the render of the direct light",
            level,
        ),
    }
    found = []
    for target, (title, label, across) in titles.items():
        own = dots(points, target)
        if not own:
            continue
        best = min(own, key=lambda dot: dot.error)
        alt = (
            f"{state.name}, {title.lower()}: relMSE over {label}, {len(own)} points; the nearest is "
            f"{best.point.method} with {number(best.error)} after {number(best.seconds)} s. "
            "All numbers stand in the tables below."
        )
        picture = image_html(draw_plot(own, label, across), "image/svg+xml", alt)
        found.append(f'<figure class="plot"><figcaption>{escape(title)}</figcaption>{picture}</figure>')
    return found


def _pictures(options: BenchOptions, state: SceneState, points: Sequence[Point]) -> str:
    """The main methods side by side with the reference, and maps of where they err."""
    folder = scene_folder(options, state.name)
    cells = []
    for point in points:
        path = picture_path(folder, point.method)
        if path.is_file():
            figures = f"{number(point.seconds)} s · relMSE {number(point.score('picture'))}"
            caption = f"<b>{escape(point.method)}</b> {escape(figures)}"
            alt = f"{state.name} by {point.method}: {figures}"
            error = picture_path(folder, point.method, "error")
            cells.append(
                f"<figure>{_photo(path, alt)}"
                f"{_photo(error, f'Error map of {point.method}: dark is near, bright is far')}"
                f"<figcaption>{caption}</figcaption></figure>"
            )
    reference = folder / "reference.png"
    if reference.is_file():
        photo = _photo(reference, f"{state.name}: the reference")
        cells.append(f"<figure>{photo}<figcaption><b>Reference</b></figcaption></figure>")
    return f'<div class="pictures">{"".join(cells)}</div>' if cells else ""


def _photo(path: Path, alt: str) -> str:
    return image_html(as_jpeg(path), "image/jpeg", alt) if path.is_file() else ""
