# SPDX-License-Identifier: GPL-3.0-or-later
"""Every setting has a section on a page, with its declared facts and a picture of what it does."""

from __future__ import annotations

import re

import pytest

from docs.site.settings_facts import facts, number, settings_of, with_facts
from tests.core.settings_pages import DOCS, section_of, text_of

PAGES = {
    "ReflectionSettings": "reflections.md",
    "DiffuseSettings": "diffuse.md",
    "beyond": "beyond_the_frame.md",
    "Settings": "shared_settings.md",
    "job": "job_settings.md",
}
# What changes no picture says so.
WITHOUT_PICTURE = {"threads", "keep_world", "save_passes"}
SETTINGS = [(group, item) for group in PAGES for item in settings_of(group) if item.name != "enabled"]
IDS = [f"{group}.{item.name}" for group, item in SETTINGS]


@pytest.mark.parametrize(("group", "item"), SETTINGS, ids=IDS)
def test_every_setting_has_a_section_with_a_picture(group, item):
    section = section_of(text_of(PAGES[group]), item.name)
    shown = re.findall(rf"^!\[.+\]\((images/\w+/{item.name}\.\w+)\)$", section, re.MULTILINE)
    if item.name in WITHOUT_PICTURE:
        assert section.startswith("\nNo picture: ")
    else:
        assert len(shown) == 1
        assert (DOCS / shown[0]).is_file()


@pytest.mark.parametrize(("group", "item"), SETTINGS, ids=IDS)
def test_facts_say_default_range_and_help(group, item):
    text, rule = facts(group, item), item.metadata
    assert rule["help"] in text
    assert "| default |" in text
    assert rule["label"] in text
    for bound in ("min", "max", "soft_max"):
        if rule[bound] is not None:
            assert number(rule[bound]) in text
    for choice in rule["choices"] or ():
        assert f"- `{choice}`: " in text
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in table}) == 1


@pytest.mark.parametrize("group", PAGES)
def test_pages_ask_for_the_facts(group):
    text = text_of(PAGES[group])
    assert f"<!-- fill: settings {group} -->" in text
    assert with_facts(group, text).count("| default |") >= len(settings_of(group)) - 1


def test_missing_section_is_refused():
    with pytest.raises(ValueError, match="no section on unknown"):
        with_facts("Settings", "# Page\n\n### seed\n")


def test_presets_are_told_where_they_differ():
    (rays,) = (item for item in settings_of("DiffuseSettings") if item.name == "rays")
    assert "draft 4, balanced 2, final 32" in facts("DiffuseSettings", rays)


def test_flags_are_those_of_the_setting():
    told = {f"{group}.{item.name}": facts(group, item) for group, item in SETTINGS}
    assert "`--fill N`" in told["beyond.fill"]
    assert "command line" not in told["Settings.visibility"]
    assert "`--rays N`" in told["DiffuseSettings.rays"]
    assert "command line" not in told["ReflectionSettings.method"]


@pytest.mark.parametrize(("value", "text"), [(1e-4, "0.0001"), (4096, "4096"), (1 << 24, "16,777,216")])
def test_numbers_are_readable(value, text):
    assert number(value) == text
