# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample points and directions: where they lie, how evenly, and what they depend on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core.sampling import cosine_directions, sample_square, tangent_frame
from tests.tolerances import HEMISPHERE_MOMENT, UNIT_NORMAL

FLOAT32 = np.dtype(np.float32)
AXES = np.array([[s * (i == j) for j in range(3)] for i in range(3) for s in (1.0, -1.0)], dtype=np.float32)


@given(st.integers(0, 2**31 - 1), st.integers(1, 4096), st.integers(1, 20000), st.integers(0, 2**40))
def test_sample_points_lie_in_the_half_open_square(seed, rays, width, first):
    pixel = np.arange(first, first + 3)
    for values in sample_square(pixel, width, rays, seed, FLOAT32):
        assert values.dtype == np.float32
        assert values.shape == (rays, 3)
        assert (values >= 0.0).all()
        assert (values < 1.0).all()


def test_sample_points_depend_on_pixel_ray_and_seed_alone():
    together = sample_square(np.arange(400), 20, 8, 5, FLOAT32)
    some = np.array([399, 0, 77])
    for all_pixels, alone in zip(together, sample_square(some, 20, 8, 5, FLOAT32), strict=True):
        np.testing.assert_array_equal(all_pixels[:, some], alone)


def test_seeds_and_neighbours_draw_different_points():
    u, v = sample_square(np.arange(400), 20, 8, 5, FLOAT32)
    other_u, other_v = sample_square(np.arange(400), 20, 8, 6, FLOAT32)
    assert not np.isclose(u, other_u).all()
    assert not np.isclose(v, other_v).all()
    assert (np.abs(np.diff(u, axis=1)) > 0.0).all()
    assert not np.array_equal(u, v)


def largest_gap(values: np.ndarray) -> float:
    return float(np.diff(np.concatenate([[0.0], np.sort(values), [1.0]])).max())


@pytest.mark.parametrize("rays", [16, 64])
def test_one_pixel_covers_the_square_evenly(rays):
    u, v = sample_square(np.array([37]), 16, rays, 3, FLOAT32)
    assert largest_gap(u[:, 0]) < 4.0 / rays
    assert largest_gap(v[:, 0]) < 4.0 / rays
    cells = np.histogram2d(u[:, 0], v[:, 0], bins=4, range=[[0, 1], [0, 1]])[0]
    assert (cells > 0).all() if rays >= 64 else (cells > 0).sum() >= 13


def test_neighbours_together_cover_the_square_more_evenly_than_chance(rng):
    """What a filter averages: 4 x 4 pixels of 4 rays against as many random points."""
    y, x = np.mgrid[8:12, 4:8]
    u, v = sample_square((y * 32 + x).ravel(), 32, 4, 3, FLOAT32)
    cells = np.histogram2d(u.ravel(), v.ravel(), bins=8, range=[[0, 1], [0, 1]])[0]
    chance = np.histogram2d(*rng.random((2, 64)), bins=8, range=[[0, 1], [0, 1]])[0]
    assert cells.var() < 0.5 * chance.var()


def test_mean_over_pixels_is_the_integral():
    pixel = np.arange(64 * 64)
    u, v = sample_square(pixel, 64, 4, 11, FLOAT32)
    for values in (u, v):
        assert values.mean(dtype=np.float64) == pytest.approx(0.5, abs=HEMISPHERE_MOMENT)
        assert (values.astype(np.float64) ** 2).mean() == pytest.approx(1.0 / 3.0, abs=HEMISPHERE_MOMENT)
    assert (u.astype(np.float64) * v).mean() == pytest.approx(0.25, abs=HEMISPHERE_MOMENT)


def unit_normals(rng: np.random.Generator) -> np.ndarray:
    random = rng.normal(size=(3, 500))
    # Around the pole where the basis turns over, and the axes exactly
    near = np.array([[1e-4, -1e-7, 0.0], [0.0, 1e-7, -1e-4], [-1.0, -1.0, -1.0]])
    normals = np.concatenate([random, near, AXES.T, -0.0 * AXES.T + AXES.T], axis=1)
    return (normals / np.linalg.norm(normals, axis=0)).astype(np.float32)


def test_tangent_frames_are_right_handed_and_orthonormal(rng):
    normal = unit_normals(rng)
    tangent, bitangent = tangent_frame(normal)
    for a, b, expected in (
        (tangent, tangent, 1.0),
        (bitangent, bitangent, 1.0),
        (tangent, bitangent, 0.0),
        (tangent, normal, 0.0),
        (bitangent, normal, 0.0),
    ):
        np.testing.assert_allclose((a * b).sum(axis=0), expected, atol=UNIT_NORMAL)
    np.testing.assert_allclose(np.cross(tangent.T, bitangent.T).T, normal, atol=UNIT_NORMAL)


def test_cosine_directions_are_unit_vectors_above_the_surface(rng):
    normal = unit_normals(rng)
    pixel = np.arange(normal.shape[1])
    direction = cosine_directions(*sample_square(pixel, 100, 32, 0, FLOAT32), normal)
    assert direction.shape == (3, 32, normal.shape[1])
    assert direction.dtype == np.float32
    np.testing.assert_allclose((direction**2).sum(axis=0), 1.0, atol=UNIT_NORMAL)
    assert ((direction * normal[:, None]).sum(axis=0) >= -UNIT_NORMAL).all()


@pytest.mark.parametrize("normal", AXES.tolist())
def test_cosine_directions_have_the_moments_of_their_density(normal):
    """With density cos / pi: E[cos] = 2/3, E[cos^2] = 1/2, and nothing leans to a side."""
    normal = np.array(normal, dtype=np.float32).reshape(3, 1)
    direction = cosine_directions(*sample_square(np.array([0]), 1, 4096, 1, FLOAT32), normal)[..., 0]
    cosine = (direction * normal).sum(axis=0, dtype=np.float64)
    assert cosine.mean() == pytest.approx(2.0 / 3.0, abs=HEMISPHERE_MOMENT)
    assert (cosine**2).mean() == pytest.approx(0.5, abs=HEMISPHERE_MOMENT)
    sideways = direction - normal * cosine
    np.testing.assert_allclose(sideways.mean(axis=1), 0.0, atol=HEMISPHERE_MOMENT)
    spread = (sideways.astype(np.float64) ** 2).mean(axis=1)
    np.testing.assert_allclose(spread[normal[:, 0] == 0.0], 0.25, atol=HEMISPHERE_MOMENT)
