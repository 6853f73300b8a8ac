# SPDX-License-Identifier: GPL-3.0-or-later
"""What many frames say alike, said once."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..arguments import frame_text

# With thousands set apart or not
_NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")


def grouped(entries: Iterable[tuple[Mapping[str, str], int]]) -> list[dict[str, Any]]:
    """Return texts of frames, each once, with their frames: the most frequent first.

    Texts that differ in numbers alone are one, which tells from where to where the numbers go.

    Parameters
    ----------
    entries
        Texts by their names, and a frame that says so.
    """
    groups: dict[tuple[tuple[str, ...], ...], tuple[list[Mapping[str, str]], set[int]]] = {}
    for texts, frame in entries:
        alike = tuple((name, *_NUMBER.split(text)) for name, text in sorted(texts.items()))
        said, frames = groups.setdefault(alike, ([], set()))
        said.append(texts)
        frames.add(frame)
    found = [
        {
            **{name: _joined([texts[name] for texts in said]) for name in said[0]},
            "count": len(frames),
            "frames": frame_text(frames),
        }
        for said, frames in groups.values()
    ]
    return sorted(found, key=lambda entry: (-entry["count"], *map(str, entry.values())))


def _joined(texts: Sequence[str]) -> str:
    """Return one text for some that differ in numbers alone."""
    between = _NUMBER.split(texts[0])
    parts = [between[0]]
    for numbers, text in zip(zip(*map(_NUMBER.findall, texts)), between[1:]):
        ranked = sorted(set(numbers), key=lambda number: (float(number.replace(",", "")), number))
        parts += [ranked[0] if len(ranked) == 1 else f"{ranked[0]} to {ranked[-1]}", text]
    return "".join(parts)
