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
    app.connect("env-get-outdated", _filled_pages)
    # Before napoleon reads docstrings
    app.connect("autodoc-process-docstring", _split_attributes, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill_page(app: Any, name: str, source: list[str]) -> None:
    """Replace a page's source by what Sphinx should read."""
    path = Path(app.env.doc2path(name)).resolve().relative_to(ROOT)
    source[0] = page_source(source[0], path)


def _filled_pages(_app: Any, env: Any, *_changes: Any) -> list[str]:
    """Return the pages that depend on more than their own file: they are read each time."""
    return [name for name in env.found_docs if _FILL.search(Path(env.doc2path(name)).read_text("utf-8"))]


def _split_attributes(
    _app: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]
) -> None:
    """Change a docstring as `one_attribute_each` does."""
    lines[:] = one_attribute_each(lines)


def one_attribute_each(lines: list[str]) -> list[str]:
    """Return a docstring whose attributes have a text each: napoleon knows no lists of names there."""
    if "Attributes" not in lines:
        return lines
    begin = lines.index("Attributes") + 2
    end = next((n - 1 for n in range(begin, len(lines)) if lines[n].startswith("---")), len(lines))
    split: list[str] = []
    for entry in _entries(lines[begin:end]):
        names, colon, kind = entry[0].partition(" : ")
        for name in names.split(", "):
            split += [f"{name}{colon}{kind}", *entry[1:]]
    return lines[:begin] + split + lines[end:]


def _entries(lines: list[str]) -> list[list[str]]:
    """Return the lines of each attribute; what is indented belongs to the one before."""
    entries: list[list[str]] = []
    for line in lines:
        if line[:1].strip() or not entries:
            entries.append([])
        entries[-1].append(line)
    return entries


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
