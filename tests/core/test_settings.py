# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings: each stands once, with all that an interface shows of it, and refuses what it cannot mean."""

from __future__ import annotations

import itertools
import math
from dataclasses import FrozenInstanceError, fields, replace

import pytest

from ssgi_addon.core import DiffuseSettings, ReflectionSettings, Settings
from ssgi_addon.core.cells import STRIDES
from ssgi_addon.core.settings import PRESETS

KINDS = (Settings, ReflectionSettings, DiffuseSettings)
OPTIONS = [(kind, item) for kind in KINDS for item in fields(kind) if item.metadata]
IDS = [f"{kind.__name__}.{item.name}" for kind, item in OPTIONS]


def test_every_field_is_an_option_or_a_group_of_them():
    groups = {item.name for kind in KINDS for item in fields(kind) if not item.metadata}
    assert groups == {"reflections", "diffuse"}


@pytest.mark.parametrize(("kind", "item"), OPTIONS, ids=IDS)
def test_every_option_says_what_it_is(kind, item):
    assert item.metadata["label"]
    assert len(item.metadata["help"]) > len(item.metadata["label"])
    is_number = isinstance(item.default, (int, float)) and not isinstance(item.default, bool)
    if is_number:
        assert item.metadata["min"] is not None
    if isinstance(item.default, str):
        assert item.default in item.metadata["choices"]


@pytest.mark.parametrize(("kind", "item"), OPTIONS, ids=IDS)
def test_ranges_end_where_they_say(kind, item):
    for bound, beyond in (("min", -1), ("max", 1)):
        limit = item.metadata[bound]
        if limit is None:
            continue
        assert getattr(kind(**{item.name: limit}), item.name) == limit
        with pytest.raises(ValueError, match=rf"^{kind.__name__}\.{item.name}: expected .*got"):
            kind(**{item.name: limit + beyond})


@pytest.mark.parametrize(("kind", "item"), OPTIONS, ids=IDS)
@pytest.mark.parametrize("value", ["nonsense", math.nan, object(), [1]])
def test_values_of_no_meaning_are_named(kind, item, value):
    with pytest.raises(ValueError, match=rf"^{kind.__name__}\.{item.name}: expected .*got"):
        kind(**{item.name: value})


@pytest.mark.parametrize(("kind", "item"), OPTIONS, ids=IDS)
def test_booleans_are_no_numbers_and_numbers_no_booleans(kind, item):
    value = 1 if isinstance(item.default, bool) else True
    with pytest.raises(ValueError, match=rf"^{kind.__name__}\.{item.name}: expected .*got"):
        kind(**{item.name: value})


@pytest.mark.parametrize("name", ["rays", "bounces"])
def test_counts_are_whole_numbers(name):
    with pytest.raises(ValueError, match=rf"^DiffuseSettings\.{name}: expected an integer"):
        DiffuseSettings(**{name: 2.5})


@pytest.mark.parametrize("group", ["reflections", "diffuse"])
def test_groups_of_the_wrong_kind_are_named(group):
    with pytest.raises(ValueError, match=rf"^Settings\.{group}: expected .*got"):
        Settings(**{group: None})


def test_settings_are_frozen_all_the_way_down():
    settings = Settings()
    with pytest.raises(FrozenInstanceError):
        settings.seed = 1
    with pytest.raises(FrozenInstanceError):
        settings.diffuse.rays = 1


def test_replace_makes_variants_and_validates_them():
    settings = replace(Settings(), diffuse=replace(Settings().diffuse, rays=3), seed=9)
    assert (settings.diffuse.rays, settings.seed) == (3, 9)
    with pytest.raises(ValueError, match=r"^DiffuseSettings\.rays"):
        replace(settings.diffuse, rays=0)


def test_presets_differ_and_more_costs_more():
    found = [Settings.preset(name) for name in ("draft", "balanced", "final")]
    assert len(set(found)) == len(PRESETS) == 3
    for cheap, dear in itertools.pairwise(found):
        per_pixel = [of.diffuse.rays / STRIDES[of.diffuse.resolution] ** 2 for of in (cheap, dear)]
        assert per_pixel[0] <= per_pixel[1]
        assert cheap.reflections.rays <= dear.reflections.rays
        assert cheap.diffuse.bounces <= dear.diffuse.bounces
    for settings in found:
        assert settings.unknown == "environment"
        assert settings.reflections.enabled
        assert settings.diffuse.enabled


@pytest.mark.parametrize("name", ["best", "", None, 3])
def test_unknown_presets_are_named(name):
    with pytest.raises(ValueError, match=r"^preset: expected .*got"):
        Settings.preset(name)
