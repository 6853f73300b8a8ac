# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a shot as one page, which holds its pictures, so that it can be sent on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from ..errors import SSGIError
from ..pictures import shrunk
from ..png import png_bytes
from ..tables import Table
from ..web_page import image_html, page_html, table_html
from .cells import Cell, cells_of
from .charts import bar_chart
from .lines import problems, summary_lines
from .page_style import SHOT_STYLE
from .page_tables import detail_tables, frame_table
from .report import FINISHED, MAIN_STEPS, OTHER, Report, Row
from .thumbnails import read_thumbnail

_ONLY = (
    '<label class="only"><input type="checkbox" id="only" /> only failed, missing and worst frames</label>'
)
# Of all small pictures together before they are packed; more make them smaller. Packed and as text they take
# about as much.
_PICTURE_BYTES = 32_000_000


def page_of(report: Report, folder: Path) -> str:
    """Return the page's text; the small pictures are read from `folder`."""
    title = f"{report['name']}: shot report"
    body = f"""<header>
<h1>{escape(report["name"])}</h1>
{_facts(report)}
</header>
<main>
<section>
<h2>Frame by frame</h2>
{"".join(_charts(report))}
</section>
<section>
<h2>Contact sheet</h2>
{_sheet(cells_of(report), folder)}
</section>
<section>
<h2>Details</h2>
{"".join(table_html(table) for table in detail_tables(report))}
{_folded(frame_table(report))}
</section>
</main>"""
    return page_html(title, body, SHOT_STYLE)


def _facts(report: Report) -> str:
    found = "".join(f'<p class="failure">{escape(_sentence(text))}</p>' for text in problems(report))
    lines = "".join(f"<li>{escape(line)}</li>" for line in summary_lines(report))
    return f'{found}<ul class="facts">{lines}</ul>'


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _charts(report: Report) -> list[str]:
    rows: Sequence[Row] = report["frames"]
    finished = [row for row in rows if row["state"] == FINISHED]
    steps = {
        name: {row["frame"]: row["steps"].get(name, 0.0) for row in finished}
        for name in (*MAIN_STEPS, OTHER)
        if any(row["steps"].get(name) for row in finished)
    }
    worst = {name: [entry["frame"] for entry in entries] for name, entries in report["worst"].items()}
    charts = [bar_chart("Seconds", rows, steps, worst["seconds"], unit="s")] if finished else []
    for name, title, scale, unit in (
        ("flicker", "Flicker", 100.0, "%"),
        ("error", "Error (relMSE of the picture)", 1.0, ""),
        ("known", "Known: samples that what was captured could answer", 100.0, "%"),
    ):
        values = {row["frame"]: row[name] for row in finished if row[name] is not None}
        if values:
            charts.append(bar_chart(title, rows, {name: values}, worst[name], scale=scale, unit=unit))
    return charts


def _sheet(cells: Sequence[Cell], folder: Path) -> str:
    chosen = _ONLY if any(cell.counts for cell in cells) else ""
    factor = _shrink(cells, folder)
    return f'{chosen}<div class="sheet">{"".join(_figure(cell, folder, factor) for cell in cells)}</div>'


def _shrink(cells: Sequence[Cell], folder: Path) -> int:
    """Return by which whole factor the pictures get smaller, so that the page does not get too large."""
    for cell in cells:
        if cell.state == FINISHED:
            try:
                size = read_thumbnail(folder, cell.row).size * len(cells)
            except SSGIError:
                continue
            return max(1, math.ceil(math.sqrt(size / _PICTURE_BYTES)))
    return 1


def _figure(cell: Cell, folder: Path, factor: int) -> str:
    marks = "".join(f"<b>{escape(mark)}</b>" for mark in cell.marks)
    kinds = " ".join(["cell", cell.state, *["marked"] * cell.counts])
    figures = " · ".join(
        escape(text if name == "seconds" else f"{name} {text}") for name, text in cell.figures.items()
    )
    caption = f"<figcaption><strong>{escape(cell.title)}</strong> {figures}{marks}</figcaption>"
    return f'<figure class="{kinds}">{_picture(cell, folder, factor)}{caption}</figure>'


def _picture(cell: Cell, folder: Path, factor: int) -> str:
    """Return the small picture, or what stands in its place and why."""
    if cell.state != FINISHED:
        why = f": {cell.row['failure']}" if cell.row.get("failure") else ""
        return f'<div class="empty"><span>{escape(cell.state + why)}</span></div>'
    try:
        picture = shrunk(read_thumbnail(folder, cell.row), factor)
    except SSGIError as error:
        return f'<div class="empty"><span>no picture: {escape(str(error))}</span></div>'
    size = f' width="{picture.shape[1]}" height="{picture.shape[0]}" decoding="async"'
    return image_html(png_bytes(picture), "image/png", f"Frame {cell.title}", size)


def _folded(table: Table) -> str:
    return f"<details><summary>{escape(table.title)}</summary>{table_html(table, titled=False)}</details>"
