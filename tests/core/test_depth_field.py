# SPDX-License-Identifier: GPL-3.0-or-later
"""Slabs and their pyramid: exact on planes, bounded by their neighbours, and never cut by a cell's bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera, GBuffer
from ssgi_addon.core.depth_field import MAX_LEVEL, DepthField
from tests.budget import examples
from tests.core.synthetic import Plane, Sphere, capture, random_gbuffer, uniform_gbuffer
from tests.tolerances import FLOAT32_DISTANCE

SIZES = [(1, 1), (1, 9), (9, 1), (3, 5), (16, 16), (13, 31), (64, 48), (129, 257)]
LENSES = {"perspective": Camera.perspective, "orthographic": Camera.orthographic}


def build(gbuffer: GBuffer, lens: str = "perspective", thickness: float = 0.1, **options: int) -> DepthField:
    camera = LENSES[lens](gbuffer.shape[1], gbuffer.shape[0], 1.0)
    return DepthField.build(gbuffer, camera, thickness, **options)


def cells(field: DepthField, atlas: np.ndarray, level: int) -> np.ndarray:
    """Return one level of an atlas as an image."""
    rows, columns = field.padded_height >> level, field.padded_width >> level
    index = field.origins[level] + np.arange(rows)[:, None] * field.stride + np.arange(columns)
    return atlas[index]


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("shape", SIZES)
def test_every_cell_bounds_the_patches_and_backs_below_it(shape, lens, rng):
    gbuffer = random_gbuffer(rng, shape)
    field = build(gbuffer, lens)
    front, slab = field.front.reshape(shape), field.slab.reshape(shape)
    half = 0.5 * (np.abs(field.gradient_x) + np.abs(field.gradient_y)).reshape(shape)
    for level in range(field.levels):
        nearest, farthest = (
            cells(field, field.nearest, level),
            cells(field, field.farthest, level),
        )
        y, x = np.nonzero(~gbuffer.is_background)
        cell = y >> level, x >> level
        assert (nearest[cell] >= (front + half)[y, x]).all()
        assert (farthest[cell] <= (front - half - slab)[y, x]).all()


@pytest.mark.parametrize("shape", SIZES)
def test_coarse_cells_hold_the_extremes_of_their_four_children(shape, rng):
    field = build(random_gbuffer(rng, shape))
    for level in range(1, field.levels):
        for atlas, reduce in ((field.nearest, np.max), (field.farthest, np.min)):
            children = cells(field, atlas, level - 1)
            blocks = children.reshape(children.shape[0] // 2, 2, children.shape[1] // 2, 2)
            np.testing.assert_array_equal(cells(field, atlas, level), reduce(blocks, axis=(1, 3)))


def test_background_and_padding_stop_no_ray():
    field = build(uniform_gbuffer((3, 5), np.inf))
    assert np.isneginf(field.nearest).all()
    assert np.isposinf(field.farthest).all()
    assert np.isneginf(field.front).all()


@pytest.mark.parametrize(
    ("size", "levels"), [(1, 1), (2, 1), (3, 2), (4, 2), (5, 3), (64, 6), (65, 7), (4096, 8)]
)
def test_levels_follow_the_longer_side(size, levels):
    field = build(uniform_gbuffer((1, size)))
    assert field.levels == levels <= MAX_LEVEL + 1
    assert field.padded_width % (1 << (levels - 1)) == 0
    assert field.padded_width - size < 1 << (levels - 1)
    assert build(uniform_gbuffer((1, size)), max_level=0).levels == 1


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.5, -0.3, 0.8), (-0.9, 0.1, 0.4)])
def test_patches_of_a_plane_are_the_plane(lens, normal):
    camera = LENSES[lens](24, 18, 1.0)
    plane = Plane((0.0, 0.0, -5.0), normal)
    gbuffer = capture(camera, [plane])
    field = DepthField.build(gbuffer, camera, 0.1)
    # The same plane, sampled a third of a pixel to the side
    moved = LENSES[lens](24, 18, 1.0, shift_px=(-1.0 / 3.0, 0.25))
    depth = capture(moved, [plane]).depth.ravel().astype(np.float64)
    expected = -depth if camera.is_orthographic else 1.0 / depth
    found = field.front + field.gradient_x / 3.0 - field.gradient_y * 0.25
    seen = ~field.is_background & np.isfinite(depth)
    assert seen.sum() > 100
    np.testing.assert_allclose(found[seen], expected[seen], rtol=FLOAT32_DISTANCE)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (13, 31)])
def test_no_patch_reaches_past_its_neighbours(shape, lens, rng):
    gbuffer = random_gbuffer(rng, shape, sky=0.0)
    field = build(gbuffer, lens)
    front = field.front.reshape(shape)
    for axis, gradient in ((1, field.gradient_x.reshape(shape)), (0, field.gradient_y.reshape(shape))):
        difference = np.abs(np.diff(front, axis=axis))
        if not difference.size:
            assert (gradient == 0.0).all()
            continue
        pad = [(0, 0), (0, 0)]
        pad[axis] = (1, 1)
        padded = np.pad(difference, pad, mode="edge")
        before, after = (
            np.take(padded, range(shape[axis]), axis),
            np.take(padded, range(1, shape[axis] + 1), axis),
        )
        assert (np.abs(gradient) <= np.maximum(before, after)).all()


def test_silhouettes_do_not_stick_out_of_a_ball():
    """A tangent at the rim is endlessly steep; its patch rises no more than the surface beside it does."""
    gbuffer = capture(Camera.perspective(64, 64, 1.0), [Sphere((0.3, -0.2, -6.0), 2.0)])
    field = build(gbuffer)
    q = np.where(gbuffer.is_background, np.nan, field.front.reshape(64, 64))
    highest = np.nanmax(q)  # the ball's nearest point
    top = field.front + 0.5 * (np.abs(field.gradient_x) + np.abs(field.gradient_y))
    assert top[~field.is_background].max() <= highest * 1.01


def test_thickness_relative_to_depth_scales_with_the_scene():
    near, far = (build(uniform_gbuffer((2, 2), depth), thickness=0.25) for depth in (2.0, 2.0e5))
    for field, depth in ((near, 2.0), (far, 2.0e5)):
        back = 1.0 / (field.front - field.slab)
        np.testing.assert_allclose(back, depth * 1.25, rtol=FLOAT32_DISTANCE)


def test_thickness_of_parallel_views_is_relative_to_their_width():
    camera = Camera.orthographic(8, 4, 10.0)
    for depth in (2.0, 2.0e3):
        field = DepthField.build(uniform_gbuffer((4, 8), depth), camera, 0.25)
        np.testing.assert_allclose(field.slab, 2.5, rtol=FLOAT32_DISTANCE)


@pytest.mark.parametrize("lens", LENSES)
def test_captured_thickness_is_the_slab(lens):
    gbuffer = replace(uniform_gbuffer((1, 4), 2.0), thickness=np.array([[0.0, 0.25, 0.5, np.inf]]))
    field = build(gbuffer, lens, thickness=77.0)
    back = field.front - field.slab
    depth = -back if lens == "orthographic" else 1.0 / np.maximum(back, 1e-30)
    np.testing.assert_allclose(depth[:3], [2.0, 2.25, 2.5], rtol=FLOAT32_DISTANCE)
    assert back[3] == field.q_end


@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(LENSES)), st.floats(0.0, 1e6))
@examples(max_examples=30)
def test_a_field_holds_no_nan_whatever_the_frame(seed, lens, thickness):
    rng = np.random.default_rng(seed)
    gbuffer = random_gbuffer(rng, (7, 9), sky=rng.choice([0.0, 0.5, 1.0]))
    normal = gbuffer.normal.copy()
    normal[rng.random((7, 9)) < 0.3] = [1.0, 0.0, 0.0]  # edge on
    gbuffer = uniform_gbuffer((7, 9), gbuffer.depth * 10.0 ** rng.uniform(-3, 5), normal=normal)
    field = build(gbuffer, lens, thickness)
    for name in ("gradient_x", "gradient_y", "slab", "reach", "footprint", "largest_step"):
        assert np.isfinite(getattr(field, name)).all(), name
    assert (field.slab >= 0.0).all()
    assert (field.reach >= 0.0).all()
    assert not np.isnan(field.nearest).any()
    assert not np.isnan(field.farthest).any()


def test_camera_of_another_size_is_named():
    with pytest.raises(ValueError, match=r"^camera: expected 4x3 .*got 3x4"):
        DepthField.build(uniform_gbuffer((3, 4)), Camera.perspective(3, 4, 1.0), 0.1)
