# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of methods follows the presets, and each is what its name says."""

from __future__ import annotations

from pathlib import Path

import pytest

from ssgi_addon import job_options
from ssgi_addon.bench.methods import (
    GI_LADDER,
    all_methods,
    chosen,
    cycles_method,
    shipped_preset,
    tiers,
)
from ssgi_addon.bench.options import BenchOptions, SceneSource, find_scenes
from ssgi_addon.bench.store import Record, SceneState, load_scene, method_key, scene_folder, scene_key
from ssgi_addon.bench.tasks import Task, read_task, write_task
from ssgi_addon.core.settings import PRESETS
from ssgi_addon.errors import SSGIError
from ssgi_addon.job_options import BEYOND_FRAME, DEFAULT_PRESET, JobOptions

SIZE = (64, 36)


@pytest.mark.parametrize("quick", [False, True])
def test_names_are_unique_and_every_direct_light_that_is_needed_is_measured(quick):
    methods = all_methods(quick=quick)
    names = [method.name for method in methods]
    assert len(set(names)) == len(names)
    assert {method.direct_partner for method in methods} - {None} <= set(names)


def test_quick_run_measures_a_part_of_the_same_methods():
    full = all_methods()
    quick = all_methods(quick=True)
    assert set(quick) < set(full)
    assert {method.line for method in quick} >= {shipped_preset(preset).line for preset in PRESETS}


def test_ladder_of_cycles_is_that_of_the_specification():
    for denoiser in ("raw", "fastest", "best"):
        line = cycles_method("gi", 1, denoiser).line
        assert tuple(m.samples for m in all_methods() if m.line == line) == GI_LADDER


@pytest.mark.parametrize("preset", list(PRESETS))
def test_shipped_preset_is_the_preset(preset):
    expected = JobOptions.preset(preset, Path("."), resolution=SIZE)
    assert shipped_preset(preset).job_options(SIZE) == expected
    ladder = [method for method in all_methods() if method.line == shipped_preset(preset).line]
    assert [method.samples for method in ladder] == sorted(method.samples for method in ladder)
    assert sum(method.role == "preset" for method in ladder) == 1


def test_presets_that_change_take_their_methods_with_them(monkeypatch):
    monkeypatch.setitem(job_options.RENDERED, "draft", {"samples": 3, "stations": 0})
    found = shipped_preset("draft")
    assert (found.samples, found.job_options(SIZE).stations) == (3, 0)
    assert found.name in [method.name for method in all_methods()]


def test_each_switch_changes_what_its_name_says_and_all_layers_have_one():
    base = shipped_preset(DEFAULT_PRESET).job_options(SIZE)
    switches = [method for method in all_methods() if method.role == "switch"]
    for method in switches:
        assert method.job_options(SIZE) != base, method.name
        assert method.samples == base.samples
    changed = {name for method in switches for name, _ in method.changes}
    assert changed >= set(BEYOND_FRAME) | {"diffuse.method", "reflections.method"}


def test_words_choose_methods_with_the_direct_light_that_they_need():
    names = [method.name for method in chosen(all_methods(), ["gi 4 + FASTEST"])]
    assert names == [
        "Cycles direct only 4 + fastest denoise",
        "Cycles GI 4 + fastest denoise",
        "Cycles Fast GI 4 + fastest denoise",
    ]
    assert chosen(all_methods(), ["no such thing"]) == []
    assert chosen(all_methods(), []) == all_methods()


def test_main_methods_come_first_and_switches_last():
    main, ladders, switches = tiers(all_methods())
    assert {*main, *ladders, *switches} == set(all_methods())
    assert len(main) + len(ladders) + len(switches) == len(all_methods())
    assert all(method.headline for method in main)
    assert {method.role for method in ladders} == {"ladder"}
    assert tiers(chosen(all_methods(), ["EEVEE"])) == [chosen(all_methods(), ["EEVEE"])]


def test_key_of_a_method_follows_its_options_the_scene_and_the_size(monkeypatch):
    options = BenchOptions(Path("out"), resolution=SIZE)
    method = shipped_preset("draft")
    keys = [
        method_key(method, "scene", options),
        method_key(method, "other scene", options),
        method_key(method, "scene", BenchOptions(Path("out"), resolution=(65, 36))),
        method_key(shipped_preset("final"), "scene", options),
    ]
    monkeypatch.setitem(job_options.RENDERED, "draft", {"budget": 0.25})
    keys.append(method_key(shipped_preset("draft"), "scene", options))
    assert len(set(keys)) == len(keys)
    elsewhere = BenchOptions(Path("elsewhere"), resolution=SIZE, repeats=9)
    assert method_key(shipped_preset("draft"), "scene", elsewhere) == keys[-1]


def test_scenes_are_found_by_name_and_by_file(tmp_path, monkeypatch):
    for name in ("kitchen", "attic"):
        (tmp_path / f"{name}.blend").write_bytes(name.encode())
    monkeypatch.delenv("SSGI_SCENES", raising=False)
    out = Path("out")
    assert find_scenes(BenchOptions(out)) == [SceneSource("demo", None)]
    monkeypatch.setenv("SSGI_SCENES", str(tmp_path))
    both = [SceneSource(name, tmp_path / f"{name}.blend") for name in ("attic", "kitchen")]
    assert find_scenes(BenchOptions(out)) == both
    assert find_scenes(BenchOptions(out, quick=True)) == both[:1]
    path = str(tmp_path / "kitchen.blend")
    assert find_scenes(BenchOptions(out, scenes=("demo", path))) == [SceneSource("demo", None), both[1]]
    with pytest.raises(SSGIError, match="no scene cellar .* one of demo, attic, kitchen"):
        find_scenes(BenchOptions(out, scenes=("cellar",)))
    with pytest.raises(SSGIError, match="check the path"):
        find_scenes(BenchOptions(out, scenes=("cellar.blend",)))
    with pytest.raises(SSGIError, match="two scenes are called kitchen"):
        find_scenes(BenchOptions(out, scenes=("kitchen", path)))


def test_task_comes_back_as_it_was_written(tmp_path):
    options = BenchOptions(
        tmp_path / "out", scenes=("demo",), methods=("draft",), resolution=SIZE, cache=tmp_path / "cache"
    )
    task = Task("cold", options, SceneSource("a", tmp_path / "a.blend"), 12.5, "ours, draft (16)")
    write_task(task, tmp_path / "task.json")
    assert read_task(tmp_path / "task.json") == task


def test_state_of_a_scene_comes_back_until_its_file_changes(tmp_path):
    path = tmp_path / "a.blend"
    path.write_bytes(b"one")
    source, options = SceneSource("a", path), BenchOptions(tmp_path)
    state = SceneState("a", scene_key(source))
    method = cycles_method("gi", 4, "fastest")
    record = state.record(method, "key")
    assert [record.add_run(seconds) for seconds in (2.0, 3.0, 1.0)] == [True, False, True]
    folder = scene_folder(options, "a")
    state.save(folder)
    assert load_scene(folder, source) == state
    assert load_scene(folder, source).record(method, "key").seconds == [2.0, 3.0, 1.0]
    assert load_scene(folder, source).record(method, "other key") != record
    path.write_bytes(b"two")
    assert load_scene(folder, source).records == {}
    assert Record("key").seconds == []
