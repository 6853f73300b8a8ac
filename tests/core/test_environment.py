# SPDX-License-Identifier: GPL-3.0-or-later
"""Environments: Cycles' equirectangular mapping, rotation, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Environment
from tests.core.synthetic import look_at
from tests.tolerances import ENVIRONMENT_LOOKUP

# Blender's camera space seen from the world of an unrotated camera: the same axes.
AXES = {
    "+x": (1, 0, 0),
    "-x": (-1, 0, 0),
    "+y": (0, 1, 0),
    "-y": (0, -1, 0),
    "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}


def look(environment: Environment, direction) -> np.ndarray:
    return environment.radiance(*np.asarray(direction, dtype=np.float32).reshape(-1, 3).T)


def gradient(width: int = 64, height: int = 32) -> np.ndarray:
    """An image whose red is the column and whose green is the row, in pixels at their centres."""
    y, x = np.mgrid[0:height, 0:width] + 0.5
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def test_constant_environment_is_the_same_everywhere(rng):
    environment = Environment.constant((0.25, 1.0, 4.0))
    assert environment.is_constant
    np.testing.assert_array_equal(
        look(environment, rng.normal(size=(10, 3))), np.tile([0.25, 1.0, 4.0], (10, 1))
    )


def test_directions_read_the_pixels_of_cycles_mapping():
    environment = Environment.equirectangular(gradient(), np.eye(4))
    found = {name: look(environment, axis)[0] for name, axis in AXES.items()}
    # u = 0.5 - atan2(y, x) / 2 pi: +x in the middle, +y a quarter to the left, -y a quarter to the right
    for name, column in (("+x", 32.0), ("+y", 16.0), ("-y", 48.0)):
        np.testing.assert_allclose(found[name][:2], [column, 16.0], atol=ENVIRONMENT_LOOKUP * 64)
    assert found["+z"][1] == 0.5  # the top row
    assert found["-z"][1] == 31.5


@given(st.floats(-math.pi, math.pi), st.floats(0.2, math.pi - 0.2))
def test_longitude_and_latitude_follow_the_formula(azimuth, polar):
    direction = math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)
    image = gradient()
    # The seam blends the first and the last column
    column = (0.5 - azimuth / (2.0 * math.pi)) * 64
    found = look(Environment.equirectangular(image, np.eye(3)), direction)[0]
    if 0.5 <= column <= 63.5:
        assert found[0] == pytest.approx(column, abs=ENVIRONMENT_LOOKUP * 64)
    assert found[1] == pytest.approx(polar / math.pi * 32, abs=ENVIRONMENT_LOOKUP * 64)
    assert found[2] == pytest.approx(1.0)


def test_the_seam_behind_minus_x_is_closed():
    image = np.zeros((4, 8, 3))
    image[:, 0] = 2.0
    image[:, -1] = 4.0
    environment = Environment.equirectangular(image, np.eye(4))
    for y in (0.0, -0.0, 1e-7, -1e-7):
        np.testing.assert_allclose(look(environment, (-1.0, y, 0.0)), 3.0, atol=ENVIRONMENT_LOOKUP)


def test_view_directions_are_turned_into_the_world():
    pose = look_at((3.0, 1.0, -2.0), (0.0, 0.0, 0.0))
    image = gradient()
    turned, straight = Environment.equirectangular(image, pose), Environment.equirectangular(image, np.eye(4))
    view = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 0.6, -0.8]])
    np.testing.assert_allclose(
        look(turned, view), look(straight, view @ pose[:3, :3].T), atol=ENVIRONMENT_LOOKUP * 64
    )
    assert not np.allclose(look(turned, view), look(straight, view))


def test_mean_over_the_sphere_is_the_image_weighted_by_solid_angle(rng):
    image = rng.random((16, 32, 3))
    edges = np.cos(np.linspace(0.0, np.pi, 17))
    weight = (edges[:-1] - edges[1:]) / 2.0
    expected = (image.mean(axis=1) * weight[:, None]).sum(axis=0)
    directions = rng.normal(size=(200000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    found = look(Environment.equirectangular(image, np.eye(4)), directions).mean(axis=0)
    np.testing.assert_allclose(found, expected, rtol=0.01)


def test_bad_pixels_of_the_image_are_black():
    image = np.ones((2, 4, 3))
    image[0, 1] = np.nan
    image[1, 2, 0] = -1.0
    environment = Environment.equirectangular(image, np.eye(4))
    assert (environment.image[0, 1] == 0.0).all()
    assert (environment.image[1, 2] == 0.0).all()
    assert environment.image.sum() == 6 * 3
    assert np.isnan(image[0, 1]).all()


def test_a_single_pixel_is_a_constant_environment():
    assert Environment.equirectangular(np.ones((1, 1, 3)), np.eye(4)).is_constant


@pytest.mark.parametrize(
    "rgb",
    [1.0, (1.0, 2.0), (1.0, 2.0, -1.0), (1.0, np.nan, 0.0), (np.inf, 0.0, 0.0), "sky", ("r", "g", "b"), None],
)
def test_bad_constant_radiance_is_named(rgb):
    with pytest.raises(ValueError, match=r"^rgb: expected .*got"):
        Environment.constant(rgb)


@pytest.mark.parametrize("image", [np.ones((2, 4)), np.ones((2, 4, 4)), np.ones((0, 4, 3)), "sky", None])
def test_bad_images_are_named(image):
    with pytest.raises(ValueError, match=r"^image: expected .*got"):
        Environment.equirectangular(image, np.eye(4))


@pytest.mark.parametrize("pose", [np.eye(2), np.full((4, 4), np.nan), np.zeros((3, 3)), "north", None])
def test_bad_poses_are_named(pose):
    with pytest.raises(ValueError, match=r"^world_from_view: expected .*got"):
        Environment.equirectangular(np.ones((2, 4, 3)), pose)
