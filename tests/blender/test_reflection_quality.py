# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of reflections scores variants against a truth that was rendered once."""

from __future__ import annotations

import argparse
import json
import sys

import pytest

pytest.importorskip("bpy")

from benchmarks import glossy_truth, reflection_quality
from ssgi_addon.core import ReflectionSettings

FEW, MANY = "rays=1,reuse=0,filter=false", "rays=32,reuse=0,filter=false"


SIZE, SAMPLES = "36x24", "16"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the benchmark on a tiny floor whose truth is there already; return what it stored."""
    monkeypatch.setattr(glossy_truth, "CACHE", tmp_path / "cache")
    monkeypatch.setattr(sys, "argv", ["glossy_truth", "floor_0.4", SIZE, SAMPLES])
    glossy_truth.main()

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


def test_variant_names_what_differs_from_the_defaults():
    settings = reflection_quality.parse_variant("rays=7,filter=false,method=linear")
    assert settings == ReflectionSettings(rays=7, filter=False, method="linear")


@pytest.mark.parametrize("text", ["ray=1", "rays=one", "filter=0", "rays=0", "rays"])
def test_variant_that_means_nothing_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError):
        reflection_quality.parse_variant(text)
