# SPDX-License-Identifier: GPL-3.0-or-later
"""Reflections: mirrors against known places, rough lobes against quadrature, and who hands on what."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, render_indirect
from tests.core.synthetic import Plane, Sphere, capture, make_settings, random_gbuffer
from tests.tolerances import (
    CLOSED_FORM_RELATIVE,
    FURNACE,
    LOBE_PIXEL,
    MIRROR_AT_MIRROR_LIMIT,
    MIRROR_HALO,
    MIRROR_HIT_PX,
    MIRROR_PIXELS_OFF,
    REPEATED_SUM,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
FLOOR = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), specular=1.0)


def light_of(
    gbuffer: GBuffer, camera: Camera, environment: Environment | None = None, **options
) -> IndirectLight:
    return render_indirect(gbuffer, camera, make_settings(**{"diffuse": False, **options}), environment)


def numbered(gbuffer: GBuffer) -> GBuffer:
    """Let every pixel hand on its own number plus one, so that a mirror shows which pixel it met."""
    number = 1.0 + np.arange(gbuffer.depth.size).reshape(gbuffer.shape)
    return replace(gbuffer, glossy_source=np.repeat(number[..., None], 3, axis=-1))


def met_pixels(light: IndirectLight) -> np.ndarray:
    """Return the flat index of the pixel that each mirror ray met, -1 for none; for `numbered` frames."""
    return light.glossy[..., 0].astype(np.int64) - 1


def mirror_rays(gbuffer: GBuffer, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and mirror directions (H, W, 3) in float64."""
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    depth = np.where(gbuffer.is_background, 1.0, gbuffer.depth.astype(np.float64))
    position = camera.pixel_to_view(x, y, depth)
    incoming = np.broadcast_to([0.0, 0.0, -1.0], position.shape)
    if not camera.is_orthographic:
        incoming = position / np.linalg.norm(position, axis=-1, keepdims=True)
    normal = gbuffer.normal.astype(np.float64)
    return position, incoming - 2.0 * (incoming * normal).sum(axis=-1, keepdims=True) * normal


def lenses() -> dict[str, Camera]:
    return {
        "perspective": Camera.perspective(48, 40, 1.0),
        "shifted": Camera.perspective(48, 40, 1.0, shift_px=(5.3, -6.0), pixel_aspect=0.8),
    }


@pytest.mark.parametrize("method", ["linear", "hierarchical"])
@pytest.mark.parametrize("lens", lenses())
def test_mirror_floor_shows_the_wall_at_its_mirror_image(lens, method):
    camera = lenses()[lens]
    wall = Plane((0.0, 0.0, -6.0), (0.1, 0.0, 1.0))
    gbuffer = numbered(capture(camera, [FLOOR, wall]))
    is_floor = gbuffer.specular[..., 0] > 0.0
    position, direction = mirror_rays(gbuffer, camera)
    normal = np.array([0.1, 0.0, 1.0])
    distance = (normal @ np.array([0.0, 0.0, -6.0]) - position @ normal) / (direction @ normal)
    x, y, _ = camera.view_to_pixel(position + distance[..., None] * direction)
    inside = is_floor & (x > 0) & (x < camera.width) & (y > 0) & (y < camera.height)
    # The contact row has a test of its own
    inside &= np.arange(camera.height)[:, None] > np.nonzero(is_floor)[0].min()
    assert inside.sum() > 200
    light = light_of(gbuffer, camera, method=method)
    met = met_pixels(light)
    assert (light.known_glossy[inside] == 1.0).all()
    across, down = met % camera.width + 0.5 - x, met // camera.width + 0.5 - y
    off = np.maximum(np.abs(across), np.abs(down))[inside]
    assert off.max() <= MIRROR_HIT_PX
    assert (off > 0.5 + 1e-3).mean() <= MIRROR_PIXELS_OFF
    # What is beyond the frame stays unknown
    outside = is_floor & ((x < 0) | (x > camera.width) | (y < 0) | (y > camera.height))
    assert (light.known_glossy[outside] == 0.0).all()
    assert (light.glossy[outside] == 0.0).all()


def test_mirror_image_touches_what_it_reflects():
    """In the pixel next to the wall the floor reflects the wall's lowest pixel: no gap at the contact."""
    camera = Camera.perspective(32, 48, 1.0)
    gbuffer = numbered(capture(camera, [FLOOR, Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0))]))
    rows = np.nonzero(gbuffer.specular[:, 16, 0] > 0.0)[0]
    met = met_pixels(light_of(gbuffer, camera)) // 32
    assert (met[rows[0], 2:-2] == rows[0] - 1).all()
    assert (np.diff(met[rows[:8]], axis=0)[:, 2:-2] <= 0).all()  # and further down, further up


def test_contact_row_is_answered_wherever_the_wall_begins():
    """The wall begins anywhere between the last pixel of the floor and the first of the wall."""
    camera = Camera.perspective(32, 48, 1.0)
    for distance in np.linspace(4.0, 4.4, 7):
        gbuffer = numbered(capture(camera, [FLOOR, Plane((0.0, 0.0, -distance), (0.0, 0.0, 1.0))]))
        row = np.nonzero(gbuffer.specular[:, 16, 0] > 0.0)[0][0]
        light = light_of(gbuffer, camera)
        assert (light.known_glossy[row, 2:-2] == 1.0).all(), distance
        near = gbuffer.depth[row, 16]
        rise = (distance - near) / near  # of the mirrored ray above the floor, one unit below the camera
        met_row = np.floor(camera.cy + camera.fy * (1.0 - rise) / distance)
        assert (met_pixels(light)[row, 2:-2] // 32 == min(met_row, row - 1)).all(), distance


def test_ball_floating_over_a_mirror_keeps_its_reflection():
    camera = Camera.perspective(96, 72, 0.9)
    ball = Sphere((0.2, 0.3, -6.0), 0.8, source=5.0)
    gbuffer = capture(camera, [FLOOR, ball])
    is_floor = gbuffer.specular[..., 0] > 0.0
    position, direction = mirror_rays(gbuffer, camera)
    distance = ball.meet(position.reshape(-1, 3), direction.reshape(-1, 3))[0][0].reshape(gbuffer.shape)
    reflects = is_floor & np.isfinite(distance)
    point = position + np.where(reflects, distance, 0.0)[..., None] * direction
    toward_camera = -point / np.linalg.norm(point, axis=-1, keepdims=True)
    facing = ((point - ball.centre) / ball.radius * toward_camera).sum(axis=-1)
    shown = reflects & (facing > 0.1)
    assert shown.sum() > 100
    light = light_of(gbuffer, camera)
    assert (light.glossy[shown] == 5.0).all()
    # And no halo around it: a pixel's patch is as wide as the pixel
    near = reflects.copy()
    for shift in (-1, 1):
        near |= np.roll(reflects, shift, axis=0) | np.roll(reflects, shift, axis=1)
    assert (light.glossy[is_floor & ~near][:, 0] > 0.0).mean() <= MIRROR_HALO


@pytest.mark.parametrize("lens", [Camera.perspective(64, 64, 0.8), Camera.orthographic(64, 64, 5.0)])
def test_convex_mirror_ball_shows_nothing_of_itself(lens):
    gbuffer = capture(lens, [Sphere((0.1, -0.2, -6.0), 2.0, specular=1.0, source=9.0)])
    ball = ~gbuffer.is_background
    light = light_of(gbuffer, lens)
    assert (light.glossy == 0.0).all()
    sky = light_of(gbuffer, lens, WHITE)
    np.testing.assert_allclose(sky.glossy[ball], 1.0, rtol=FURNACE)


def test_flat_mirrors_at_any_tilt_show_nothing_of_themselves():
    for tilt in np.radians([0.0, 30.0, 60.0, 80.0, 89.0]):
        for azimuth in (0.0, 1.0, 2.5):
            lean = np.sin(tilt)
            normal = (lean * np.cos(azimuth), lean * np.sin(azimuth), np.cos(tilt))
            camera = Camera.perspective(48, 36, 0.7)
            gbuffer = capture(camera, [Plane((0.0, 0.0, -10.0), normal, specular=1.0, source=1.0)])
            assert (light_of(gbuffer, camera).glossy == 0.0).all()


@pytest.mark.parametrize("axis", [0, 1])
def test_flipping_the_frame_flips_mirrors_exactly(axis, rng):
    camera = Camera.perspective(44, 28, 1.1)
    surfaces = [FLOOR, Sphere((0.4, -0.2, -5.0), 0.7, specular=1.0), Plane((0.0, 0.0, -8.0), (0.2, 0.0, 1.0))]
    gbuffer = numbered(capture(camera, surfaces))
    turned = np.ones(3)
    turned[1 - axis] = -1.0
    flipped = GBuffer(
        np.flip(gbuffer.depth, axis),
        np.flip(gbuffer.normal, axis) * turned,
        *(np.flip(getattr(gbuffer, name), axis) for name in ("albedo", "specular", "roughness", "direct")),
        glossy_source=np.flip(gbuffer.glossy_source, axis),
    )
    expected, found = light_of(gbuffer, camera), light_of(flipped, camera)
    np.testing.assert_array_equal(np.flip(found.glossy, axis), expected.glossy)
    np.testing.assert_array_equal(np.flip(found.known_glossy, axis), expected.known_glossy)


def test_linear_and_hierarchical_walks_give_the_same_picture(rng):
    camera = Camera.perspective(45, 31, 1.0)
    gbuffer = random_gbuffer(rng, (31, 45))
    light = {method: light_of(gbuffer, camera, WHITE, method=method) for method in ("linear", "hierarchical")}
    differing = (light["linear"].glossy != light["hierarchical"].glossy).any(axis=-1)
    assert differing.mean() <= 0.001
    both = light_of(gbuffer, camera, WHITE, method="linear", diffuse=True)
    np.testing.assert_array_equal(both.glossy, light["linear"].glossy)


def test_mirrors_have_no_noise():
    camera = lenses()["perspective"]
    gbuffer = capture(
        camera, [FLOOR, Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), source=lambda p: 2.0 + np.sin(p))]
    )
    one = light_of(gbuffer, camera, rays=1, filter=True).glossy
    other = light_of(gbuffer, camera, rays=9, seed=5, filter=True).glossy
    np.testing.assert_array_equal(one, other)


def wall_over(roughness: float) -> tuple[GBuffer, Camera]:
    camera = Camera.perspective(40, 40, 1.0)
    wall = Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), source=lambda p: 1.5 + np.sin(2.0 * p + 1.0))
    gbuffer = capture(camera, [replace(FLOOR, roughness=roughness), wall])
    return gbuffer, camera


def test_roughness_from_zero_up_changes_the_reflection_continuously():
    lights = [light_of(*wall_over(r), WHITE, rays=64).glossy for r in (0.0, 1e-4, 0.0299, 0.0301, 0.04)]
    seen = wall_over(0.0)[0].specular > 0.0
    np.testing.assert_array_equal(lights[0], lights[1])
    np.testing.assert_array_equal(lights[0], lights[2])
    for before, after in itertools.pairwise(lights[2:]):
        assert np.abs(before - after)[seen].mean() <= MIRROR_AT_MIRROR_LIMIT


@pytest.mark.parametrize("roughness", [0.4, 0.6, 1.0])
def test_rough_floor_reflects_the_lobe_integral_of_the_wall(roughness):
    """Against a quadrature of the published lobe over the wall's visible part, in float64."""
    gbuffer, camera = wall_over(roughness)
    light = light_of(gbuffer, camera, rays=1024)
    alpha = roughness**2
    z, angle = np.meshgrid((np.arange(300) + 0.5) / 300, (np.arange(600) + 0.5) * np.pi / 300, indexing="ij")
    radius = np.sqrt(1.0 - z * z)
    local = np.stack([radius * np.cos(angle), z, radius * np.sin(angle)]).reshape(3, -1)  # normal +Y

    def smith(cosine):
        return 0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 / cosine**2 - 1.0)) - 1.0)

    for row, column in ((31, 20), (33, 8), (36, 30), (39, 20)):
        position = camera.pixel_to_view(column + 0.5, row + 0.5, float(gbuffer.depth[row, column]))
        view = -position / np.linalg.norm(position)
        half = local + view[:, None]
        half /= np.linalg.norm(half, axis=0)
        density = alpha**2 / (half[1] ** 2 * (alpha**2 - 1.0) + 1.0) ** 2
        lobe = density / (1.0 + smith(view[1]) + smith(local[1]))
        distance = (-4.0 - position[2]) / local[2]
        point = position[:, None] + local * distance
        x, y, _ = camera.view_to_pixel(point.T)
        meets = (distance > 0) & (x >= 0) & (x < 40) & (y >= 0) & (y < 40)
        radiance = np.where(meets, 1.5 + np.sin(2.0 * point + 1.0), 0.0)
        expected = (radiance * lobe).sum(axis=1) / lobe.sum()
        assert expected.max() > 0.05
        np.testing.assert_allclose(light.glossy[row, column], expected, atol=LOBE_PIXEL)
        assert light.known_glossy[row, column] == pytest.approx(
            (meets * lobe).sum() / lobe.sum(), abs=LOBE_PIXEL
        )


@pytest.mark.parametrize("roughness", [0.0, 0.02, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("filter", [False, True])
def test_white_furnace_of_metal_is_white(roughness, filter):
    look = {"specular": 1.0, "roughness": roughness, "source": 1.0}
    wide = Camera.perspective(32, 24, 1.2)
    for surfaces in (
        [Sphere((0.0, 0.0, -5.0), 1.5, **look)],
        [Sphere((0.0, 0.0, -1.0), 4.0, **look)],
        [Sphere((0.0, 0.0, -5.0), 1.0, **look), Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), **look)],
    ):
        gbuffer = capture(wide, surfaces)
        light = light_of(gbuffer, wide, WHITE, filter=filter)
        np.testing.assert_allclose(light.glossy[~gbuffer.is_background], 1.0, atol=FURNACE)
        assert (light.glossy[gbuffer.is_background] == 0.0).all()


def test_unknown_reflections_bring_what_the_settings_say():
    gbuffer, camera = wall_over(0.6)
    gbuffer = replace(gbuffer, glossy_source=np.full_like(gbuffer.direct, 3.0))
    sky = Environment.constant((3.0, 3.0, 3.0))
    floor = gbuffer.specular[..., 0] > 0.0
    found = {
        name: light_of(gbuffer, camera, sky, unknown=name) for name in ("environment", "nothing", "mean")
    }
    known = found["nothing"].known_glossy[floor]
    assert 0.1 < known.mean() < 0.9
    np.testing.assert_allclose(found["environment"].glossy[floor], 3.0, rtol=REPEATED_SUM)
    np.testing.assert_allclose(
        found["nothing"].glossy[floor], 3.0 * known[:, None] * np.ones(3), rtol=REPEATED_SUM
    )
    np.testing.assert_allclose(found["mean"].glossy[floor], 3.0, rtol=REPEATED_SUM)


def test_mirrors_show_glossy_source_and_the_diffuse_light_of_earlier_bounces():
    """What a hit hands on: its glossy source + albedo x the diffuse light of all bounces but the last."""
    camera = Camera.perspective(32, 32, 1.0)
    floor = replace(FLOOR, source=4.0)
    wall = Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), albedo=(0.8, 0.4, 0.2), source=0.5)
    plain = capture(camera, [floor, wall])
    gbuffer = numbered(plain)
    shown = met_pixels(light_of(gbuffer, camera))
    is_shown = shown >= 0
    once = light_of(gbuffer, camera, diffuse=True, bounces=1)
    np.testing.assert_array_equal(met_pixels(once), shown)
    twice = light_of(gbuffer, camera, diffuse=True, bounces=2)
    handed_on = (gbuffer.glossy_source + gbuffer.albedo * once.diffuse).reshape(-1, 3)
    assert once.diffuse.max() > 0.1
    np.testing.assert_allclose(twice.glossy[is_shown], handed_on[shown[is_shown]], rtol=REPEATED_SUM)
    # Without a glossy source of its own a hit hands on its source, and without that its direct light
    bare = light_of(plain, camera)
    np.testing.assert_allclose(bare.glossy[is_shown], plain.direct.reshape(-1, 3)[shown[is_shown]])


def test_reflected_reflections_do_not_add_up():
    """Two mirrors that face each other show each other's source, never each other's computed reflection."""
    camera = Camera.perspective(32, 32, 1.0)
    look = {"specular": 1.0, "source": 1.0}
    gbuffer = capture(
        camera,
        [Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), **look), Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), **look)],
    )
    assert light_of(gbuffer, camera, WHITE, diffuse=True, bounces=8).glossy.max() <= 1.0 + REPEATED_SUM


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_normals_that_turn_away_from_the_camera_still_give_light_in_range(roughness, rng):
    camera = Camera.perspective(24, 18, 1.0)
    gbuffer = capture(camera, [Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), specular=1.0, source=1.0)])
    normal = rng.normal(size=gbuffer.normal.shape)  # half of them look away
    normal[0, :6] = np.concatenate([np.eye(3), -np.eye(3)])
    gbuffer = replace(gbuffer, normal=normal, roughness=np.full(gbuffer.shape, roughness))
    light = light_of(gbuffer, camera, WHITE)
    assert np.isfinite(light.glossy).all()
    assert light.glossy.min() >= 0.0
    assert light.glossy.max() <= 1.0 + FURNACE
    assert light.known_glossy.min() >= 0.0
    assert light.known_glossy.max() <= 1.0


def test_no_specular_means_no_rays_and_no_light():
    gbuffer, camera = wall_over(0.5)
    light = light_of(replace(gbuffer, specular=0.0 * gbuffer.specular), camera, WHITE)
    assert (light.glossy == 0.0).all()
    assert light.rays["reflections"] == 0
    assert (light.known_glossy == 1.0).all()


def test_filter_brings_few_rough_rays_nearer_to_many():
    gbuffer, camera = wall_over(0.5)
    truth = light_of(gbuffer, camera, rays=1024, seed=99).glossy
    raw, smooth = (light_of(gbuffer, camera, rays=2, filter=is_smooth).glossy for is_smooth in (False, True))
    assert ((smooth - truth) ** 2).mean() < 0.6 * ((raw - truth) ** 2).mean()


def test_rough_reflections_keep_their_mean_light(rng):
    gbuffer, camera = wall_over(0.5)
    floor = gbuffer.specular[..., 0] > 0.0
    many, few = (light_of(gbuffer, camera, rays=rays).glossy[floor].mean() for rays in (512, 4))
    assert few == pytest.approx(float(many), rel=CLOSED_FORM_RELATIVE)
