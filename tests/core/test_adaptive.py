# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffuse rays in rounds: the same rays, fewer of them where the light is even."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, Settings, adaptive, bounces, parallel, render_indirect
from ssgi_addon.core.adaptive import FIRST_ROUND, round_slices, sample_adaptively
from ssgi_addon.core.diffuse import HemisphereRays, sample_hemispheres
from ssgi_addon.core.sampling import sample_square
from ssgi_addon.core.scene import TraceScene
from tests.core.synthetic import Plane, Sphere, capture, make_settings, random_gbuffer
from tests.core.test_closed_forms import corner, errors
from tests.core.test_pipeline import side_view
from tests.tolerances import ADAPTIVE_BIAS, ADAPTIVE_RAYS_LEFT, NOISY_HALF_RAYS

SIZE = (40, 30)
CAMERA = Camera.perspective(*SIZE, 1.1)
IMAGES = ("diffuse", "visibility", "known_diffuse", "environment_diffuse")
# Of the error, relative to the picture: so loose that even light needs no second round
THRESHOLD = 0.4
PIXELS = np.arange(SIZE[0] * SIZE[1])


def settings(threshold: float, rays: int = 10, **options) -> Settings:
    base = make_settings(**{"rays": rays, "bounces": 3, "reflections": False, **options})
    return replace(base, diffuse=replace(base.diffuse, adaptive=threshold))


def skies(rng) -> list[Environment | None]:
    return [
        None,
        Environment.constant((1.0, 0.5, 0.2)),
        Environment.equirectangular(rng.random((4, 8, 3)), np.eye(4)),
    ]


def all_noisy(frame, pixel, sums, threshold) -> np.ndarray:
    return np.ones(pixel.size, dtype=np.bool_)


def assert_same(found, expected) -> None:
    for name in IMAGES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def half_lit():
    """Two walls that face the camera; bright balls stand before the farther one, behind the nearer one."""
    camera = Camera.perspective(160, 96, 1.0)
    near = Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), albedo=0.5, bounds=lambda p: p[:, 0] < 0.0)
    far = Plane((0.0, 0.0, -8.0), (0.0, 0.0, 1.0), albedo=0.5)
    balls = [Sphere((2.0, y, -7.2), 0.3, source=20.0) for y in (-1.5, 0.0, 1.5)]
    return capture(camera, [near, far, *balls]), camera


def test_a_pixels_points_are_the_same_however_many_are_drawn():
    every = sample_square(PIXELS, SIZE[0], 10, 3, np.dtype(np.float32))
    for chosen in round_slices(10):
        part = sample_square(PIXELS, SIZE[0], 10, 3, np.dtype(np.float32), chosen)
        for some, whole in zip(part, every, strict=True):
            np.testing.assert_array_equal(some, whole[chosen])


@pytest.mark.parametrize(("rays", "ends"), [(1, [1]), (4, [4]), (5, [4, 5]), (32, [4, 8, 16, 32])])
def test_rounds_take_every_ray_once(rays, ends):
    slices = round_slices(rays)
    assert [chosen.stop for chosen in slices] == ends
    assert [chosen.start for chosen in slices] == [0, *ends[:-1]]


@pytest.mark.parametrize("unknown", ["environment", "nothing", "mean"])
def test_all_rounds_are_the_light_without_rounds(unknown, rng, monkeypatch):
    monkeypatch.setattr(adaptive, "is_noisy", all_noisy)
    frame = random_gbuffer(rng, SIZE[::-1])
    for sky in skies(rng):
        for threads in (1, 2):
            options = {"unknown": unknown, "threads": threads, "filter": True}
            once = render_indirect(frame, CAMERA, settings(0.0, **options), sky)
            rounds = render_indirect(frame, CAMERA, settings(1.0, **options), sky)
            assert_same(rounds, once)
            assert rounds.rays == once.rays


def test_further_views_and_their_bounces_are_the_same(rng, monkeypatch):
    monkeypatch.setattr(adaptive, "is_noisy", all_noisy)
    frame, views = random_gbuffer(rng, SIZE[::-1]), [side_view()]
    once, rounds = (render_indirect(frame, CAMERA, settings(value), None, views) for value in (0.0, 1.0))
    assert_same(rounds, once)
    assert rounds.rays == once.rays


def test_variance_and_rays_of_all_rounds_are_those_without(rng, monkeypatch):
    monkeypatch.setattr(adaptive, "is_noisy", all_noisy)
    frame = random_gbuffer(rng, SIZE[::-1], sky=0.0)
    scene = TraceScene(frame, CAMERA, (), settings(1.0))
    source = scene.table("diffuse_source")
    once = sample_hemispheres(scene, 0, source, None, settings(0.0), PIXELS)
    rounds = sample_adaptively(scene, source, None, settings(1.0), PIXELS)
    np.testing.assert_array_equal(rounds.variance, once.variance)
    assert (rounds.count, rounds.traced) == (once.count, once.traced)
    np.testing.assert_array_equal(rounds.gather(source, 2), once.gather(source, 1))


def test_threads_and_chunks_do_not_change_a_bit(rng, monkeypatch):
    frame, camera = half_lit()
    options = settings(THRESHOLD, rays=32, threads=1, filter=True)
    light = render_indirect(frame, camera, options)
    assert FIRST_ROUND < light.rays["diffuse"] / frame.depth.size < 32
    monkeypatch.setattr(parallel, "RAYS_PER_TASK", 500)
    monkeypatch.setattr(parallel, "RAYS_AT_ONCE", 4000)
    for threads in (1, 2, 8):
        again = render_indirect(frame, camera, replace(options, threads=threads))
        assert_same(again, light)
        assert again.rays == light.rays


def test_a_threshold_of_zero_knows_no_rounds(rng, monkeypatch):
    def refuse(*_):
        raise AssertionError("traced in rounds")

    monkeypatch.setattr(bounces, "sample_adaptively", refuse)
    frame = random_gbuffer(rng, SIZE[::-1])
    for options in (settings(0.0), settings(1.0, rays=FIRST_ROUND)):
        light = render_indirect(frame, CAMERA, options)
        assert light.rays["diffuse"] == options.diffuse.rays * (~frame.is_background).sum()


def test_an_endless_threshold_is_the_first_round(rng):
    frame = random_gbuffer(rng, SIZE[::-1], sky=0.0)
    options = settings(np.inf)
    scene = TraceScene(frame, CAMERA, (), options)
    source = scene.table("diffuse_source")
    samples = sample_adaptively(scene, source, None, options, PIXELS)
    first = slice(0, FIRST_ROUND)
    rays = HemisphereRays.trace(scene, 0, options, PIXELS, lambda _: None, first)
    assert samples.traced == FIRST_ROUND * PIXELS.size
    np.testing.assert_array_equal(samples.rounds[0][1], rays.texel)
    np.testing.assert_array_equal(samples.bounce, source.take(rays.texel, axis=0).mean(axis=0))


def test_most_rays_go_where_the_light_is_uneven():
    frame, camera = half_lit()
    pixel = np.flatnonzero(frame.albedo[..., 0] > 0.0)
    options = settings(THRESHOLD, rays=32)
    scene = TraceScene(frame, camera, (), options)
    samples = sample_adaptively(scene, scene.table("diffuse_source"), None, options, pixel)
    is_right = pixel % camera.width >= camera.width // 2
    assert samples.taken[is_right].mean() > NOISY_HALF_RAYS * samples.taken[~is_right].mean()
    assert samples.taken.min() == FIRST_ROUND
    assert samples.taken.max() == 32


def test_rounds_bias_a_closed_form_little():
    """The light of a wall on the floor before it: fewer rays, and nearly the same mean."""
    frame, camera, chosen, expected = corner((96, 72))
    preset = Settings.preset("final")
    preset = replace(
        preset,
        diffuse=replace(preset.diffuse, adaptive=0.8, bounces=1, filter=False),
        reflections=replace(preset.reflections, enabled=False),
    )
    light = render_indirect(frame, camera, preset)
    bias, _ = errors(light.diffuse[chosen][:, 0], expected)
    assert bias < ADAPTIVE_BIAS
    assert light.rays["diffuse"] < ADAPTIVE_RAYS_LEFT * 32 * np.count_nonzero(frame.albedo[..., 0])
