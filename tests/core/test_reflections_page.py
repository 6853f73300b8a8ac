# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/reflections.md names every switch of the reflections, with its default and a picture."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from ssgi_addon.core import ReflectionSettings

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "reflections.md").read_text(encoding="utf-8")
SWITCHES = [item for item in dataclasses.fields(ReflectionSettings) if item.name != "enabled"]


@pytest.mark.parametrize("item", SWITCHES, ids=lambda item: item.name)
def test_every_switch_has_a_section_with_its_picture(item):
    section = TEXT.split(f"\n### {item.name}\n")[1].split("\n## ")[0].split("\n### ")[0]
    assert f"(images/reflections/{item.name}.png)" in section


@pytest.mark.parametrize("item", SWITCHES, ids=lambda item: item.name)
def test_the_table_has_every_default(item):
    value = item.default
    if isinstance(value, bool):
        shown = "on" if value else "off"
    else:
        shown = f"`{value}`" if isinstance(value, str) else f"{value:g}"
    assert f"| [`{item.name}`](#{item.name}) | {shown} |" in TEXT


def test_every_picture_is_there_and_shown():
    shown = {line.split("](")[1].rstrip(")\n") for line in TEXT.splitlines() if line.startswith("![")}
    there = {path.relative_to(DOCS).as_posix() for path in (DOCS / "images" / "reflections").iterdir()}
    assert shown == there
