# SPDX-License-Identifier: GPL-3.0-or-later
"""The switches of the reflections: what each keeps, and what it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, parallel, render_indirect
from tests.budget import examples
from tests.core.synthetic import Plane, Sphere, capture, make_settings, random_gbuffer
from tests.tolerances import BORROWED_LIGHT, FEWER_RAYS_LIGHT, FURNACE, REPEATED_SUM

WHITE = Environment.constant((1.0, 1.0, 1.0))
FLOOR = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), specular=1.0)
WALL = Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), source=lambda p: 1.5 + np.sin(2.0 * p + 1.0))
SWITCHES = [
    {"reuse": 1},
    {"reuse": 8},
    {"reuse": 24},
    {"resolution": "half"},
    {"resolution": "quarter", "reuse": 8},
    {"roughness_tiers": True},
    {"color_pyramid": True, "subpixel": True},
    {"exact_mirrors": False},
    {"elongation": False, "reuse": 4},
    {"contact_hardening": False},
]


def light_of(gbuffer, camera, environment=None, *, rays=4, filter=False, **glossy) -> IndirectLight:
    options = {key: glossy.pop(key) for key in ("unknown", "threads", "seed", "max_steps") if key in glossy}
    settings = make_settings(rays=rays, filter=filter, diffuse=False, glossy=glossy, **options)
    return render_indirect(gbuffer, camera, settings, environment)


def floor_and_wall(roughness: float, size=(40, 40)) -> tuple[GBuffer, Camera]:
    camera = Camera.perspective(*size, 1.0)
    return capture(camera, [replace(FLOOR, roughness=roughness), WALL]), camera


@pytest.mark.parametrize("size", [(32, 24), (17, 9), (3, 5), (1, 1)])
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.6])
@pytest.mark.parametrize("switches", SWITCHES, ids=str)
def test_white_furnace_of_metal_stays_white(switches, roughness, size):
    look = {"specular": 1.0, "roughness": roughness, "source": 1.0}
    camera = Camera.perspective(*size, 1.2)
    ball, plane = Sphere((0.0, 0.0, -5.0), 1.0, **look), Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), **look)
    gbuffer = capture(camera, [ball, plane])
    light = light_of(gbuffer, camera, WHITE, filter=True, **switches)
    np.testing.assert_allclose(light.glossy[~gbuffer.is_background], 1.0, atol=FURNACE)


def test_reuse_and_cones_bring_one_ray_nearer_to_many():
    gbuffer, camera = floor_and_wall(0.4)
    truth = light_of(gbuffer, camera, rays=1024, seed=9).glossy

    def error(**glossy) -> float:
        return float(((light_of(gbuffer, camera, rays=1, **glossy).glossy - truth) ** 2).mean())

    alone = error()
    assert error(reuse=4) < 0.5 * alone
    assert error(reuse=24) < error(reuse=4)
    assert error(color_pyramid=True, subpixel=True) < alone


def test_reuse_never_touches_mirrors():
    gbuffer, camera = floor_and_wall(0.0)
    plain, shared = (light_of(gbuffer, camera, reuse=reuse, resolution="half") for reuse in (0, 24))
    np.testing.assert_array_equal(plain.glossy, shared.glossy)
    assert plain.rays["reflections"] == (gbuffer.specular[..., 0] > 0.0).sum()


def test_rays_are_borrowed_from_the_same_surface_only():
    """A near plate that sees a bright wall stands before a far one that sees nothing."""
    camera = Camera.perspective(48, 32, 1.0)
    near = Plane((0, -0.5, 0), (0, 1, 0), specular=1.0, roughness=0.3, bounds=lambda p: p[..., 2] > -3.0)
    far = Plane((0, -1.5, 0), (0, 1, 0), specular=1.0, roughness=0.3)
    gbuffer = capture(camera, [near, far, WALL])
    truth, shared = (light_of(gbuffer, camera, rays=256, reuse=reuse).glossy for reuse in (0, 8))
    floor = gbuffer.specular[..., 0] > 0.0
    assert np.abs(shared - truth)[floor].max() <= BORROWED_LIGHT * truth.max()


@pytest.mark.parametrize(("resolution", "share"), [("half", 4), ("quarter", 16)])
def test_fewer_rays_than_pixels_keep_the_mean_light(resolution, share):
    gbuffer, camera = floor_and_wall(0.5, (64, 64))
    floor = gbuffer.specular[..., 0] > 0.0
    full, fewer = (
        light_of(gbuffer, camera, rays=64, reuse=8, resolution=name) for name in ("full", resolution)
    )
    assert fewer.rays["reflections"] <= 1.5 * full.rays["reflections"] / share
    mean = full.glossy[floor].mean()
    assert np.abs(fewer.glossy - full.glossy)[floor].mean() <= FEWER_RAYS_LIGHT * mean


def test_thin_things_have_rays_of_their_own_at_quarter_resolution():
    camera = Camera.perspective(64, 48, 1.0)
    wire = Plane((0, 0, -2.0), (0, 0.6, 0.8), specular=1.0, roughness=0.5, source=1.0,
                 bounds=lambda p: np.abs(p[..., 0] - 0.1) < 0.02)  # fmt: skip
    gbuffer = capture(camera, [wire, replace(FLOOR, roughness=0.5, source=1.0)])
    light = light_of(gbuffer, camera, WHITE, resolution="quarter")
    np.testing.assert_allclose(light.glossy[~gbuffer.is_background], 1.0, atol=FURNACE)


def test_rough_pixels_alone_get_fewer_rays_by_tiers():
    for roughness, ratio in ((0.2, 1.0), (0.7, 0.25)):
        gbuffer, camera = floor_and_wall(roughness, (64, 64))
        plain, tiers = (light_of(gbuffer, camera, roughness_tiers=on) for on in (False, True))
        assert tiers.rays["reflections"] == pytest.approx(plain.rays["reflections"] * ratio, rel=0.3)


def test_results_depend_neither_on_threads_nor_on_rays_at_a_time(monkeypatch):
    gbuffer, camera = floor_and_wall(0.3)
    options = {"rays": 3, "reuse": 8, "color_pyramid": True, "subpixel": True, "filter": True}
    one = light_of(gbuffer, camera, threads=1, **options)
    for threads in (2, 8):
        many = light_of(gbuffer, camera, threads=threads, **options)
        np.testing.assert_array_equal(many.glossy, one.glossy)
        np.testing.assert_array_equal(many.known_glossy, one.known_glossy)
    monkeypatch.setattr(parallel, "RAYS_AT_ONCE", 500)
    monkeypatch.setattr(parallel, "RAYS_PER_TASK", 70)
    np.testing.assert_allclose(
        light_of(gbuffer, camera, **options).glossy, one.glossy, rtol=REPEATED_SUM, atol=REPEATED_SUM
    )


def test_edge_fade_makes_reflections_unknown_toward_the_border():
    gbuffer, camera = floor_and_wall(0.0)
    floor = gbuffer.specular[..., 0] > 0.0
    plain = light_of(gbuffer, camera)
    np.testing.assert_array_equal(light_of(gbuffer, camera, edge_fade=0.0).glossy, plain.glossy)
    faded = light_of(gbuffer, camera, edge_fade=0.2)
    assert (faded.known_glossy <= plain.known_glossy).all()
    row = np.nonzero(floor[:, 20])[0][0] + 1
    left = faded.known_glossy[row, :12]
    assert (np.diff(left) >= 0.0).all()
    assert left[0] < 0.2
    assert left[-1] == 1.0
    white = capture(camera, [replace(FLOOR, source=1.0), replace(WALL, source=1.0)])
    full = light_of(white, camera, WHITE, edge_fade=0.2).glossy
    known = light_of(white, camera, WHITE).glossy
    np.testing.assert_allclose(full[floor], known[floor], atol=FURNACE)


def test_hidden_light_is_a_share_of_what_the_other_rays_find(rng):
    camera = Camera.perspective(45, 31, 1.0)
    gbuffer = random_gbuffer(rng, (31, 45))
    dark, lit = (light_of(gbuffer, camera, WHITE, hidden_light=share) for share in (0.0, 1.0))
    np.testing.assert_array_equal(dark.known_glossy, lit.known_glossy)
    assert (lit.glossy >= dark.glossy).all()
    assert lit.glossy.mean() > 1.05 * dark.glossy.mean()


def test_lobes_stretch_toward_the_viewer_at_grazing_angles():
    camera = Camera.perspective(96, 96, 0.8)
    ball = Sphere((0.0, -0.4, -9.0), 0.25, source=50.0)
    gbuffer = capture(camera, [replace(FLOOR, roughness=0.3), ball])

    def stretch(is_elongated: bool) -> float:
        bright = light_of(gbuffer, camera, rays=256, elongation=is_elongated).glossy[..., 0]
        y, x = np.mgrid[0:96, 0:96]
        total = bright.sum()
        center_x, center_y = (bright * x).sum() / total, (bright * y).sum() / total
        tall, wide = (bright * (y - center_y) ** 2).sum(), (bright * (x - center_x) ** 2).sum()
        return float(np.sqrt(tall / wide))

    assert stretch(True) > 1.3 * stretch(False)


@given(st.data())
@examples(max_examples=25)
def test_noise_gives_finite_light_under_every_switch(data):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    width, height = data.draw(st.integers(1, 23)), data.draw(st.integers(1, 19))
    glossy = {
        "resolution": data.draw(st.sampled_from(["full", "half", "quarter"])),
        "reuse": data.draw(st.sampled_from([0, 3, 48])),
        "edge_fade": data.draw(st.sampled_from([0.0, 0.3])),
        "hidden_light": data.draw(st.sampled_from([0.0, 1.0])),
    }
    for name in (
        "roughness_tiers", "color_pyramid", "subpixel", "exact_mirrors", "elongation", "contact_hardening",
    ):  # fmt: skip
        glossy[name] = data.draw(st.booleans())
    camera = Camera.perspective(width, height, 1.0)
    gbuffer = random_gbuffer(rng, (height, width))
    light = light_of(gbuffer, camera, WHITE, rays=2, filter=data.draw(st.booleans()), **glossy)
    for values in (light.glossy, light.known_glossy):
        assert np.isfinite(values).all()
        assert (values >= 0.0).all()
    assert (light.known_glossy <= 1.0).all()
