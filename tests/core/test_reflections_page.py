# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/reflections.md names every switch of the reflections, with its default and a picture."""

from __future__ import annotations

import pytest

from ssgi_addon.core import ReflectionSettings
from tests.core.settings_pages import DOCS, section_of, switches_of, table_row, text_of

TEXT = text_of("reflections.md")
SWITCHES = switches_of(ReflectionSettings)


@pytest.mark.parametrize("item", SWITCHES, ids=lambda item: item.name)
def test_every_switch_has_a_section_with_its_picture(item):
    assert f"(images/reflections/{item.name}.webp)" in section_of(TEXT, item.name)


@pytest.mark.parametrize("item", SWITCHES, ids=lambda item: item.name)
def test_the_table_has_every_default(item):
    assert table_row(item) in TEXT


def test_every_picture_is_there_and_shown():
    shown = {line.split("](")[1].rstrip(")\n") for line in TEXT.splitlines() if line.startswith("![")}
    there = {path.relative_to(DOCS).as_posix() for path in (DOCS / "images" / "reflections").iterdir()}
    assert shown == there
