# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark end to end, tiny: a page at the end, nothing measured twice, the scene as before."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("matplotlib")

from ssgi_addon.bench.methods import all_methods, chosen
from ssgi_addon.bench.options import BenchOptions
from ssgi_addon.bench.points import read_csv
from ssgi_addon.bench.store import SceneState
from ssgi_addon.blender.bench_flicker import FRAMES, CameraMove
from ssgi_addon.blender.bench_renders import run_method
from ssgi_addon.blender.bench_scene import SceneBench
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.restore import Restorer
from ssgi_addon.child import environment
from ssgi_addon.cli import main
from tests.blender.fingerprint import changes, fingerprint
from tests.faults.kills import ends
from tests.scenes import build_closed_room

SIZE = (64, 36)
WORDS = ("GI 1 + fastest", "ours, draft (")


def measured(report):
    scene = json.loads((report / "report.json").read_text())["scenes"][0]
    return {name: (record["seconds"], record["date"]) for name, record in scene["records"].items()}


def test_tiny_run_ends_in_a_page_and_the_next_one_measures_nothing_again(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("SSGI_SCENES", raising=False)
    report = tmp_path / "report"
    line = [
        "bench",
        "--quick",
        "--output",
        str(report),
        "--no-cold",
        "--repeats",
        "1",
        "--reference-samples",
        "2",
    ]
    line += ["--resolution", "64x36", "--scenes", "demo", "--methods", *WORDS]
    assert main(line) == 0
    out, err = capsys.readouterr()
    assert f"report: {report / 'index.html'}" in out
    assert "demo: Reference 1 of 2" in err
    names = [method.name for method in chosen(all_methods(quick=True), WORDS)]
    points = read_csv(report / "points.csv")
    assert [point.method for point in points] == names
    for point in points:
        assert point.score("picture") > 0.0
        assert (point.score("diffuse") is None) == (point.kind != "ours")
        assert point.beyond_direct is None or 0.0 < point.beyond_direct < point.seconds
    assert (report / "index.html").is_file()
    first = measured(report)
    (reference,) = (tmp_path / ".cache" / "references").glob("*.npz")
    written = reference.stat().st_mtime_ns

    assert main(line) == 0
    assert measured(report) == first
    assert reference.stat().st_mtime_ns == written


@pytest.fixture
def room(empty_file):
    return build_closed_room()


def bench(room, folder, *words, progress=lambda fraction, text: None):
    options = BenchOptions(folder / "out", resolution=SIZE, repeats=1, reference_samples=2, quick=True)
    state = SceneState("room", "key")
    methods = chosen(all_methods(quick=True), words)
    return SceneBench(room, options, methods, state, 1e12, progress), state


def test_scene_is_as_before_also_when_the_run_is_stopped(room, tmp_path):
    before = fingerprint()
    work, state = bench(room, tmp_path, *WORDS)
    work.measure()
    assert all(record.seconds for record in state.records.values())
    assert changes(before, fingerprint()) == {}

    def stop(fraction, text):
        if text.startswith("ours"):
            raise KeyboardInterrupt

    work, _ = bench(room, tmp_path, *WORDS, progress=stop)
    with pytest.raises(KeyboardInterrupt):
        work.measure()
    assert changes(before, fingerprint()) == {}


def test_method_that_fails_is_noted_and_the_others_are_measured(room, tmp_path, monkeypatch):
    def fail(scene, method, size, **changes):
        if method.light == "gi":
            raise ZeroDivisionError("no light")
        return run_method(scene, method, size, **changes)

    monkeypatch.setattr("ssgi_addon.blender.bench_scene.run_method", fail)
    work, state = bench(room, tmp_path, "GI 1 + fastest")
    work.measure()
    assert state.records["Cycles GI 1 + fastest denoise"].failure == "ZeroDivisionError: no light"
    assert state.records["Cycles direct only 1 + fastest denoise"].seconds


def test_nothing_starts_after_the_deadline_but_the_reference(room, tmp_path):
    work, state = bench(room, tmp_path, "GI 1 + fastest")
    work.deadline = 0.0
    work.measure()
    assert state.reference["own_error"]["combined"] > 0.0
    assert set(state.left_out.values()) == {"the time was up"}
    assert not any(record.seconds for record in state.records.values())


def test_indirect_light_of_ours_and_of_cycles_is_told_in_the_reference_s_direct_light(room, tmp_path):
    """A method that is the reference itself, without its noise, has no error left but the noise."""
    work, state = bench(room, tmp_path, "GI 16 + fastest", "GI 1 + fastest")
    work.measure()
    errors = [
        state.records[f"Cycles GI {samples} + fastest denoise"].best["scores"]["replaced"]["all"]["relmse"]
        for samples in (1, 16)
    ]
    nothing = state.reference["without_indirect"]["all"]["relmse"]
    assert errors[1] < errors[0] < nothing


def test_camera_moves_a_little_from_frame_to_frame_and_is_put_back(room):
    before = fingerprint()
    options = CaptureOptions(samples=1, denoiser="none", resolution=SIZE)
    own = capture_frame(room, options).camera.world_from_view
    with Restorer() as restorer:
        poses = [capture_frame(room, options).camera.world_from_view for _ in CameraMove(restorer, room, 3.0)]
    assert len(poses) == FRAMES
    assert np.allclose(poses[0], own, atol=1e-5)
    steps = [np.abs(one - other).max() for one, other in zip(poses[1:], poses[:-1], strict=True)]
    assert min(steps) > 0.0
    assert max(steps) < 0.02
    assert changes(before, fingerprint()) == {}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at processes as Linux shows them")
def test_process_that_measures_ends_with_the_one_that_waits_for_it(tmp_path):
    line = [
        "bench",
        "--quick",
        "--output",
        str(tmp_path / "report"),
        "--resolution",
        "64x36",
        "--scenes",
        "demo",
    ]
    with subprocess.Popen(
        [sys.executable, "-m", "ssgi_addon", *line], env=environment(), stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        for told in process.stderr:
            if "demo: " in told:
                break
        (worker,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.kill()
    assert ends(int(worker))
