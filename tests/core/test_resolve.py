# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays that pixels take from their neighbours: nearer to many rays, and nothing that is not theirs."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, parallel, render_indirect
from ssgi_addon.core.resolve import MARGIN, neighbour_offsets
from tests.core.synthetic import Plane, capture, make_settings, uniform_gbuffer
from tests.tolerances import (
    BEHIND_LEDGE_LIGHT,
    BORROWED_BY_SHARP_LEFT,
    BORROWED_ERROR_LEFT,
    CLOSED_FORM_RELATIVE,
    CONTRAST_AT_CONTACT,
    KNOWN_WITH_BORROWED,
    REPEATED_SUM,
    SHARP_COLUMN,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
FLOOR = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), specular=1.0)
WALL = Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), source=lambda p: 1.5 + np.sin(2.0 * p + 1.0))
SHARING = [{"reuse": 8}, {"reuse": 24}, {"resolution": "half"}, {"resolution": "quarter"}]

Frame = tuple[GBuffer, Camera]


def light_of(
    frame: Frame, environment: Environment | None = None, *, rays: int = 4, seed: int = 0, **options
) -> IndirectLight:
    """Render with rays of the pixels' own unless the options say otherwise."""
    general = {name: options.pop(name) for name in ("threads", "unknown") if name in options}
    settings = make_settings(rays=rays, seed=seed, diffuse=False, glossy=options, **general)
    return render_indirect(*frame, settings, environment)


def floor_and_wall(roughness: float | np.ndarray, size: tuple[int, int] = (40, 40)) -> Frame:
    camera = Camera.perspective(*size, 1.0)
    gbuffer = capture(camera, [FLOOR, WALL])
    return replace(gbuffer, roughness=np.broadcast_to(roughness, gbuffer.shape)), camera


def is_floor(frame: Frame) -> np.ndarray:
    return frame[0].specular[..., 0] > 0.0


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_pixels_take_the_rays_of_the_nearest_cells(stride):
    for phase in np.ndindex(stride, stride):
        offsets = neighbour_offsets(stride, phase, 24)
        assert offsets[0] == (0, 0)
        assert len(set(offsets)) == 25
        assert np.abs(offsets).max() <= MARGIN
        # From the pixel's centre to the cells' centres, in pixels
        own = np.array(phase) + 0.5
        away = np.linalg.norm((np.array(offsets) + 0.5) * stride - own, axis=1)
        assert (np.diff(away) >= -1e-9).all()
        others = [
            np.linalg.norm((np.array((down, right)) + 0.5) * stride - own)
            for down in range(-MARGIN, MARGIN + 1)
            for right in range(-MARGIN, MARGIN + 1)
            if (down, right) not in offsets
        ]
        assert min(others) >= away.max() - 1e-9
        assert neighbour_offsets(stride, phase, 4) == offsets[:5]
        assert neighbour_offsets(stride, phase, 0) == [(0, 0)]


@pytest.mark.parametrize(("resolution", "stride"), [("full", 1), ("half", 2), ("quarter", 4)])
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (17, 9), (32, 16)])
def test_every_cell_of_a_wide_surface_has_its_rays_and_no_more(size, resolution, stride):
    width, height = size
    frame = uniform_gbuffer((height, width), roughness=0.6), Camera.perspective(width, height, 0.5)
    light = light_of(frame, WHITE, rays=4, reuse=3, resolution=resolution)
    assert light.rays["reflections"] == 4 * -(-height // stride) * -(-width // stride)


def test_a_lone_pixel_of_every_cell_has_rays_wherever_it_lies(rng):
    """Few pixels reflect, here and there: whatever the grid, each of them is answered."""
    frame = floor_and_wall(0.3)
    reflects = rng.random(frame[0].shape) < 0.1
    sparse = replace(frame[0], specular=frame[0].specular * reflects[..., None]), frame[1]
    seen = is_floor(sparse)
    full = light_of(sparse, WHITE, rays=64).glossy[seen].mean()
    for resolution in ("half", "quarter"):
        light = light_of(sparse, WHITE, rays=64, resolution=resolution)
        assert light.glossy[seen].min() > 0.0
        assert light.glossy[seen].mean() == pytest.approx(float(full), rel=CLOSED_FORM_RELATIVE)


@pytest.mark.parametrize("roughness", [0.3, 0.6])
def test_borrowed_rays_bring_few_nearer_to_many_and_keep_their_mean(roughness):
    frame = floor_and_wall(roughness)
    floor = is_floor(frame)
    truth = light_of(frame, rays=512, seed=99).glossy[floor]
    shared, alone = (
        [light_of(frame, rays=4, seed=seed, reuse=reuse).glossy[floor] for seed in range(3)]
        for reuse in (8, 0)
    )
    errors = [np.mean([((light - truth) ** 2).mean() for light in lights]) for lights in (shared, alone)]
    assert errors[0] < BORROWED_ERROR_LEFT * errors[1]
    assert np.mean(shared) == pytest.approx(float(truth.mean()), rel=CLOSED_FORM_RELATIVE)


@pytest.mark.parametrize("switches", SHARING, ids=str)
def test_neighbours_that_know_nothing_lower_known_and_bring_no_light(switches):
    """All that is found is 3, so that light is 3 x known, and known is what the pixel's own rays say."""
    frame = floor_and_wall(0.5)
    floor = is_floor(frame)
    even = replace(frame[0], glossy_source=np.full_like(frame[0].direct, 3.0)), frame[1]
    light = light_of(even, rays=16, **switches)
    known = light.known_glossy[floor]
    np.testing.assert_allclose(light.glossy[floor], 3.0 * known[:, None] * np.ones(3), rtol=REPEATED_SUM)
    truth = light_of(even, rays=128, seed=3).known_glossy[floor]
    assert 0.1 < truth.mean() < 0.9
    assert known.mean() == pytest.approx(float(truth.mean()), abs=KNOWN_WITH_BORROWED)


def test_mirrors_take_nothing_and_give_nothing():
    """Columns of mirrors and of rough floor in turn, against floors of one kind."""
    column = np.arange(40)
    is_mirror = np.broadcast_to(column % 3 == 0, (40, 40))
    mixed = floor_and_wall(np.where(is_mirror, 0.01, 0.4))
    mirrors = is_mirror & is_floor(mixed)
    alone = light_of(mixed).glossy
    for switches in SHARING:
        np.testing.assert_array_equal(light_of(mixed, **switches).glossy[mirrors], alone[mirrors])
    # What rough pixels find does not change with what the mirrors between them show
    rough = ~is_mirror & is_floor(mixed)
    other = floor_and_wall(np.where(is_mirror, 0.02, 0.4))
    blind = replace(other[0], specular=other[0].specular * ~is_mirror[..., None]), other[1]
    for switches in SHARING:
        np.testing.assert_array_equal(
            light_of(blind, **switches).glossy[rough], light_of(mixed, **switches).glossy[rough]
        )


@pytest.mark.parametrize("reuse", [8, 24])
def test_a_sharp_column_among_rough_ones_stays_sharp(reuse):
    """Rays count by the receiver's own lobe: what a rough neighbour finds far off its mirror direction is
    next to nothing for a sharp pixel."""
    column = np.arange(40)
    frame = floor_and_wall(np.where(column == 20, 0.1, 0.6)[None, :])
    sharp = is_floor(frame)[:, 20]
    truth = light_of(frame, rays=128, seed=3).glossy[:, 20][sharp]
    rough = light_of(floor_and_wall(0.6), rays=64).glossy[:, 20][sharp]
    found = light_of(frame, rays=16, reuse=reuse).glossy[:, 20][sharp]
    off = np.sqrt(((found - truth) ** 2).mean())
    assert off < SHARP_COLUMN * np.sqrt(((rough - truth) ** 2).mean())


def test_sharp_and_rough_columns_in_turn_gain_from_each_other():
    """A rough neighbour's ray that happens to lie in a sharp lobe counts more than the pixel's own, but not
    so much that it stands for all of them."""
    frame = floor_and_wall(np.where(np.arange(40) % 4 == 0, 0.2, 0.6)[None, :])
    sharp = is_floor(frame)[:, ::4]
    truth = light_of(frame, rays=256, seed=9).glossy[:, ::4][sharp]
    shared, alone = (
        np.mean(
            [
                ((light_of(frame, rays=16, seed=seed, reuse=reuse).glossy[:, ::4][sharp] - truth) ** 2).mean()
                for seed in range(4)
            ]
        )
        for reuse in (8, 0)
    )
    assert shared < BORROWED_BY_SHARP_LEFT * alone


def test_a_borrowed_ray_points_at_what_it_found():
    """Stripes of the wall at the contact: directions alone, not turned toward the hits, would smear them over
    the pixels that are taken from."""
    camera = Camera.perspective(48, 48, 1.0)
    four_px = 4.0 * 4.0 / camera.fx
    stripes = replace(WALL, source=lambda p: 1.0 + np.sin(2.0 * np.pi / four_px * p[:, [0, 0, 0]]))
    frame = capture(camera, [replace(FLOOR, roughness=0.15), stripes]), camera
    top = np.nonzero(is_floor(frame)[:, 24])[0][0]
    truth, shared = (
        light_of(frame, rays=rays, **options).glossy[top : top + 4, 8:40, 0]
        for rays, options in ((128, {}), (16, {"reuse": 24}))
    )
    assert (shared.std(axis=1) > CONTRAST_AT_CONTACT * truth.std(axis=1)).all()


@pytest.mark.parametrize("resolution", ["half", "quarter"])
def test_pixels_between_those_with_rays_always_take_from_the_four_cells_around_them(resolution):
    frame = floor_and_wall(0.4)
    none, three = (light_of(frame, reuse=reuse, resolution=resolution).glossy for reuse in (0, 3))
    np.testing.assert_array_equal(none, three)


@functools.cache
def ledge() -> tuple[Frame, np.ndarray]:
    """A floor at the left, behind which a low dark wall hides the bright one, a platform that sees it, and
    the light of many rays (H, W)."""
    camera = Camera.perspective(48, 40, 1.0)
    surfaces = [
        replace(FLOOR, roughness=0.3, bounds=lambda p: p[:, 0] < 0.0),
        Plane((0.0, -0.6, 0.0), (0.0, 1.0, 0.0), specular=1.0, roughness=0.3,
              bounds=lambda p: p[:, 0] >= 0.0),
        Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), bounds=lambda p: (p[:, 0] < 0.0) & (p[:, 1] < -0.2)),
        Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), source=1.0),
    ]  # fmt: skip
    frame = capture(camera, surfaces), camera
    return frame, light_of(frame, rays=256, seed=7).glossy[..., 0]


# The four cells around a pixel of a quarter are so few that their noise says nothing of a leak.
@pytest.mark.parametrize("switches", SHARING[:3], ids=str)
def test_no_ray_is_borrowed_over_a_ledge(switches):
    """The platform looks over the low wall: its rays would show the floor a light that it does not see."""
    frame, truth = ledge()
    shared = light_of(frame, rays=32, **switches).glossy[..., 0]
    # The dark rows of the floor beside the platform, whose neighbours there are all but white
    rows = slice(31, 35)
    assert truth[rows, :24].max() < 0.1
    assert truth[rows, 24:30].min() > 0.8
    beside = np.abs(shared - truth)[rows, 18:30].mean(axis=0)
    assert beside.max() <= BEHIND_LEDGE_LIGHT


def test_neighbours_that_face_elsewhere_bring_nothing():
    """Normals in turn as the squares of a chessboard: those of the nearest four pixels are the other ones."""
    frame = floor_and_wall(0.6)
    floor = is_floor(frame)
    is_left = (np.indices((40, 40)).sum(axis=0) % 2 == 0)[..., None]
    turned = np.where(is_left, (-0.6, 0.8, 0.0), (0.6, 0.8, 0.0))
    bumpy = replace(frame[0], normal=np.where(floor[..., None], turned, frame[0].normal)), frame[1]
    alone, shared = (light_of(bumpy, rays=16, reuse=reuse).glossy[floor] for reuse in (0, 4))
    assert alone.std() > 0.1
    np.testing.assert_allclose(shared, alone, atol=REPEATED_SUM)


@pytest.mark.parametrize("resolution", ["half", "quarter"])
def test_a_wire_shows_the_same_with_fewer_rays(resolution, rng):
    """A sloping wire of single pixels before the floor: no cell beside its own lies on it."""
    camera = Camera.perspective(64, 48, 1.0)
    wire = Plane((0.0, 0.0, -2.0), (0.0, 0.6, 0.8), specular=1.0, roughness=0.4,
                 bounds=lambda p: np.abs(p[:, 0] - 0.3 * p[:, 1] - 0.1) < 0.018)  # fmt: skip
    frame = capture(camera, [wire, replace(FLOOR, roughness=0.4), WALL]), camera
    on_wire = np.abs(frame[0].normal[..., 2] - 0.8) < 0.1
    assert on_wire.sum() > 30
    assert on_wire.sum(axis=1).max() <= 2
    sky = Environment.equirectangular(2.0 * rng.random((8, 16, 3)), np.eye(4))
    full, fewer = (
        light_of(frame, sky, rays=rays, **options).glossy[on_wire]
        for rays, options in ((128, {}), (16, {"resolution": resolution}))
    )
    assert full.std() > 0.05  # there is something to see
    assert fewer.mean() == pytest.approx(float(full.mean()), rel=CLOSED_FORM_RELATIVE)
    assert np.abs(fewer - full).max() < full.max() - full.min()


MIXED = floor_and_wall(np.random.default_rng(5).choice([0.0, 0.1, 0.3, 0.6], (25, 31)), (31, 25))
WAYS = [
    {"rays": 1, "reuse": 8},
    {"rays": 6, "reuse": 8, "color_pyramid": True, "subpixel": True},
    {"rays": 6, "reuse": 4, "resolution": "half"},
    {"rays": 6, "reuse": 4, "resolution": "quarter", "roughness_tiers": True},
]


@pytest.mark.parametrize("options", WAYS, ids=str)
def test_threads_and_the_size_of_tasks_change_no_bit(options, monkeypatch):
    one = light_of(MIXED, WHITE, threads=1, **options)
    for per_task, threads in ((65536, 8), (500, 2), (97, 1)):
        monkeypatch.setattr(parallel, "RAYS_PER_TASK", per_task)
        other = light_of(MIXED, WHITE, threads=threads, **options)
        np.testing.assert_array_equal(other.glossy, one.glossy)
        np.testing.assert_array_equal(other.known_glossy, one.known_glossy)
        assert other.rays == one.rays


@pytest.mark.parametrize("options", WAYS, ids=str)
@pytest.mark.parametrize("rays_at_once", [9000, 700])
def test_rays_that_are_held_at_once_change_the_order_of_sums_alone(rays_at_once, options, monkeypatch):
    whole = light_of(MIXED, WHITE, **options)
    monkeypatch.setattr(parallel, "RAYS_AT_ONCE", rays_at_once)
    parts = light_of(MIXED, WHITE, **options)
    for name in ("glossy", "known_glossy"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=REPEATED_SUM)
        if options["rays"] == 1:  # every pixel's sum is of one grid, wherever the bands are cut
            np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    # Bands trace the rows around them again
    assert parts.rays["reflections"] >= whole.rays["reflections"]
