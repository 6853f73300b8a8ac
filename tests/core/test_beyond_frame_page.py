# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/beyond_the_frame.md names every option of what is captured beyond the frame, with default and unit."""

from __future__ import annotations

import dataclasses
import re

import pytest

from ssgi_addon.job_options import BEYOND_FRAME, CYCLES_ONLY, RENDERED, JobOptions
from tests.core.settings_pages import DOCS, section_of, table_row, text_of

TEXT = text_of("beyond_the_frame.md")
FIELDS = {item.name: item for item in dataclasses.fields(JobOptions)}
OPTIONS = [FIELDS[name] for name in BEYOND_FRAME]


@pytest.mark.parametrize("item", OPTIONS, ids=lambda item: item.name)
def test_every_option_has_a_section(item):
    assert section_of(TEXT, item.name).strip()


@pytest.mark.parametrize("item", OPTIONS, ids=lambda item: item.name)
def test_the_table_has_every_default_and_unit(item):
    unit = item.metadata.get("unit", "")
    row = next(line for line in TEXT.splitlines() if line.startswith(table_row(item)))
    stated = row.split("|")[3].strip()
    if unit or isinstance(item.default, bool):
        assert stated == unit
    else:
        assert stated.startswith("times the ")  # a factor


def test_sections_and_rows_follow_the_panel():
    captured = TEXT.split("\n## What is captured\n")[1].split("\n## ")[0]
    sections = [line[4:] for line in captured.splitlines() if line.startswith("### ")]
    rows = [line.split("`")[1] for line in TEXT.splitlines() if line.startswith("| [`")]
    assert sections == rows == list(BEYOND_FRAME)


def test_budgets_of_presets_are_as_stated():
    stated = " ".join(section_of(TEXT, "budget").split()).split("The presets set it:")[1]
    expected = ", ".join(f"{value['budget']:g} (`{name}`)" for name, value in RENDERED.items())
    assert stated.split(". Each")[0].strip() == expected


def test_fills_of_presets_are_as_stated():
    stated = " ".join(TEXT.split()).split("The presets take a fill of ")[1].split(" ([ADR")[0]
    assert re.findall(r"\d+", stated) == [str(value["fill"]) for value in RENDERED.values()]


def test_what_cycles_alone_captures_is_stated():
    for name in CYCLES_ONLY:
        assert "Cycles" in section_of(TEXT, name)


def test_every_picture_is_there_and_shown():
    shown = {line.split("](")[1].rstrip(")\n") for line in TEXT.splitlines() if line.startswith("![")}
    there = {path.relative_to(DOCS).as_posix() for path in (DOCS / "images" / "beyond_the_frame").iterdir()}
    assert shown == there
