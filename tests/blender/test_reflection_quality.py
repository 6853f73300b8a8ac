# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of reflections scores variants against a truth that was rendered once."""

from __future__ import annotations

import json
import sys

import pytest

pytest.importorskip("bpy")

from benchmarks import cycles_truth, reflection_quality

FEW, MANY = "rays=1,reuse=0,filter=false", "rays=32,reuse=0,filter=false"


SIZE, SAMPLES = "36x24", "16"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the benchmark on a tiny floor whose truth is there already; return what it stored."""
    monkeypatch.setattr(cycles_truth, "CACHE", tmp_path / "cache")
    monkeypatch.setattr(sys, "argv", ["cycles_truth", "floor_0.4", SIZE, SAMPLES])
    cycles_truth.main()

    def main(*variants):
        output = tmp_path / "result.json"
        words = ["--roughness", "0.4", "--scenes", "--size", SIZE, "--samples", SAMPLES, "--rounds", "1"]
        words += [word for variant in variants for word in ("--variant", variant)]
        monkeypatch.setattr(sys, "argv", ["reflection_quality", *words, "--output", str(output)])
        reflection_quality.main()
        return json.loads(output.read_text(encoding="utf-8"))["results"]

    return main


def test_more_rays_are_nearer_to_cycles(run):
    result = run(FEW, MANY)
    few, many = result["scores"]
    assert (few["variant"], many["variant"]) == (FEW, MANY)
    assert many["relmse"] < few["relmse"]
    assert many["rays"] == 32 * few["rays"]
    assert result["ratios"][MANY]["relmse"] == pytest.approx(many["relmse"] / few["relmse"])
