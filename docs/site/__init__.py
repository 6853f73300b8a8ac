# SPDX-License-Identifier: GPL-3.0-or-later
"""The site's own Sphinx extension: pages stay plain Markdown, and what would age is filled in at build time.

A comment ``<!-- fill: NAME ARGUMENT -->`` on a line of its own is replaced by what `fills.FILLS` makes of it.
Links to files of the repository that are pages of the site lead there.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docs.site.fills import FILLS
from docs.site.links import ROOT, rewritten

_FILL = re.compile(r"^<!-- fill: (?P<name>\w+)(?: (?P<argument>\S+))? -->$", re.MULTILINE)


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", _fill_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill_page(app: Any, name: str, source: list[str]) -> None:
    """Replace a page's source by what Sphinx should read."""
    path = Path(app.env.doc2path(name)).resolve().relative_to(ROOT)
    source[0] = page_source(source[0], path)


def page_source(text: str, page: Path) -> str:
    """Return a page's text with links that lead to pages, and with its comments filled in.

    Parameters
    ----------
    text
        As it stands in the file.
    page
        The file, relative to the repository's root.

    Raises
    ------
    KeyError
        If a comment names nothing that can be filled in.
    """
    text = rewritten(text, page, page)
    whole = [match for match in _FILL.finditer(text) if match["name"] == "settings"]
    text = _FILL.sub(lambda match: FILLS[match["name"]](match["argument"], page), text)
    for match in whole:
        # The facts of every setting stand below its own heading
        text = FILLS["facts"](match["argument"], text)
    return text
