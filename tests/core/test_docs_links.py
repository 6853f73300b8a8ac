# SPDX-License-Identifier: GPL-3.0-or-later
"""Every relative link in a Markdown file leads to a file of the repository, and to a heading of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.site.links import headings_of, links_of, rewritten
from tests.core.pages import ROOT, all_pages

PAGES = all_pages()


def broken_links(text: str, folder: Path) -> list[str]:
    broken = []
    for target in links_of(text):
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        file = (folder / path).resolve() if path else None
        if file is not None and not (file.exists() and file.is_relative_to(ROOT)):
            broken.append(target)
        elif anchor:
            there = text if file is None else file.read_text(encoding="utf-8")
            broken += [] if anchor in headings_of(there) else [target]
    return broken


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert broken_links(text, (ROOT / page).parent) == []


def test_broken_links_are_found():
    text = "# One\n\n[a](#one) [b](#two) [c](none.md) [d](README.md#limits) [e](README.md#no-such)\n"
    text += "```sh\n[f](never.md)\n```\n`[g](code.md)` [h](https://example.org/none.md)\n"
    assert broken_links(text, ROOT) == ["#two", "none.md", "README.md#no-such"]


def test_headings_of_one_name_are_counted():
    assert headings_of("# A b\n## A b\n### `c_d`, e\n## A b") == ["a-b", "a-b-1", "c_d-e", "a-b-2"]


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("docs/panels.md", "panels.md"),
        ("docs/adr", "adr/index.md"),
        ("docs/architecture.md#recipe-add-a-pass", "architecture.md#recipe-add-a-pass"),
        ("CHANGELOG.md", "changelog.md"),
        ("README.md#what-works-where", "what_works_where.md"),
        ("tests/tolerances.py", "../tests/tolerances.py"),
        ("https://example.org/a.md", "https://example.org/a.md"),
        ("#tests", "#tests"),
    ],
)
def test_links_hold_where_the_site_shows_a_file(target, expected):
    text = rewritten(f"[a]({target})", Path("CONTRIBUTING.md"), Path("docs/contributing.md"))
    assert text == f"[a]({expected})"
