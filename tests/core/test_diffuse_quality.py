# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of the diffuse pass scores variants; what it is told and what it draws."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import cycles_truth, diffuse_quality, hemisphere_truth, summary
from benchmarks.frontier_plot import Point, draw_frontiers, on_frontier
from benchmarks.inputs import analytic_room
from benchmarks.variants import noise_of, parse_variant
from ssgi_addon.core import DiffuseSettings, ReflectionSettings, Settings
from ssgi_addon.core.metrics import relmse
from tests.tolerances import BIAS_OF_FEW_RAYS, CLOSED_FORM_RELATIVE, REPEATED_SUM

FEW, MANY = "rays=1,filter=false", "method=hemisphere,rays=16,filter=false"
SIZE, RAYS = (36, 24), 64


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the benchmark on a tiny room with the given words; return what it stored."""
    room = analytic_room(*SIZE)
    monkeypatch.setattr(hemisphere_truth, "CACHE", tmp_path / "cache")
    monkeypatch.setattr(diffuse_quality, "captured_frame", lambda name, size: room)

    def main(*words):
        output = tmp_path / "result.json"
        words = [*words, "--scenes", "room", "--size", "{}x{}".format(*SIZE), "--truth-rays", str(RAYS)]
        monkeypatch.setattr(sys, "argv", ["diffuse_quality", *words, "--output", str(output)])
        diffuse_quality.main()
        return json.loads(output.read_text(encoding="utf-8"))

    return main


def test_more_rays_are_nearer_to_the_integral(run):
    stored = run("--variant", FEW, "--variant", MANY, "--rounds", "2")
    few, many = stored["results"]["scores"]
    assert (few["variant"], many["variant"]) == (FEW, MANY)
    assert many["rays"] == 16 * few["rays"]
    for error in ("relmse", "rms", "visibility_error"):
        assert many[error] < few[error]
    assert many["noise"] < many["relmse"]
    assert few["spread"] >= 0.0
    # The nearest of all is on the frontier at any speed
    (row,) = (line for line in summary.diffuse_quality(stored).splitlines() if f"`{MANY}`" in line)
    assert row.endswith("| yes |")


def test_truth_is_computed_once_and_anew_for_another_frame(tmp_path, monkeypatch):
    monkeypatch.setattr(hemisphere_truth, "CACHE", tmp_path)
    room = analytic_room(*SIZE)
    first = hemisphere_truth.hemisphere_truth("room", room, RAYS)
    for kept in tmp_path.glob("*.npy"):
        np.save(kept, np.load(kept) + 1.0)
    again = hemisphere_truth.hemisphere_truth("room", room, RAYS)
    np.testing.assert_array_equal(again.halves, first.halves + 1.0)
    brighter = replace(room, gbuffer=replace(room.gbuffer, source=2.0 * room.gbuffer.diffuse_source))
    other = hemisphere_truth.hemisphere_truth("room", brighter, RAYS)
    np.testing.assert_allclose(other.diffuse, 2.0 * first.diffuse, rtol=REPEATED_SUM)


def test_truth_with_more_rays_adds_to_one_with_fewer(tmp_path, monkeypatch):
    monkeypatch.setattr(hemisphere_truth, "CACHE", tmp_path)
    monkeypatch.setattr(hemisphere_truth, "_RAYS_PER_PART", RAYS // 4)
    room = analytic_room(*SIZE)
    fewer = hemisphere_truth.hemisphere_truth("room", room, RAYS // 2)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npy")}
    more = hemisphere_truth.hemisphere_truth("room", room, RAYS)
    after = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npy")}
    assert len(before) == 2
    assert len(after) == 4
    assert before.items() <= after.items()
    for name in ("diffuse", "visibility", "known"):
        assert getattr(more, name).shape == getattr(fewer, name).shape
        expected = pytest.approx(getattr(fewer, name).mean(), rel=CLOSED_FORM_RELATIVE)
        assert getattr(more, name).mean() == expected
    assert ((more.halves[0] - more.halves[1]) ** 2).sum() < ((fewer.halves[0] - fewer.halves[1]) ** 2).sum()


@pytest.mark.parametrize("rays", [0, 1, 3, 768])
def test_truth_of_uneven_halves_is_refused(rays):
    with pytest.raises(ValueError, match="multiple of"):
        hemisphere_truth.hemisphere_truth("room", analytic_room(*SIZE), rays)


def test_cycles_judges_pixels_that_are_known_well_enough(run, monkeypatch):
    # A room that is closed behind the camera, too, would be known all over; this one is in parts
    room = analytic_room(*SIZE)
    light = hemisphere_truth.diffuse_light(room, DiffuseSettings(rays=64, filter=False), seed=3)
    halves = np.stack([light.diffuse, light.diffuse])
    truth = cycles_truth.CyclesTruth(room, halves, halves, is_floor=False)
    monkeypatch.setattr(diffuse_quality, "cycles_truth", lambda name, size, samples, bounces: truth)
    monkeypatch.setattr(diffuse_quality, "KNOWN_ENOUGH", 0.5)
    stored = run("--cycles", "--variant", FEW, "--variant", MANY, "--rounds", "1")
    few, many = stored["results"]["scores"]
    assert 0 < few["pixels"] < SIZE[0] * SIZE[1]
    assert many["relmse"] < few["relmse"]
    assert few["visibility_error"] is None
    assert f"| room | `{MANY}` | {many['pixels']} |" in summary.diffuse_cycles(stored)
    figures = stored["results"]["overall"][MANY]
    assert figures["median_bias"] == pytest.approx(abs(many["bias"]))


def test_bounces_are_those_of_cycles_and_ours(run, monkeypatch):
    room = analytic_room(*SIZE)
    asked = []

    def truth(name, size, samples, bounces):
        # Nobody knows how often: the light of that many bounces of ours
        settings = DiffuseSettings(rays=256, filter=False, bounces=bounces or 4)
        light = hemisphere_truth.diffuse_light(room, settings, seed=3)
        asked.append(bounces)
        halves = np.stack([light.diffuse, light.diffuse])
        return cycles_truth.CyclesTruth(room, halves, halves, is_floor=False)

    monkeypatch.setattr(diffuse_quality, "cycles_truth", truth)
    monkeypatch.setattr(diffuse_quality, "KNOWN_ENOUGH", 0.5)
    words = ("--cycles", "--variant", MANY, "--rounds", "1")
    for more in ((), ("--bounces", "1"), ("--bounces", "2")):
        (score,) = run(*words, *more)["results"]["scores"]
        assert score["bias"] == pytest.approx(0.0, abs=BIAS_OF_FEW_RAYS)
    assert asked == [None, 1, 2]


def test_frame_that_answers_no_pixel_gives_no_score(capsys):
    room = analytic_room(*SIZE)
    light = np.zeros((2, *room.gbuffer.shape, 3))
    target = diffuse_quality.Target("room", room, light, None, np.zeros(room.gbuffer.shape, bool))
    assert list(diffuse_quality.measure(target, {FEW: DiffuseSettings()}, 1)) == []
    assert "no pixel" in capsys.readouterr().out


def test_noise_of_a_reference_is_what_it_adds_to_the_error_of_the_truth_itself(rng):
    truth = np.ones((64, 64, 3))
    halves = truth + 0.1 * rng.standard_normal((2, *truth.shape))
    added = relmse(truth, halves.mean(axis=0), trim=0.0)
    is_all = np.ones(truth.shape[:2], bool)
    assert noise_of(halves, is_all) == pytest.approx(added, rel=3 * CLOSED_FORM_RELATIVE)


def test_variant_names_what_differs_from_the_base():
    assert parse_variant("rays=7,filter=false", DiffuseSettings(bounces=1)) == DiffuseSettings(
        rays=7, filter=False, bounces=1
    )
    assert parse_variant("rays=7,filter=false,method=linear", ReflectionSettings()) == ReflectionSettings(
        rays=7, filter=False, method="linear"
    )
    assert parse_variant("max_steps=9,thickness=0.5", Settings()) == Settings(max_steps=9, thickness=0.5)


@pytest.mark.parametrize("text", ["ray=1", "rays=one", "filter=0", "rays=0", "rays", "method=guess", ""])
@pytest.mark.parametrize("base", [DiffuseSettings(), ReflectionSettings()])
def test_variant_that_means_nothing_is_refused(text, base):
    with pytest.raises(argparse.ArgumentTypeError):
        parse_variant(text, base)


def test_frontier_is_what_nothing_beats():
    points = [Point("", "", *values) for values in ((1, 9), (2, 5), (3, 5), (4, 6), (5, 1), (5, 1))]
    assert on_frontier(points) == [True, True, False, False, True, True]


def test_each_scene_has_a_panel_and_each_ladder_a_line(run, tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "frontier.png"
    run("--variant", FEW, "--variant", MANY, "--rounds", "1", "--plot", str(picture))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_points_of_one_ladder_share_a_line():
    scores = [
        diffuse_quality.Score("room", variant, 1.0, 0.0, 1, 1, 1.0, 0.0, 1.0, None, None, 0.0)
        for variant in ("rays=1", "rays=2", "rays=1,filter=false", "method=hemisphere,rays=4,filter=false")
    ]
    points = diffuse_quality.frontier_points(scores)
    assert {point.panel for point in points} == {"room", "geometric mean"}
    lines = ["default", "default", "filter=false", "method=hemisphere,filter=false"]
    assert [point.line for point in points] == 2 * lines


def test_picture_is_drawn_for_any_number_of_panels(tmp_path):
    pytest.importorskip("matplotlib")
    points = [Point(f"scene {number % 4}", "line", 1.0 + number, 1.0 / (1 + number)) for number in range(8)]
    draw_frontiers(points, tmp_path / "frontier.png")
    assert (tmp_path / "frontier.png").is_file()
