# SPDX-License-Identifier: GPL-3.0-or-later
"""The repository's Markdown files, and the blocks of code in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_OUTSIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "benchmarks/README.md", "examples/README.md")
_FENCE = re.compile(r"^( *)```([^\n`]*)$")


@dataclass(frozen=True)
class Block:
    """A fenced block: what its fence says, where it begins, and its text without the fence's indentation."""

    info: str
    line: int
    text: str

    @property
    def language(self) -> str:
        return self.info.split()[0] if self.info else ""


def all_pages() -> list[Path]:
    """Return all Markdown files, relative to the root."""
    docs = ROOT / "docs"
    pages = [path for path in sorted(docs.rglob("*.md")) if "_build" not in path.relative_to(docs).parts]
    return [Path(name) for name in _OUTSIDE] + [path.relative_to(ROOT) for path in pages]


def blocks_of(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page."""
    begun: tuple[str, str, int] | None = None
    lines: list[str] = []
    for number, line in enumerate((ROOT / page).read_text(encoding="utf-8").splitlines(), 1):
        fence = _FENCE.match(line)
        if fence and begun is None:
            begun, lines = (fence[1], fence[2].strip(), number + 1), []
        elif fence and begun is not None:
            yield Block(begun[1], begun[2], "\n".join(lines) + "\n")
            begun = None
        elif begun is not None:
            lines.append(line.removeprefix(begun[0]))
    assert begun is None, f"{page}: the block of line {begun} has no end"
