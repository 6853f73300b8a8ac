# SPDX-License-Identifier: GPL-3.0-or-later
"""render_indirect as a whole: what comes out, what it depends on, and what it refuses."""

from __future__ import annotations

import functools
import threading
from dataclasses import fields, replace

import numpy as np
import pytest

from ssgi_addon.core import (
    Camera,
    Environment,
    GBuffer,
    IndirectLight,
    Settings,
    composite,
    parallel,
    render_indirect,
)
from tests.core.synthetic import (
    Plane,
    Sphere,
    capture,
    make_settings,
    random_gbuffer,
    uniform_gbuffer,
)
from tests.tolerances import PARALLEL_AS_FAR_AWAY, REPEATED_SUM, SCALED_SCENE_RELATIVE

WHITE = Environment.constant((1.0, 1.0, 1.0))
IMAGES = ("diffuse", "glossy", "visibility", "known_diffuse", "known_glossy", "known", "environment_diffuse")
SURFACES = (
    Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.6, specular=0.3, roughness=0.2, source=0.2),
    Plane((-2.0, 0.0, 0.0), (1.0, 0.0, 0.3), albedo=(0.7, 0.2, 0.1), source=lambda p: 1.0 + np.sin(2.0 * p)),
    Sphere((0.6, -0.3, -5.0), 0.7, albedo=0.2, specular=0.8, source=1.0),
    Sphere((-0.7, -0.5, -6.0), 0.5, albedo=0.5, specular=0.5, roughness=0.5, source=3.0),
)
CAMERA = Camera.perspective(40, 30, 1.1)


def scene() -> GBuffer:
    return capture(CAMERA, SURFACES)


def settings(**options) -> Settings:
    return make_settings(**{"rays": 4, "bounces": 3, "filter": True, **options})


def assert_same(found: IndirectLight, expected: IndirectLight) -> None:
    for name in IMAGES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def assert_in_range(light: IndirectLight) -> None:
    for name in IMAGES:
        image = getattr(light, name)
        assert np.isfinite(image).all(), name
        assert image.min() >= 0.0, name
    for name in ("visibility", "known_diffuse", "known_glossy", "known"):
        assert getattr(light, name).max() <= 1.0, name


def side_view() -> tuple[GBuffer, Camera]:
    turn = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    camera = Camera.perspective(20, 20, 1.5, world_from_view=turn)
    return capture(camera, SURFACES), camera


def test_images_are_float32_of_the_frames_size_and_in_range():
    light = render_indirect(scene(), CAMERA, settings(), WHITE)
    for name in IMAGES:
        image = getattr(light, name)
        assert image.shape == (
            (30, 40, 3) if name in ("diffuse", "glossy", "environment_diffuse") else (30, 40)
        )
        assert image.dtype == np.float32
        assert image.flags.c_contiguous
    assert_in_range(light)
    assert light.diffuse.max() > 0.1
    assert light.glossy.max() > 0.1
    assert set(light.seconds) >= {"diffuse", "reflections"}


def test_picture_is_direct_plus_each_colour_times_its_light():
    gbuffer = scene()
    light = render_indirect(gbuffer, CAMERA, settings(), WHITE)
    expected = gbuffer.direct + gbuffer.albedo * light.diffuse + gbuffer.specular * light.glossy
    np.testing.assert_array_equal(composite(gbuffer, light), expected)


def test_light_of_another_size_is_named():
    light = render_indirect(uniform_gbuffer((2, 3)), Camera.perspective(3, 2, 1.0), settings())
    with pytest.raises(ValueError, match=r"^light: expected .*got"):
        composite(scene(), light)


def test_inputs_are_as_before():
    gbuffer, (view, view_camera) = scene(), side_view()
    gbuffer = replace(gbuffer, behind=scene(), thickness=np.ones(gbuffer.shape), source=gbuffer.direct * 2)
    sky = Environment.equirectangular(np.random.default_rng(1).random((4, 8, 3)), np.eye(4))
    owners = (gbuffer, gbuffer.behind, view, sky, CAMERA, view_camera)
    arrays = [
        value for owner in owners for item in fields(owner)
        if isinstance(value := getattr(owner, item.name), np.ndarray)
    ]  # fmt: skip
    before = [array.copy() for array in arrays]
    render_indirect(gbuffer, CAMERA, settings(), sky, views=[(view, view_camera)])
    for array, copy in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array, copy)


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (7, 1), (1, 31), (3, 5), (13, 17), (64, 3), (33, 65)])
@pytest.mark.parametrize("parallel_rays", [False, True])
def test_frames_of_any_size_are_lit(size, parallel_rays, rng):
    make = Camera.orthographic if parallel_rays else Camera.perspective
    gbuffer = random_gbuffer(rng, size)
    light = render_indirect(gbuffer, make(size[1], size[0], 1.3), settings(), WHITE)
    assert_in_range(light)


@pytest.mark.parametrize("method", ["linear", "hierarchical"])
def test_threads_and_chunks_do_not_change_a_bit(method, rng, monkeypatch):
    shape = (30, 40)
    gbuffer, views = random_gbuffer(rng, shape), [side_view()]
    options = {"rays": 3, "glossy_rays": 2, "method": method}
    light = render_indirect(gbuffer, CAMERA, settings(threads=1, **options), WHITE, views)
    monkeypatch.setattr(parallel, "RAYS_PER_TASK", 500)
    for threads in (1, 2, 8):
        assert_same(
            render_indirect(gbuffer, CAMERA, settings(threads=threads, **options), WHITE, views), light
        )


def test_same_seed_repeats_and_another_differs():
    lights = [render_indirect(scene(), CAMERA, settings(seed=seed), WHITE) for seed in (7, 7, 8)]
    assert_same(lights[1], lights[0])
    assert (lights[2].diffuse != lights[0].diffuse).any()


def scaled(factor: float, parallel_rays: bool) -> IndirectLight:
    """The scene with all lengths times `factor`."""
    if parallel_rays:
        near = capture(Camera.orthographic(40, 30, 5.0), SURFACES)
        camera = Camera.orthographic(40, 30, 5.0 * factor)
    else:
        near, camera = scene(), CAMERA
    depth = near.depth.astype(np.float64) * factor
    return render_indirect(replace(near, depth=depth), camera, settings(max_distance=4.0 * factor), WHITE)


@pytest.mark.parametrize("parallel_rays", [False, True])
@pytest.mark.parametrize("factor", [2.0**-10, 0.5, 2.0**17])
def test_scenes_scaled_by_powers_of_two_have_the_same_light(factor, parallel_rays):
    assert_same(scaled(factor, parallel_rays), scaled(1.0, parallel_rays))


@pytest.mark.parametrize("factor", [1e-3, 1e5])
def test_scenes_scaled_by_any_factor_have_the_same_mean_light(factor):
    found, expected = scaled(factor, False), scaled(1.0, False)
    for name in ("diffuse", "glossy", "visibility", "known"):
        mean = float(getattr(expected, name).mean(dtype=np.float64))
        assert getattr(found, name).mean(dtype=np.float64) == pytest.approx(mean, rel=SCALED_SCENE_RELATIVE)


@pytest.mark.parametrize("factor", [2.0**-12, 4.0, 2.0**15])
def test_exposure_scales_light_and_nothing_else(factor):
    gbuffer = replace(scene(), source=scene().direct * 0.7, glossy_source=scene().direct * 0.9)
    names = ("direct", "source", "glossy_source")
    brighter = replace(gbuffer, **{name: getattr(gbuffer, name) * np.float32(factor) for name in names})
    plain = render_indirect(gbuffer, CAMERA, settings(), WHITE)
    found = render_indirect(brighter, CAMERA, settings(), Environment.constant((factor,) * 3))
    for name in IMAGES:
        scale = factor if name in ("diffuse", "glossy", "environment_diffuse") else 1.0
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name) * np.float32(scale))


def test_parallel_camera_is_a_perspective_one_very_far_away():
    """The same surfaces, thickness in units, from a distance of 2,000 times the width."""
    distance, width = 1e4, 5.0
    near = Camera.orthographic(40, 30, width)
    gbuffer = capture(near, SURFACES, thickness=0.5)
    far = Camera.perspective(40, 30, 2.0 * np.arctan(0.5 * width / distance))
    # Depth counts from the camera; where it stood at 0 it now stands at -distance
    away = replace(gbuffer, depth=gbuffer.depth.astype(np.float64) + distance)
    expected = render_indirect(gbuffer, near, settings(rays=16, filter=False), WHITE)
    found = render_indirect(away, far, settings(rays=16, filter=False), WHITE)
    for name in ("diffuse", "glossy", "visibility"):
        difference = np.abs(getattr(found, name) - getattr(expected, name))
        assert difference.mean() <= PARALLEL_AS_FAR_AWAY, name


# Bad pixels: a frame with one is the frame in which it is black, or background.

BAD = (np.nan, np.inf, -np.inf, -1.0, 1e20)
CLEAN = {"depth": np.inf}
PASSES = (
    "depth",
    "normal",
    "albedo",
    "specular",
    "roughness",
    "direct",
    "source",
    "glossy_source",
    "thickness",
)
# Endless depth and thickness have a meaning, and so has a normal of negative numbers.
MEANT = (("depth", np.inf), ("thickness", np.inf), ("normal", -1.0))
DAMAGE = [(name, bad) for name in PASSES for bad in BAD if (name, bad) not in MEANT]


@functools.cache
def light_with(name: str, value: float) -> IndirectLight:
    """The scene's light with one pixel of one pass set to `value`."""
    direct = scene().direct
    gbuffer = replace(scene(), source=direct, glossy_source=direct * 2, thickness=np.full((30, 40), 0.4))
    image = getattr(gbuffer, name).copy()
    image[20, 22] = value
    return render_indirect(replace(gbuffer, **{name: image}), CAMERA, settings(), WHITE)


@pytest.mark.parametrize(("name", "bad"), DAMAGE)
def test_damage_of_a_bad_pixel_stays_in_its_pixel(name, bad):
    assert_in_range(light_with(name, bad))
    assert_same(light_with(name, bad), light_with(name, CLEAN.get(name, 0.0)))


@pytest.mark.parametrize("bad", [*BAD, 0.0])
@pytest.mark.parametrize("name", ["depth", "normal", "albedo", "specular", "roughness", "direct"])
def test_rows_and_whole_passes_of_garbage_give_light_in_range(name, bad):
    gbuffer = scene()
    for where in (slice(10, 12), slice(None)):
        image = getattr(gbuffer, name).copy()
        image[where] = bad
        assert_in_range(render_indirect(replace(gbuffer, **{name: image}), CAMERA, settings(), WHITE))


def test_depths_over_nine_decades_give_light_in_range(rng):
    gbuffer = random_gbuffer(rng, (25, 31))
    depth = np.where(gbuffer.is_background, np.inf, 10.0 ** rng.uniform(-3.0, 6.0, gbuffer.shape))
    for make in (Camera.perspective, Camera.orthographic):
        light = render_indirect(replace(gbuffer, depth=depth), make(31, 25, 1.0), settings(), WHITE)
        assert_in_range(light)


def test_light_of_1e5_is_light_and_stays_finite():
    gbuffer = scene()
    direct = gbuffer.direct.copy()
    direct[15, 8] = 1e5
    light = render_indirect(replace(gbuffer, direct=direct), CAMERA, settings(), WHITE)
    assert_in_range(light)
    assert light.diffuse.max() > 10.0


# Darkness and emptiness.


def test_black_world_of_black_surfaces_is_black():
    gbuffer = uniform_gbuffer((9, 11), 3.0, albedo=0.0, specular=0.0, direct=0.0)
    light = render_indirect(
        gbuffer, Camera.perspective(11, 9, 1.0), settings(), Environment.constant((0.0,) * 3)
    )
    assert (composite(gbuffer, light) == 0.0).all()
    assert (light.known == 1.0).all()


def test_lit_surfaces_without_light_are_black():
    gbuffer = replace(scene(), direct=np.zeros((30, 40, 3)))
    light = render_indirect(gbuffer, CAMERA, settings())
    assert (light.diffuse == 0.0).all()
    assert (light.glossy == 0.0).all()


def test_pure_emission_without_colours_is_the_direct_light():
    gbuffer = uniform_gbuffer((9, 11), 3.0, albedo=0.0, specular=0.0, direct=50.0)
    light = render_indirect(gbuffer, Camera.perspective(11, 9, 1.0), settings(), WHITE)
    np.testing.assert_array_equal(composite(gbuffer, light), gbuffer.direct)
    assert light.rays == {"diffuse": 0, "reflections": 0}


@pytest.mark.parametrize("parallel_rays", [False, True])
def test_empty_sky_has_no_light_on_it(parallel_rays):
    gbuffer = uniform_gbuffer((9, 11), np.inf)
    camera = (Camera.orthographic if parallel_rays else Camera.perspective)(11, 9, 1.0)
    light = render_indirect(gbuffer, camera, settings(), WHITE)
    assert (light.diffuse == 0.0).all()
    assert (light.glossy == 0.0).all()
    for name in ("visibility", "known_diffuse", "known_glossy", "known"):
        assert (getattr(light, name) == 1.0).all()


def test_background_receives_nothing_and_counts_as_known():
    light = render_indirect(scene(), CAMERA, settings(), WHITE)
    sky = scene().is_background
    assert 0 < sky.sum() < sky.size
    assert (light.diffuse[sky] == 0.0).all()
    assert (light.glossy[sky] == 0.0).all()
    for name in ("visibility", "known_diffuse", "known_glossy", "known"):
        assert (getattr(light, name)[sky] == 1.0).all()


# What is traced, and what is known.


def test_known_is_the_mean_of_both_by_the_luminance_of_the_colours():
    gbuffer = scene()
    light = render_indirect(gbuffer, CAMERA, settings(), WHITE)
    weights = np.array([0.2126, 0.7152, 0.0722], dtype=np.float64)
    diffuse, glossy = gbuffer.albedo @ weights, gbuffer.specular @ weights
    total = diffuse + glossy
    expected = np.where(total > 0.0, (diffuse * light.known_diffuse + glossy * light.known_glossy), 1.0)
    expected /= np.where(total > 0.0, total, 1.0)
    np.testing.assert_allclose(light.known, expected, atol=REPEATED_SUM)
    assert light.known.min() < 0.9


def test_cost_follows_need():
    gbuffer = scene()
    surfaces = ~gbuffer.is_background
    shiny = surfaces & (gbuffer.specular.max(axis=-1) > 0.0)
    mirrors = shiny & (gbuffer.roughness == 0.0)
    light = render_indirect(gbuffer, CAMERA, settings(rays=5, glossy_rays=3, bounces=1), WHITE)
    assert light.rays["diffuse"] == 5 * surfaces.sum()
    assert light.rays["reflections"] == 3 * (shiny & ~mirrors).sum() + mirrors.sum()
    assert any("background" in why for _, why in light.skipped)


def test_what_is_switched_off_is_neither_traced_nor_lit():
    light = render_indirect(scene(), CAMERA, settings(reflections=False), WHITE)
    assert (light.glossy == 0.0).all()
    assert light.rays["reflections"] == 0
    assert ("reflections", "switched off") in light.skipped
    light = render_indirect(scene(), CAMERA, settings(diffuse=False), WHITE)
    assert (light.diffuse == 0.0).all()
    assert light.rays["diffuse"] == 0
    assert ("diffuse", "switched off") in light.skipped


def test_short_rays_know_less_and_never_more():
    far = render_indirect(scene(), CAMERA, settings(filter=False))
    near = render_indirect(scene(), CAMERA, settings(filter=False, max_distance=0.5))
    none = render_indirect(scene(), CAMERA, settings(filter=False, max_distance=0.0))
    assert near.known.mean() < far.known.mean()
    assert (near.visibility >= far.visibility).all()
    assert (none.diffuse == 0.0).all()
    assert (none.glossy == 0.0).all()
    assert (none.visibility == 1.0).all()


# Progress, cancel, errors.


def test_progress_rises_to_one_in_the_calling_thread():
    calls = []
    render_indirect(
        scene(), CAMERA, settings(threads=2), WHITE,
        progress=lambda fraction, text: calls.append((fraction, text, threading.get_ident())),
    )  # fmt: skip
    fractions = [fraction for fraction, _, _ in calls]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert all(0.0 <= fraction <= 1.0 and text for fraction, text, _ in calls)
    assert {thread for _, _, thread in calls} == {threading.get_ident()}


@pytest.mark.parametrize("threads", [1, 3])
def test_progress_cancels_by_raising_and_leaves_no_thread_behind(threads, monkeypatch):
    monkeypatch.setattr(parallel, "RAYS_PER_TASK", 200)

    def cancel(fraction: float, text: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_indirect(scene(), CAMERA, settings(threads=threads), WHITE, progress=cancel)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ssgi")]


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("gbuffer", {"gbuffer": None}),
        ("camera", {"camera": np.eye(4)}),
        ("camera", {"camera": Camera.perspective(30, 40, 1.0)}),
        ("settings", {"settings": "final"}),
        ("environment", {"environment": (1.0, 1.0, 1.0)}),
        ("views", {"views": 3}),
        ("views", {"views": [scene()]}),
        ("views", {"views": [(CAMERA, scene())]}),
        ("camera", {"views": [(scene(), Camera.perspective(4, 4, 1.0))]}),
    ],
)
def test_bad_arguments_are_named(field, changes):
    arguments = {"gbuffer": scene(), "camera": CAMERA, "settings": settings(), **changes}
    with pytest.raises(ValueError, match=rf"^{field}: expected .*got"):
        render_indirect(**arguments)


@pytest.mark.parametrize("name", ["draft", "balanced", "final"])
def test_presets_light_a_scene(name):
    light = render_indirect(scene(), CAMERA, Settings.preset(name), WHITE)
    assert_in_range(light)
    assert light.diffuse.max() > 0.1


def test_progress_never_falls(monkeypatch):
    monkeypatch.setattr(parallel, "RAYS_PER_TASK", 64)
    gbuffer = random_gbuffer(np.random.default_rng(5), (24, 32))
    roughness = np.where(np.arange(32) < 16, 0.0, 0.5) * np.ones((24, 1))
    mixed = replace(gbuffer, specular=np.full((24, 32, 3), 0.5), roughness=roughness)
    reported = []
    render_indirect(
        mixed,
        Camera.perspective(32, 24, 1.0),
        make_settings(rays=4),
        progress=lambda fraction, _text: reported.append(fraction),
    )
    assert reported[-1] == 1.0
    assert (np.diff(reported) >= 0.0).all()
