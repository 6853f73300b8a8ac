# SPDX-License-Identifier: GPL-3.0-or-later
"""What comments in pages are filled with when the site is built."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from docs.site.benchmark import benchmark_tables
from docs.site.commands import commands
from docs.site.links import ROOT, headings_of, rewritten
from docs.site.settings_facts import with_facts


def _include(argument: str, page: Path) -> str:
    """Return a file of the repository without its title, which the page has."""
    text = (ROOT / argument).read_text(encoding="utf-8")
    title, _, rest = text.partition("\n")
    if not title.startswith("# "):
        raise ValueError(f"{argument}: expected a title in its first line, got {title!r}")
    return rewritten(rest, Path(argument), page)


def _section(argument: str, page: Path) -> str:
    """Return what stands below one heading of a file, named by its anchor."""
    name, _, anchor = argument.partition("#")
    parts = re.split(r"^## +(.*)$", (ROOT / name).read_text(encoding="utf-8"), flags=re.MULTILINE)
    for title, text in zip(parts[1::2], parts[2::2], strict=True):
        if headings_of(f"## {title}") == [anchor]:
            return rewritten(text.strip() + "\n", Path(name), page)
    raise ValueError(f"{argument}: there is no such section")


def _records(argument: str, page: Path) -> str:
    """Return a table of a folder's files, by name, with what each says of others that it replaces."""
    paths = sorted((ROOT / page.parent).glob(f"{argument}.md"))
    rows = ["| decision | of others |", "| --- | --- |"]
    for path in paths:
        title, _, text = path.read_text(encoding="utf-8").partition("\n")
        note = " ".join(text.strip().split("\n\n")[0].split())
        note = note if note.startswith(("Replace", "Change")) else ""
        rows.append(f"| [{title.removeprefix('# ')}]({path.name}) | {note} |")
    toctree = ["```{toctree}", ":hidden:", "", *(path.stem for path in paths), "```"]
    return "\n".join([*rows, "", *toctree])


def _page(argument: str, page: Path) -> str:
    """Return the name of a page that need not be there."""
    return argument if (ROOT / page.parent / f"{argument}.md").is_file() else ""


FILLS: Mapping[str, Callable[..., Any]] = {
    "include": _include,
    "commands": lambda _argument, _page: commands(),
    "benchmark": lambda _argument, _page: benchmark_tables(),
    "section": _section,
    "page": _page,
    "records": _records,
    "settings": lambda _argument, _page: "",
    "facts": with_facts,
}
