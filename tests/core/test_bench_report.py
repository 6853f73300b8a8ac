# SPDX-License-Identifier: GPL-3.0-or-later
"""The report holds every point, and its page needs nothing but itself."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from ssgi_addon.bench import plots
from ssgi_addon.bench.options import BenchOptions
from ssgi_addon.bench.points import dots, points_of, read_csv, write_csv
from ssgi_addon.bench.report import write_report
from ssgi_addon.bench.store import picture_path, scene_folder
from ssgi_addon.bench.summary import YARDSTICKS, compare_all, compare_switches, mean_dots
from ssgi_addon.bench.tables import scene_table
from ssgi_addon.cli import main
from ssgi_addon.png import write_png
from ssgi_addon.tables import number
from tests.core.bench_points import METHODS, ONE_SAMPLE, OWN_ERROR, made_up_state
from tests.core.browser import open_page

SCENES = ("attic", "cellar <& co>")


@pytest.fixture
def states():
    return [made_up_state(name, scale) for name, scale in zip(SCENES, (1.0, 0.25))]


@pytest.fixture
def report(states, tmp_path):
    """The page of two scenes, with pictures of one method."""
    pytest.importorskip("matplotlib")
    options = BenchOptions(tmp_path / "out", scenes=SCENES)
    picture = np.zeros((4, 8, 3), np.uint8)
    folder = scene_folder(options, SCENES[0])
    write_png(folder / "reference.png", picture)
    for kind in ("picture", "error"):
        write_png(picture_path(folder, YARDSTICKS[0], kind), picture)
    return write_report(options, states, METHODS)


def test_csv_holds_all_that_was_measured(states, tmp_path):
    points = [point for state in states for point in points_of(state, METHODS)]
    write_csv(points, tmp_path / "points.csv")
    found = read_csv(tmp_path / "points.csv")
    assert found == points
    for one, other in zip(found, points, strict=True):
        for target in ("picture", "replaced", "diffuse"):
            assert one.score(target, "relmse", "rest") == other.score(target, "relmse", "rest")
            assert one.score(target, "flip") is None


def test_indirect_light_costs_what_direct_light_does_not(states):
    points = {point.method: point for point in points_of(states[0], METHODS)}
    gi, direct = points[YARDSTICKS[1]], points["Cycles direct only 4 + fastest denoise"]
    assert gi.beyond_direct == pytest.approx(gi.seconds - direct.seconds)
    assert direct.beyond_direct is None
    assert [dot.point.kind for dot in dots([gi, direct], "replaced")] == ["cycles"]


def test_points_near_the_reference_s_own_error_are_marked(states):
    points = points_of(states[1], METHODS)
    for point in points:
        assert point.is_above_reference == (point.score("picture") >= 10.0 * OWN_ERROR)
    assert {point.is_above_reference for point in points} == {True, False}
    rows = scene_table(points).rows
    assert [row[8].endswith("*") for row in rows] == [not point.is_above_reference for point in points]


def test_comparison_at_equal_time_is_the_ratio_of_the_curves(states):
    """Both error curves are e / samples over samples * s seconds: the ratio is the same at each time."""
    points = {state.name: points_of(state, METHODS) for state in states}
    rows = {row.title: row for row in compare_all(points)["picture"]}
    (s, e), (s_ours, e_ours) = ONE_SAMPLE["cycles"], ONE_SAMPLE["ours"]
    expected = (e_ours * s_ours) / (e * s)
    row = rows[f"error at the time of {YARDSTICKS[1]}"]
    assert row.ratios == pytest.approx(dict.fromkeys(SCENES, expected))
    assert row.mean == pytest.approx(expected)
    assert (row.wins, row.losses) == (0, 2)
    # Ours takes longer for one sample than the yardstick of one sample does
    row = rows[f"error at the time of {YARDSTICKS[0]}"]
    assert row.ratios == dict.fromkeys(SCENES)
    assert (row.mean, row.worst, row.wins, row.losses) == (None, None, 0, 2)


def test_all_scenes_together_are_relative_to_one_denoised_sample(states):
    """Errors of the second scene are a multiple of the first's, the yardstick's too: no ratio moves."""
    points = {state.name: points_of(state, METHODS) for state in states}
    together = {dot.point.method: dot for dot in mean_dots(points)}
    alone = {dot.point.method: dot for dot in dots(points[states[0].name], "picture")}
    yardstick = alone[YARDSTICKS[0]]
    for name, dot in together.items():
        assert dot.error == pytest.approx(alone[name].error / yardstick.error)
        assert dot.seconds == pytest.approx(alone[name].seconds / yardstick.seconds)
    assert not any(dot.point.role == "switch" for dot in together.values())
    assert mean_dots({states[0].name: points[states[0].name]}) == []


def test_what_one_scene_lacks_is_not_in_the_mean(states):
    points = {state.name: points_of(state, METHODS) for state in states}
    missing = points[states[1].name].pop(0)
    assert missing.method not in [dot.point.method for dot in mean_dots(points)]


def test_switch_is_told_against_the_preset(states):
    (switch,) = compare_switches({state.name: points_of(state, METHODS) for state in states})
    assert switch.method.endswith("bitmask")
    assert (switch.error, switch.seconds, switch.scenes) == (pytest.approx(1.0), pytest.approx(1.0), 2)


def test_page_needs_nothing_but_itself(report):
    text = report.read_text(encoding="utf-8")
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", text)
    assert not re.search(r"url\(|@import|<script|<link", text)


def test_page_is_well_formed_and_shows_every_scene_and_method(report):
    page = ET.fromstring(report.read_text(encoding="utf-8").removeprefix("<!DOCTYPE html>\n"))
    titles = [heading.text for heading in page.iter("h2")]
    assert titles[1:] == list(SCENES)
    for section in list(page.iter("section"))[1:]:
        text = " ".join(section.itertext())
        for method in METHODS:
            assert method.name in text
        assert "no <light> & no camera" in text
        assert "there is no libEGL" in text
        assert sum("svg" in image.get("src")[:40] for image in section.iter("img")) == 2
    ids = [element.get("id") for element in page.iter() if element.get("id")]
    assert len(set(ids)) == len(ids)
    assert {link.get("href") for link in page.iter("a")} == {f"#{name}" for name in ids}
    assert all(len(image.get("alt")) > 10 for image in page.iter("img"))


def test_markdown_tables_are_square_and_name_every_method(report):
    text = (report.parent / "results.md").read_text(encoding="utf-8")
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        assert len({line.count("|") - line.count("\\|") for line in block.splitlines()}) == 1
    assert all(method.name in text for method in METHODS)


def test_json_is_strict_and_holds_the_comparisons(report):
    data = json.loads((report.parent / "report.json").read_text(), parse_constant=pytest.fail)
    assert [scene["name"] for scene in data["scenes"]] == list(SCENES)
    assert data["comparisons"].keys() == {"picture", "replaced"}
    assert data["machine"]["cores"] >= 1


def test_scene_that_failed_is_in_the_report(states, tmp_path):
    pytest.importorskip("matplotlib")
    states[1].failure, states[1].records, states[1].reference = "it has no camera", {}, {}
    page = write_report(BenchOptions(tmp_path), states, METHODS)
    assert "Not measured: it has no camera" in page.read_text(encoding="utf-8")


def test_page_opens_in_a_browser_without_complaint(report, tmp_path):
    shown = open_page(report, tmp_path / "profile")
    assert all(method.name in shown for method in METHODS)


def test_missing_matplotlib_is_said_before_anything_runs(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(plots.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr("ssgi_addon.bench.command.require_bpy", lambda: None)
    assert main(["bench", "--output", str(tmp_path / "out")]) == 1
    assert "pip install 'ssgi[bench]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.05234, "0.0523"),
        (12.345, "12.3"),
        (1234.5, "1234"),
        (1.5e-6, "1.5e-06"),
        (-0.1, "-0.1"),
    ],
)
def test_numbers_are_short(value, text):
    assert number(value) == text
