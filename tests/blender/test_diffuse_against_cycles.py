# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of the diffuse pass scores variants against Cycles' Diffuse Indirect, rendered once."""

from __future__ import annotations

import json
import sys

import pytest

bpy = pytest.importorskip("bpy")

from benchmarks import cycles_truth, diffuse_quality
from tests.scenes import build_closed_room

SCENE, SIZE, SAMPLES = "closed_room", "36x24", "32"
FEW, MANY = "rays=1,filter=false", "rays=16,filter=false"


@pytest.fixture
def run(tmp_path, monkeypatch, empty_file):
    """Run the benchmark on a tiny closed room whose truth is there already; return what it stored."""
    build_closed_room()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / f"{SCENE}.blend"))
    monkeypatch.setattr(cycles_truth, "SCENES", tmp_path)
    monkeypatch.setattr(cycles_truth, "CACHE", tmp_path / "cache")
    monkeypatch.setattr(sys, "argv", ["cycles_truth", SCENE, SIZE, SAMPLES])
    cycles_truth.main()
    monkeypatch.setattr(cycles_truth, "run_module", None)  # nothing is rendered twice

    def main(*variants):
        output = tmp_path / "result.json"
        words = ["--cycles", "--size", SIZE, "--samples", SAMPLES, "--rounds", "1", "--output", str(output)]
        words += [word for variant in variants for word in ("--variant", variant)]
        monkeypatch.setattr(sys, "argv", ["diffuse_quality", *words])
        diffuse_quality.main()
        return json.loads(output.read_text(encoding="utf-8"))["results"]

    return main


def test_more_rays_are_nearer_to_cycles_in_every_scene_that_is_there(run):
    few, many = run(FEW, MANY)["scores"]
    assert few["scene"] == many["scene"] == SCENE
    assert few["pixels"] == many["pixels"] > 0
    assert many["relmse"] < few["relmse"]
    assert many["noise"] < many["relmse"]


def test_one_render_keeps_both_passes(run):
    width, height = map(int, SIZE.split("x"))
    truth = cycles_truth.cycles_truth(SCENE, (width, height), int(SAMPLES))
    assert truth.diffuse_halves.shape == truth.glossy_halves.shape == (2, height, width, 3)
    assert truth.diffuse_halves.mean() > 0.0
    assert (truth.diffuse_halves[0] != truth.diffuse_halves[1]).any()
    # Its walls are matte
    assert (truth.glossy_halves == 0.0).all()
    assert truth.frame.views
