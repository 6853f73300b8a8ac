# SPDX-License-Identifier: GPL-3.0-or-later
"""Cost follows need: rays and calls are counted, nothing is timed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import (
    Camera,
    Environment,
    denoise,
    hit_colors,
    pipeline,
    reflections,
    render_indirect,
)
from ssgi_addon.core.planner import BLACK, plan_passes
from tests.core.synthetic import make_settings, uniform_gbuffer

WHITE = Environment.constant((1.0, 1.0, 1.0))
SHAPE = (24, 32)
WALL = Camera.perspective(SHAPE[1], SHAPE[0], 1.0)
IMAGES = ("diffuse", "glossy", "known_diffuse", "known_glossy")


def settings(**options):
    return make_settings(**{"rays": 3, "glossy_rays": 2, "filter": True, **options})


def upper_half(value, elsewhere):
    rows = np.arange(SHAPE[0])[:, None] < SHAPE[0] // 2
    return np.broadcast_to(np.where(rows, value, elsewhere), SHAPE)


def reasons(light) -> dict[str, str]:
    return dict(light.skipped)


def count_calls(monkeypatch, owner, name: str) -> list[int]:
    """Return a list that grows with each call."""
    calls, real = [], getattr(owner, name)

    def counted(*arguments, **options):
        calls.append(1)
        return real(*arguments, **options)

    monkeypatch.setattr(owner, name, counted)
    return calls


def test_half_a_sky_is_half_of_the_rays():
    whole = render_indirect(uniform_gbuffer(SHAPE), WALL, settings(), WHITE)
    half = render_indirect(uniform_gbuffer(SHAPE, upper_half(np.inf, 5.0)), WALL, settings(), WHITE)
    for kind in ("diffuse", "reflections"):
        assert 2 * half.rays[kind] == whole.rays[kind] > 0
    assert reasons(half)[f"{SHAPE[0] // 2 * SHAPE[1]} pixels"] == "background"


def test_black_surfaces_take_no_rays():
    light = render_indirect(uniform_gbuffer(SHAPE, albedo=0.0, specular=0.0), WALL, settings(), WHITE)
    assert light.rays == {"diffuse": 0, "reflections": 0}
    for name in ("diffuse", "reflections"):
        assert reasons(light)[name] == "no surface in the frame has such a colour"


def test_a_colour_is_black_by_its_brightest_channel():
    albedo = np.zeros((*SHAPE, 3))
    for channel in range(3):
        albedo[channel, :, channel] = 2.0 * BLACK
    plan = plan_passes(uniform_gbuffer(SHAPE, albedo=albedo), settings(), None)
    np.testing.assert_array_equal(plan.diffuse, np.arange(3 * SHAPE[1]))


def test_without_gloss_the_reflections_are_not_entered(monkeypatch):
    entered = [
        count_calls(monkeypatch, reflections, "reflect_light"),
        count_calls(monkeypatch, hit_colors.HitColors, "__init__"),
        count_calls(monkeypatch, pipeline.DiffusePass, "handed_on"),
    ]
    light = render_indirect(uniform_gbuffer(SHAPE, specular=0.0), WALL, settings(bounces=3), WHITE)
    assert light.rays["reflections"] == 0
    assert entered == [[], [], []]
    render_indirect(uniform_gbuffer(SHAPE), WALL, settings(bounces=3), WHITE)
    assert entered == [[1], [1], [1]]


def test_the_filter_leaves_out_what_has_no_light(monkeypatch):
    shape = (200, 256)
    camera = Camera.perspective(shape[1], shape[0], 1.0)
    places: list[int] = []
    real = denoise._Pass.filter_band

    def counted(work, task):
        places.append(task[0].stop - task[0].start)
        real(work, task)

    monkeypatch.setattr(denoise._Pass, "filter_band", counted)
    rows = np.arange(shape[0])[:, None]
    counts = []
    for sky in (rows < 0, rows < shape[0] // 2, (rows // 50) % 2 == 0):
        places.clear()
        depth = np.broadcast_to(np.where(sky, np.inf, 5.0), shape)
        render_indirect(uniform_gbuffer(shape, depth), camera, settings(rays=1, reflections=False))
        counts.append(sum(places))
    whole, half, striped = counts
    # Bands are whole, and the noise around a pixel is looked at a little beyond it
    assert half < 0.6 * whole
    assert striped < 0.85 * whole


def test_what_is_left_out_changes_nothing(monkeypatch, rng):
    depth = np.full((60, 70), np.inf)
    depth[20:30, 15:40] = depth[45:50, 30:50] = 5.0
    noise = {"direct": rng.random((*depth.shape, 3)), "roughness": rng.random(depth.shape)}
    frame = uniform_gbuffer(depth.shape, depth, **noise)
    camera = Camera.perspective(70, 60, 1.0)
    options = settings(bounces=2, glossy={"reuse": 8, "resolution": "half"})
    cut = render_indirect(frame, camera, options, WHITE)
    monkeypatch.setattr(
        denoise, "box_around", lambda inside, reach=0: tuple(slice(0, size) for size in inside.shape)
    )
    monkeypatch.setattr(denoise, "_PIXELS_PER_BAND", 10**6)
    whole = render_indirect(frame, camera, options, WHITE)
    for name in IMAGES:
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name), err_msg=name)


def rough_half(**options):
    """A wall whose upper half is rough, in a glossy frame that sees a sky of one colour."""
    frame = uniform_gbuffer(SHAPE, roughness=upper_half(0.9, 0.3), **options)
    glossy = {"roughness_cutoff": 0.5}
    return frame, settings(glossy=glossy)


def test_rough_surfaces_take_the_diffuse_light():
    frame, options = rough_half()
    light = render_indirect(frame, WALL, options, WHITE)
    rough = upper_half(True, False)
    assert light.rays["reflections"] == 2 * rough.sum()  # of the other half, two rays each
    for glossy, diffuse in (("glossy", "diffuse"), ("known_glossy", "known_diffuse")):
        np.testing.assert_array_equal(getattr(light, glossy)[rough], getattr(light, diffuse)[rough])
    assert (
        reasons(light)[f"reflections of {rough.sum()} pixels"]
        == "rougher than the cutoff: they take the diffuse light"
    )
    # The others are lit as ever
    plain = replace(options, reflections=replace(options.reflections, reuse=0, filter=False))
    all_rays = replace(plain, reflections=replace(plain.reflections, roughness_cutoff=1.0))
    few, many = (render_indirect(frame, WALL, each, WHITE) for each in (plain, all_rays))
    np.testing.assert_array_equal(few.glossy[~rough], many.glossy[~rough])


def test_a_wholly_rough_frame_does_not_enter_the_reflections(monkeypatch):
    entered = count_calls(monkeypatch, reflections, "reflect_light")
    options = settings(glossy={"roughness_cutoff": 0.2})
    light = render_indirect(uniform_gbuffer(SHAPE), WALL, options, WHITE)
    assert not entered
    assert (light.glossy > 0.0).all()
    assert reasons(light)["reflections"] == "rougher than the cutoff: they take the diffuse light"


@pytest.mark.parametrize("change", [{"diffuse": False}, {"albedo": 0.0}, {"albedo": 0.2, "specular": 0.8}])
def test_rough_metals_and_surfaces_without_diffuse_light_keep_their_rays(change):
    passes = {name: value for name, value in change.items() if name != "diffuse"}
    options = settings(glossy={"roughness_cutoff": 0.2}, diffuse=change.get("diffuse", True))
    light = render_indirect(uniform_gbuffer(SHAPE, **passes), WALL, options, WHITE)
    assert light.rays["reflections"] == 2 * SHAPE[0] * SHAPE[1]
