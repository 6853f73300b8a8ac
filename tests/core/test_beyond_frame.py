# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of views beyond the frame: what it calls right, and what it reports of views."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import beyond_frame
from benchmarks.cycles_truth import CyclesTruth
from benchmarks.ray_truth import RayTruth, draw_rays
from benchmarks.ray_verdicts import NO_SKY, RIGHT, TOO_FAR, TOO_NEAR, UNANSWERED, Judgement, judge
from benchmarks.variants import relmse_without_noise
from ssgi_addon.core import Camera, Settings
from ssgi_addon.core.metrics import relmse
from ssgi_addon.core.scene import TraceScene
from ssgi_addon.frame import CapturedFrame
from tests.core.synthetic import Plane, Sphere, capture
from tests.tolerances import CLOSED_FORM_RELATIVE, METRIC_RELATIVE, NOISE_LEFT, TRUE_HITS_RIGHT

SIZE, RAYS = (96, 72), 3000
BACKWARDS = np.diag([-1.0, 1.0, -1.0, 1.0])
GREY = {"albedo": 0.5, "source": 0.5}
# A corridor that is open in front of the camera and closed behind it, and a ball in it.
CORRIDOR = [
    Plane((0, -1, 0), (0, 1, 0), **GREY),
    Plane((-1.5, 0, 0), (1, 0, 0), **GREY),
    Plane((1.5, 0, 0), (-1, 0, 0), **GREY),
    Plane((0, 0, 2), (0, 0, -1), **GREY),
]
BALL = Sphere((0.2, -0.5, -3.0), 0.5, **GREY)


def captured(surfaces, *more_poses) -> CapturedFrame:
    """What a camera at the origin sees of surfaces, and cameras of 90 degrees of other poses."""
    camera = Camera.perspective(*SIZE, 1.0)
    others = [Camera.perspective(64, 64, 0.5 * np.pi, world_from_view=pose) for pose in more_poses]
    views = tuple((capture(other, surfaces), other) for other in others)
    return CapturedFrame(capture(camera, surfaces), camera, None, "analytic", True, True, views)


def true_hits(frame: CapturedFrame, surfaces) -> RayTruth:
    """The frame's rays and what they hit of surfaces in closed form; view space is world space."""
    pixel, sample, origin, direction = draw_rays(frame, RAYS)
    lifted = (origin * 0.9999).T.astype(np.float64)  # toward the camera, off the surface
    meetings = [met for one in surfaces for met in one.meet(lifted, direction.T.astype(np.float64))]
    distance, normal = np.stack([t for t, _ in meetings]), np.stack([n for _, n in meetings])
    first = distance.argmin(axis=0), np.arange(pixel.size)
    is_hit = np.isfinite(distance[first])
    everywhere = np.ones(pixel.size, bool)
    return RayTruth(
        pixel, sample, origin, direction, distance[first], (normal[first] * is_hit[:, None]).T,
        ~everywhere, everywhere, np.ones(frame.gbuffer.shape, bool),
    )  # fmt: skip


def judged(frame: CapturedFrame, truth: RayTruth) -> Judgement:
    return Judgement(TraceScene(frame.gbuffer, frame.camera, frame.views, Settings.preset("final")), truth)


@pytest.mark.parametrize(
    ("is_hit", "distance", "true", "is_same_place", "expected"),
    [
        (True, 1.0, 1.0, False, RIGHT),
        (True, 1.019, 1.0, False, RIGHT),
        (True, 0.981, 1.0, False, RIGHT),
        (True, 0.97, 1.0, False, TOO_NEAR),
        (True, 1.03, 1.0, False, TOO_FAR),
        (True, 0.5, 1.0, True, RIGHT),
        (True, 3.0, np.inf, False, NO_SKY),
        (True, 3.0, np.inf, True, NO_SKY),
        (False, np.inf, 1.0, False, UNANSWERED),
        (False, np.inf, np.inf, False, UNANSWERED),
    ],
)
def test_hit_is_right_where_it_is_near_or_the_same_place(is_hit, distance, true, is_same_place, expected):
    arrays = (np.array([value]) for value in (is_hit, distance, true, is_same_place))
    assert judge(*arrays).tolist() == [expected]


def test_some_of_the_rays_are_drawn_once_each_and_the_same_again():
    frame = captured([*CORRIDOR, BALL])
    pixel, sample, origin, direction = draw_rays(frame, 500)
    assert len(set(zip(pixel.tolist(), sample.tolist()))) == pixel.size == 500
    assert not frame.gbuffer.is_background.reshape(-1)[pixel].any()
    for again, before in zip(draw_rays(frame, 500), (pixel, sample, origin, direction)):
        np.testing.assert_array_equal(again, before)


def test_what_the_tracer_finds_in_plain_sight_is_right():
    frame = captured([*CORRIDOR, BALL], BACKWARDS)
    score = judged(frame, true_hits(frame, [*CORRIDOR, BALL])).score()
    assert score.hits_right > TRUE_HITS_RIGHT
    assert score.hit + score.escaped == pytest.approx(score.known)
    assert score.known + score.blocked + score.unknown == pytest.approx(1.0)
    # What some view shows is found or missed; hits besides are wrong ones
    assert score.hit * score.hits_right <= score.seen - score.missed + (1.0 - TRUE_HITS_RIGHT)


def test_hits_before_what_nobody_captured_are_too_far():
    # The ball is there for the rays and not for the camera
    frame = captured(CORRIDOR)
    rays = true_hits(frame, [*CORRIDOR, BALL])
    judgement = judged(frame, rays)
    score, wrong = judgement.score(), judgement.wrong_hits()
    plain = judged(frame, true_hits(frame, CORRIDOR)).score()
    assert score.too_far > plain.too_far
    assert wrong.far_hidden == pytest.approx(score.too_far)
    assert wrong.far_seen == 0.0


@pytest.mark.parametrize(("surfaces", "kind"), [(CORRIDOR, "too_near"), (CORRIDOR[:1], "no_sky")])
def test_hits_on_what_is_not_there_are_too_near_or_should_be_sky(surfaces, kind):
    # The ball is there for the camera and not for the rays
    frame = captured([*surfaces, BALL])
    rays = true_hits(frame, surfaces)
    depth = captured(surfaces).gbuffer.depth
    starts_elsewhere = (frame.gbuffer.depth == depth).reshape(-1).take(rays.pixel)
    judgement = judged(frame, replace(rays, is_sound=starts_elsewhere))
    score, wrong = judgement.score(), judgement.wrong_hits()
    assert score.rays == np.count_nonzero(starts_elsewhere)
    assert getattr(score, kind) > 1.0 - TRUE_HITS_RIGHT
    causes = (wrong.near_contact, wrong.near_step, wrong.near_front)
    assert sum(causes) == pytest.approx(score.too_near + score.no_sky)
    assert wrong.near_front > 0.0  # where all is as captured, there are none


def test_the_back_of_a_wall_is_not_seen():
    frame = captured(CORRIDOR)
    rays = true_hits(frame, CORRIDOR)
    seen, turned = (
        judged(frame, one).score().seen for one in (rays, replace(rays, normal_vs=-rays.normal_vs))
    )
    assert seen > 0.0
    assert turned == 0.0


def test_error_without_noise_is_the_error_where_there_is_none(rng):
    truth = rng.gamma(2.0, 1.0, (40, 50, 3))
    image = truth * rng.uniform(0.5, 1.5, truth.shape)
    counts = rng.uniform(size=truth.shape[:2]) < 0.7
    expected = relmse(image, truth, mask=counts)
    found = relmse_without_noise(image, np.stack([truth, truth]), counts, radius=0)
    assert found == pytest.approx(expected, rel=METRIC_RELATIVE)


def test_noise_of_the_halves_is_not_in_the_error(rng):
    truth = np.ones((128, 128, 3))
    halves = truth + 0.1 * rng.standard_normal((2, *truth.shape))
    counts = np.ones(truth.shape[:2], bool)
    own = relmse(truth, halves.mean(axis=0), mask=counts)
    assert abs(relmse_without_noise(truth, halves, counts)) < NOISE_LEFT * own
    error = relmse_without_noise(1.2 * truth, halves, counts)
    assert error == pytest.approx(0.2**2 / 1.01, rel=CLOSED_FORM_RELATIVE)


def test_dark_noise_does_not_favour_dark_images(rng):
    truth = np.ones((128, 128, 3))
    halves = rng.gamma(0.5, 2.0, (2, *truth.shape))
    counts = np.ones(truth.shape[:2], bool)
    right, dark = (relmse_without_noise(image, halves, counts) for image in (truth, 0.6 * truth))
    assert right < dark
    # What the scale is for: by single pixels it is the other way round
    right, dark = (relmse_without_noise(image, halves, counts, radius=0) for image in (truth, 0.6 * truth))
    assert right > dark


def test_scale_comes_from_pixels_of_the_mask():
    truth = np.ones((20, 20, 3))
    counts = np.zeros(truth.shape[:2], bool)
    counts[:, :10] = True
    black = truth * counts[..., None]
    error = relmse_without_noise(0.0 * truth, np.stack([black, black]), counts)
    assert error == pytest.approx(1 / (1 + 0.01 * 0.5**2), rel=METRIC_RELATIVE)


def test_benchmark_reports_what_further_views_bring(tmp_path, monkeypatch, capsys):
    frame = captured([*CORRIDOR, BALL], BACKWARDS)
    halves = np.stack([0.1 + 0.0 * frame.gbuffer.direct] * 2)
    light = CyclesTruth(frame, halves, halves, is_floor=False)
    frame = replace(frame, view_names=("surround",) * len(frame.views))
    monkeypatch.setattr(beyond_frame, "wide_frame", lambda name, size: frame)
    monkeypatch.setattr(beyond_frame, "ray_truth", lambda *_: true_hits(frame, [*CORRIDOR, BALL]))
    monkeypatch.setattr(beyond_frame, "cycles_truth", lambda *_: light)
    monkeypatch.setattr(beyond_frame, "RAYS_PRESET", "draft")
    output = tmp_path / "result.json"
    words = ["--scenes", "corridor", "--configurations", "frame", "surround", "--preset", "draft", "--output"]
    monkeypatch.setattr(sys, "argv", ["beyond_frame", *words, str(output)])
    beyond_frame.main()
    results = json.loads(output.read_text(encoding="utf-8"))["results"]
    alone, around = results["scores"]
    assert (alone["configuration"], around["configuration"]) == ("frame", "surround")
    assert around["rays"]["hit"] > alone["rays"]["hit"]
    assert around["rays"]["seen"] > alone["rays"]["seen"]
    assert alone["light"]["diffuse_alone"] == pytest.approx(1 / 1.01, rel=METRIC_RELATIVE)
    for one in (alone, around):
        assert results["overall"][one["configuration"]]["picture"] == pytest.approx(one["light"]["picture"])
    assert "geometric mean" in capsys.readouterr().out
