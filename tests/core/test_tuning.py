# SPDX-License-Identifier: GPL-3.0-or-later
"""The tuning benchmark: what it changes it puts back, and what it takes is better on both halves."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import tuning
from benchmarks.tuned_parameters import CASES, PARAMETERS, applied, settings_of
from benchmarks.tuning import Bench, Search, Verdict, gain_and_worst, levelled_light
from ssgi_addon.core import Camera, Fill, Settings, denoise, pipeline, render_indirect
from ssgi_addon.frame import CapturedFrame
from tests.core.synthetic import Plane, capture

GREY = {"albedo": 0.5, "specular": 0.2, "roughness": 0.5, "source": 0.5}
FLOOR = Plane((0, -1, 0), (0, 1, 0), **GREY)


def corner(roughness: float = 0.5) -> CapturedFrame:
    """A floor and a wall, with a fill of even light."""
    camera, coarse = Camera.perspective(48, 32, 1.0), Camera.perspective(12, 8, 1.0)
    surfaces = [FLOOR, Plane((0, 0, -5), (0, 0, 1), **{**GREY, "roughness": roughness})]
    small = capture(coarse, surfaces)
    light = np.full((*small.shape, 3), 0.3, np.float32)
    fill = Fill(small.depth, small.normal, light, 0.5 * light, coarse)
    return CapturedFrame(capture(camera, surfaces), camera, None, "analytic", True, True, fill=fill)


@pytest.mark.parametrize("roughness", [0.5, 0.9])
def test_light_at_the_level_of_the_fill_is_what_the_passes_make(roughness):
    """Also of walls that are too rough for reflection rays of their own."""
    frame, settings = corner(roughness), settings_of("balanced", {}, 0)
    inputs = frame.gbuffer, frame.camera, settings
    expected = render_indirect(*inputs, fill=frame.fill)
    found = levelled_light(frame, render_indirect(*inputs), settings)
    for kind in ("diffuse", "glossy"):
        np.testing.assert_array_equal(getattr(found, kind), getattr(expected, kind))


def test_constants_are_set_for_a_while_alone():
    before = denoise._PLANE_WIDTH, denoise.filter_light.__defaults__, pipeline._LOBE_STEPS
    changes = {"denoise._PLANE_WIDTH": 8.0, "filter_light.__defaults__": (1,), "pipeline._LOBE_STEPS": 2.0}
    with pytest.raises(KeyError, match="stop"), applied(changes):
        assert denoise._PLANE_WIDTH == 8.0
        assert denoise.filter_light.__defaults__ == (1,)
        assert pipeline._LOBE_STEPS[0] == 2.0 * before[2][0]
        raise KeyError("stop")
    assert before == (denoise._PLANE_WIDTH, denoise.filter_light.__defaults__, pipeline._LOBE_STEPS)


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_can_take_every_value(name):
    parameter = PARAMETERS[name]
    assert parameter.present() in parameter.values
    for value in parameter.others():
        with applied({name: value}):
            settings = settings_of(parameter.case, {name: value}, 0)
        assert (settings == settings_of(parameter.case, {}, 0)) == (parameter.owner is not None)
        assert parameter.case in CASES


def test_the_second_pass_looks_halfway_and_beyond_the_last():
    assert PARAMETERS["thickness"].around(0.1) == pytest.approx([0.0707, 0.1414])
    assert PARAMETERS["reflections.reuse"].around(12) == [10, 14, 16]
    assert PARAMETERS["unknown"].around("mean") == []


def test_halves_are_every_other_scene(monkeypatch):
    monkeypatch.setattr(tuning, "real_scenes", lambda: list("abcde"))
    assert tuning.halves() == (list("ace"), list("bd"))


def test_gain_is_of_the_mean_and_harm_of_one_picture():
    before, after = {("a", "frame"): 0.4, ("b", "frame"): 0.1}, {("a", "frame"): 0.1, ("b", "frame"): 0.2}
    assert gain_and_worst(before, after) == pytest.approx((1.0 - 0.5**0.5, 1.0))


@pytest.mark.parametrize(
    ("verdict", "is_taken"),
    [
        (Verdict(0.03, 0.01, 1.0, 0.001, 0.5), True),
        (Verdict(0.03, 0.01, 1.0, -0.001, 0.0), False),  # the other half does not agree
        (Verdict(0.03, 0.03, 1.0, 0.03, 0.0), False),  # harms a picture
        (Verdict(0.015, 0.0, 1.0, 0.03, 0.0), False),  # no more than the seeds make
        (Verdict(0.03, 0.01, 1.0), False),  # not verified
    ],
)
def test_a_change_is_taken_only_if_both_halves_gain(verdict, is_taken):
    assert verdict.is_taken(noise=0.02) == is_taken


@pytest.mark.parametrize(("held_out", "taken"), [(0.9, {"thickness": 0.2}), (1.1, {})])
def test_search_takes_what_the_held_out_half_confirms(monkeypatch, held_out, taken):
    """Errors in closed form: a thickness of 0.2 is best on the tuning half."""

    def errors(self, case, changes, scenes, seed):
        is_changed = changes.get("thickness", Settings().thickness) == 0.2
        factor = {"tuned": 0.9, "held": held_out}
        return {(name, "fill"): factor[name] if is_changed else 1.0 for name in scenes}, 1.0

    monkeypatch.setattr(Bench, "errors", errors)
    search = Search(Bench((8, 8), 1), ["tuned"], ["held"])
    assert search.turn("thickness", PARAMETERS["thickness"].others(), 1)
    assert search.taken == taken
