# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/diffuse.md names every switch of the diffuse pass, with its default, and every method."""

from __future__ import annotations

import pytest

from ssgi_addon.core import DiffuseSettings
from ssgi_addon.core.settings import PRESETS
from tests.core.settings_pages import section_of, switches_of, table_row, text_of

TEXT = text_of("diffuse.md")
SWITCHES = switches_of(DiffuseSettings)
(METHOD,) = (item for item in SWITCHES if item.name == "method")


@pytest.mark.parametrize("item", SWITCHES, ids=lambda item: item.name)
def test_every_switch_has_a_section(item):
    assert section_of(TEXT, item.name).strip()


@pytest.mark.parametrize("item", SWITCHES, ids=lambda item: item.name)
def test_the_table_has_every_default(item):
    assert table_row(item) in TEXT


@pytest.mark.parametrize("name", METHOD.metadata["choices"])
def test_every_method_is_described(name):
    assert f"- **`{name}`**" in section_of(TEXT, "method")


@pytest.mark.parametrize("image", ["diffuse", "environment_diffuse", "visibility", "known_diffuse"])
def test_every_image_is_explained(image):
    assert f"| `light.{image}` |" in TEXT


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_as_stated(name):
    rays, bounces = (PRESETS[name]["diffuse"][key] for key in ("rays", "bounces"))
    stated = " ".join(TEXT.split()).split("The presets set")[1].split(". ")[0]
    assert f"{rays} and {bounces} (`{name}`" in stated
