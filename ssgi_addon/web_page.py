# SPDX-License-Identifier: GPL-3.0-or-later
"""Reports as one page that needs nothing but itself; all names are escaped, since they may hold anything."""

from __future__ import annotations

import base64
from html import escape

from .tables import Table

STYLE = """
:root {
  color-scheme: light;
  --ink: #1d2228; --quiet: #5b6570; --line: #dfe3e8; --paper: #ffffff; --wash: #f5f7f9; --accent: #b53a0a;
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
}
header, main { max-width: 76rem; margin: 0 auto; padding: 0 1.5rem; }
header { padding-top: 2.5rem; }
main { padding-bottom: 4rem; }
h1 { font-size: 2.1rem; line-height: 1.15; letter-spacing: -0.02em; margin: 0 0 0.5rem; }
h2 {
  font-size: 1.45rem; letter-spacing: -0.01em; margin: 3rem 0 0.5rem; padding-top: 1.25rem;
  border-top: 2px solid var(--ink);
}
h3 { font-size: 1.05rem; margin: 1.75rem 0 0.5rem; }
p { max-width: 48rem; margin: 0.5rem 0; }
.facts { color: var(--quiet); font-size: 0.85rem; }
nav a { color: var(--accent); margin-right: 0.9rem; }
figure { margin: 1.25rem 0; }
figcaption { font-weight: 600; margin-bottom: 0.4rem; }
img { max-width: 100%; height: auto; display: block; }
.plot img { width: 100%; }
.pictures {
  display: grid; grid-template-columns: repeat(auto-fill, minmax(21rem, 1fr)); gap: 1rem; margin: 1.5rem 0;
}
.pictures figure { margin: 0; background: var(--wash); border: 1px solid var(--line); }
.pictures img { width: 100%; }
.pictures figcaption { font-weight: 400; font-size: 0.85rem; margin: 0; padding: 0.5rem 0.7rem; }
.pictures b { display: block; }
.scroll { overflow-x: auto; border: 1px solid var(--line); }
table { border-collapse: collapse; width: 100%; font-size: 0.83rem; font-variant-numeric: tabular-nums; }
th, td { padding: 0.32rem 0.65rem; text-align: right; border-bottom: 1px solid var(--line); }
thead th { background: var(--wash); color: var(--quiet); font-weight: 600; vertical-align: bottom; }
th[scope="row"], thead th:first-child { text-align: left; font-weight: 500; white-space: nowrap; }
tbody tr:last-child > * { border-bottom: 0; }
tbody tr:hover { background: #fff7ed; }
details { margin: 0.9rem 0; }
summary { cursor: pointer; font-weight: 600; color: var(--accent); }
details > .scroll, details > ul { margin-top: 0.5rem; font-size: 0.83rem; }
.failure { color: #b42318; font-weight: 600; }
"""


def page_html(title: str, body: str, style: str = "") -> str:
    """Return a whole page.

    Parameters
    ----------
    title
        As text.
    body
        Its content, HTML: a ``header`` and a ``main``.
    style
        Rules beside those of all reports.
    """
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8" />
<meta name="viewport" content="width=device-width, initial-scale=1" />
<title>{escape(title)}</title>
<style>{STYLE}{style}</style>
</head>
<body>
{body}
</body>
</html>
"""


def image_html(data: bytes, kind: str, alt: str, attributes: str = "") -> str:
    """Return a picture that is part of the page; `kind` is its media type, `attributes` are HTML."""
    text = base64.b64encode(data).decode("ascii")
    return f'<img src="data:{kind};base64,{text}" alt="{escape(alt, quote=True)}"{attributes} />'


def table_html(table: Table, *, titled: bool = True) -> str:
    """Return a table; the first cell of a row names it."""
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in table.head)
    rows = "".join(
        f'<tr><th scope="row">{escape(row[0])}</th>'
        + "".join(f"<td>{escape(cell)}</td>" for cell in row[1:])
        + "</tr>"
        for row in table.rows
    )
    title = f"<h3>{escape(table.title)}</h3>" if titled else ""
    return (
        f'{title}<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    )
