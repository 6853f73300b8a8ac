# SPDX-License-Identifier: GPL-3.0-or-later
"""Links in Markdown: as they stand in the repository, and where they lead on the site."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[2]
DOCS = Path("docs")
# Files outside of docs/ that are pages of the site.
PAGES = {
    "README.md": "docs/index.md",
    "README.md#what-works-where": "docs/what_works_where.md",
    "CONTRIBUTING.md": "docs/contributing.md",
    "CHANGELOG.md": "docs/changelog.md",
    "benchmarks/README.md": "docs/development_benchmarks.md",
    "examples/README.md": "docs/examples.md",
}
_FENCE = re.compile(r"^ *(```|~~~)")
_LINK = re.compile(r"(?P<before>\]\()(?P<target>[^)\s]+)(?P<after>\))")


def links_of(text: str) -> Iterator[str]:
    """Yield the targets of all links and pictures outside of code, in order."""
    for line, is_code in _lines(text):
        if not is_code:
            yield from (match["target"] for match in _LINK.finditer(_without_code(line)))


def headings_of(text: str) -> list[str]:
    """Return the anchors of all headings, as hosts of repositories and the site make them."""
    found: list[str] = []
    for line, is_code in _lines(text):
        match = re.match(r"#{1,6} +(.*?) *#*$", line)
        if match and not is_code:
            words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", match[1])
            slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
            before = sum(re.fullmatch(re.escape(slug) + r"(-\d+)?", anchor) is not None for anchor in found)
            found.append(f"{slug}-{before}" if before else slug)
    return found


def rewritten(text: str, source: Path, page: Path) -> str:
    """Return Markdown whose relative links hold on a page of the site.

    Parameters
    ----------
    text
        Of a file.
    source
        That file, relative to the repository's root.
    page
        The page that shows it, likewise.
    """

    def lead(match: re.Match[str]) -> str:
        return match["before"] + _on_site(match["target"], source, page) + match["after"]

    lines = [line if is_code else _LINK.sub(lead, line) for line, is_code in _lines(text)]
    return "\n".join(lines) + ("\n" if text.endswith("\n") else "")


def _on_site(target: str, source: Path, page: Path) -> str:
    """Return where a link of a file leads from a page."""
    path, hash_, anchor = target.partition("#")
    if not path or re.match(r"[a-z]+:", path):
        return target
    inside = os.path.normpath(source.parent / path)
    if inside + hash_ + anchor in PAGES:
        inside, hash_, anchor = PAGES[inside + hash_ + anchor], "", ""
    inside = PAGES.get(inside, inside)
    for index in ("index.md", "README.md"):
        if (ROOT / inside).is_dir() and (ROOT / inside / index).is_file():
            inside = os.path.join(inside, index)
    relative = os.path.relpath(inside, page.parent)
    return PurePosixPath(relative).as_posix() + hash_ + anchor


def _lines(text: str) -> Iterator[tuple[str, bool]]:
    """Yield each line, and whether it belongs to a block of code."""
    is_code = False
    for line in text.splitlines():
        is_fence = _FENCE.match(line) is not None
        yield line, is_code or is_fence
        is_code ^= is_fence


def _without_code(line: str) -> str:
    return re.sub(r"`[^`]*`", "", line)
