# SPDX-License-Identifier: GPL-3.0-or-later
"""A run goes on where processes crash, and where an earlier run ended; Blender's part is made up here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import ClassVar

import pytest

pytest.importorskip("matplotlib")

from ssgi_addon import cli
from ssgi_addon.bench import command, run
from ssgi_addon.bench.options import (
    QUICK_MINUTES,
    QUICK_REFERENCE_SAMPLES,
    QUICK_REPEATS,
    BenchOptions,
    SceneSource,
)
from ssgi_addon.bench.store import load_scene, scene_folder
from ssgi_addon.errors import SSGIError
from tests.core.bench_points import METHODS, made_up_state


@pytest.fixture
def processes(monkeypatch):
    """Stand in for Blender: measures all methods that have no record, and does what `crashes` says."""

    class Fake(run._Processes):
        crashes: ClassVar[dict[str, str]] = {}
        started: ClassVar[list[tuple[str, str]]] = []

        def run(self, kind, method=""):
            self.started.append((self.source.name, kind))
            state = load_scene(self.folder, self.source)
            if kind == "cold":
                (self.folder / "cold.json").write_text('{"seconds": 9.0, "memory_mb": 300.0}')
                return None
            if self.source.name in self.crashes:
                return self.crashes[self.source.name]
            made_up = made_up_state(self.source.name)
            state.reference, state.facts = made_up.reference, made_up.facts
            for name, record in made_up.records.items():
                if name in state.records:
                    continue
                if name in self.crashes:
                    state.running = name
                    state.records[name] = type(record)(record.key)
                    state.save(self.folder)
                    return self.crashes[name]
                state.records[name] = record
            state.save(self.folder)
            return None

    monkeypatch.setattr(run, "_Processes", Fake)
    monkeypatch.setattr(
        run, "find_scenes", lambda options: [SceneSource(name, None) for name in options.scenes]
    )
    Fake.crashes, Fake.started = {}, []
    return Fake


def run_it(folder, *scenes, **changes):
    options = BenchOptions(folder / "out", scenes=scenes, quick=True, **changes)
    return options, run.run_bench(options, lambda fraction, text: None)


def read_scenes(page):
    scenes = json.loads((page.parent / "report.json").read_text())["scenes"]
    return {scene["name"]: scene for scene in scenes}


def test_method_that_crashes_costs_nothing_else(processes, tmp_path):
    crashing = METHODS[3].name
    processes.crashes = {crashing: "exit status -11"}
    _, page = run_it(tmp_path, "attic")
    records = read_scenes(page)["attic"]["records"]
    assert records[crashing]["failure"] == "Blender ended during it: exit status -11"
    assert all(records[method.name]["seconds"] for method in METHODS[:-1] if method.name != crashing)
    assert processes.started.count(("attic", "measure")) == 2
    assert "Blender ended during it" in page.read_text(encoding="utf-8")


def test_scene_that_cannot_be_measured_costs_nothing_else(processes, tmp_path):
    processes.crashes = {"attic": "it has no camera"}
    _, page = run_it(tmp_path, "attic", "cellar")
    scenes = read_scenes(page)
    assert scenes["attic"]["failure"] == "it has no camera"
    assert scenes["cellar"]["failure"] is None
    assert len(scenes["cellar"]["records"]) == len(METHODS)


def test_run_in_which_no_scene_can_be_measured_fails(processes, tmp_path):
    processes.crashes = {"attic": "it has no camera"}
    with pytest.raises(SSGIError, match="no scene could be measured: it has no camera"):
        run_it(tmp_path, "attic")
    assert (tmp_path / "out" / "index.html").is_file()


def test_next_run_keeps_what_is_measured_and_tries_again_what_failed(processes, tmp_path):
    crashing = METHODS[3].name
    processes.crashes = {crashing: "exit status -11"}
    run_it(tmp_path, "attic")
    processes.crashes = {}
    options, page = run_it(tmp_path, "attic")
    record = read_scenes(page)["attic"]["records"][crashing]
    assert record["failure"] is None
    assert record["seconds"]
    state = load_scene(scene_folder(options, "attic"), SceneSource("attic", None))
    assert {record.cold["seconds"] for record in state.records.values() if record.cold} == {9.0}


def test_main_methods_alone_are_measured_cold_and_once(processes, tmp_path):
    run_it(tmp_path, "attic")
    run_it(tmp_path, "attic")
    headlines = sum(method.headline for method in METHODS)
    assert processes.started.count(("attic", "cold")) == headlines


def test_unknown_method_is_refused(processes, tmp_path):
    with pytest.raises(SSGIError, match="no method is called radiosity"):
        run_it(tmp_path, "attic", methods=("radiosity",))


def test_estimate_grows_with_the_pixels_and_names_the_limit():
    small, large = (
        run.estimate(BenchOptions("out", resolution=size, minutes=30.0), METHODS, 2)
        for size in ((480, 270), (1920, 1080))
    )
    assert "stopped after 30" in small
    assert int(small.split("roughly ")[1].split()[0]) < int(large.split("roughly ")[1].split()[0])


@pytest.fixture
def asked(monkeypatch):
    """Stand in for the run, and keep the options that it was asked for."""
    found = []

    def run_bench(options, progress, *, blender):
        found.append((options, blender))
        return options.output / "index.html"

    monkeypatch.setattr(run, "run_bench", run_bench)
    monkeypatch.setattr(command, "require_bpy", lambda: None)
    return found


def test_command_line_has_the_defaults_of_the_options(asked, capsys):
    assert cli.main(["bench", "--output", "out"]) == 0
    assert asked == [(BenchOptions(Path("out")), "")]
    assert capsys.readouterr().out == f"report: {Path('out') / 'index.html'}\n"


def test_command_line_hands_every_option_on(asked):
    line = (
        "bench --output out --scenes demo a.blend --methods GI draft --resolution 96x54 --repeats 5 "
        "--reference-samples 7 --budget 2.5 --no-cold --flicker --cache kept --fresh"
    )
    assert cli.main(line.split()) == 0
    assert asked[0][0] == BenchOptions(
        Path("out"),
        scenes=("demo", "a.blend"),
        methods=("GI", "draft"),
        resolution=(96, 54),
        repeats=5,
        reference_samples=7,
        minutes=2.5,
        cold=False,
        flicker=True,
        cache=Path("kept"),
        fresh=True,
    )


def test_quick_run_repeats_less_unless_it_is_told_how_often(asked):
    assert cli.main(["bench", "--output", "out", "--quick"]) == 0
    assert cli.main(["bench", "--output", "out", "--quick", "--repeats", "7"]) == 0
    assert [options.repeats for options, _ in asked] == [QUICK_REPEATS, 7]
    assert {options.minutes for options, _ in asked} == {QUICK_MINUTES}
    assert cli.main(["bench", "--output", "out", "--quick", "--scenes", "a", "b", "c"]) == 0
    assert asked[-1][0].minutes == 3.0 * QUICK_MINUTES
    assert {options.reference_samples for options, _ in asked} == {QUICK_REFERENCE_SAMPLES}


@pytest.mark.parametrize(
    "line",
    ["bench", "bench --output out --repeats 0", "bench --output out --quick --flicker", "bench-worker"],
)
def test_bad_usage_is_refused(asked, line):
    assert cli.main(line.split()) == 2
    assert asked == []


def test_worker_stands_in_no_help(capsys):
    assert cli.main(["--help"]) == 0
    out = capsys.readouterr().out
    assert "bench " in out
    assert "bench-worker" not in out
