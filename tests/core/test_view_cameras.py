# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras beyond the frame: where they stand, and where points lie in their images."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera
from ssgi_addon.core.stations import CUBE_FACES
from ssgi_addon.view_cameras import overscan_camera, surround_cameras
from tests.budget import examples
from tests.core.synthetic import look_at
from tests.tolerances import PROJECTION_RELATIVE, SIZE_IN_WHOLE_PIXELS

POSE = look_at((1.0, 2.0, 3.0), (-2.0, 0.5, -1.0))


@st.composite
def cameras(draw) -> Camera:
    width, height = draw(st.integers(1, 2000)), draw(st.integers(1, 2000))
    lens = {
        "shift_px": (draw(st.floats(-1.0, 1.0)) * width, draw(st.floats(-1.0, 1.0)) * height),
        "pixel_aspect": draw(st.sampled_from([1.0, 0.5, 1.8])),
        "world_from_view": POSE,
    }
    if draw(st.booleans()):
        return Camera.orthographic(width, height, draw(st.floats(0.01, 100.0)), **lens)
    return Camera.perspective(width, height, draw(st.floats(0.1, 2.8)), **lens)


@given(cameras(), st.floats(1.0, 4.0), st.integers(0, 2**32 - 1))
@examples(max_examples=60)
def test_points_lie_in_the_overscan_where_they_lie_in_the_frame(camera, factor, seed):
    """Measured from the middles, in units of the scene at depth 1."""
    rng = np.random.default_rng(seed)
    wide = overscan_camera(camera, factor)
    assert wide.is_orthographic == camera.is_orthographic
    np.testing.assert_array_equal(wide.world_from_view, camera.world_from_view)
    assert wide.fx == wide.fy
    x, y = rng.uniform(-1, 2, 20) * camera.width, rng.uniform(-1, 2, 20) * camera.height
    wide_x, wide_y, _ = wide.view_to_pixel(camera.pixel_to_view(x, y, rng.uniform(0.5, 20.0, 20)))
    for found, size, focal, position, expected_size, expected_focal in (
        (wide_x, wide.width, wide.fx, x, camera.width, camera.fx),
        (wide_y, wide.height, wide.fy, y, camera.height, camera.fy),
    ):
        from_middle = (position - 0.5 * expected_size) / expected_focal
        scale = expected_size / expected_focal
        error = (found - 0.5 * size) / focal - from_middle
        assert np.abs(error).max() <= PROJECTION_RELATIVE * scale * factor


@given(cameras(), st.floats(1.0, 4.0))
@examples(max_examples=60)
def test_overscan_is_as_wide_and_high_as_asked_for(camera, factor):
    wide = overscan_camera(camera, factor)
    for size, focal, frame_size, frame_focal in (
        (wide.width, wide.fx, camera.width, camera.fx),
        (wide.height, wide.fy, camera.height, camera.fy),
    ):
        exact = factor * frame_size / frame_focal * focal
        assert size == max(1, round(exact)) or abs(size - exact) <= SIZE_IN_WHOLE_PIXELS
    if min(wide.width, wide.height) > 20:
        is_close = math.isclose(wide.width * wide.height, camera.width * camera.height, rel_tol=0.05)
        assert is_close


@pytest.mark.parametrize("make", [Camera.perspective, Camera.orthographic])
def test_overscan_of_once_the_size_is_the_frame(make):
    camera = make(64, 48, 1.2, shift_px=(3.0, -5.0), world_from_view=POSE)
    same = overscan_camera(camera, 1.0)
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(same, name) == pytest.approx(getattr(camera, name), rel=PROJECTION_RELATIVE)


@pytest.mark.parametrize("make", [Camera.perspective, Camera.orthographic])
def test_each_direction_lies_in_one_face_of_a_surround(make, rng):
    camera = make(64, 48, 1.2, shift_px=(3.0, -5.0), pixel_aspect=0.7, world_from_view=POSE)
    faces = surround_cameras(camera, 5.0, 0.1, 10)
    assert len(faces) == len(CUBE_FACES)
    place = faces[0].world_from_view[:3, 3]
    directions = rng.normal(size=(500, 3))
    seen = np.zeros(500, dtype=int)
    for face in faces:
        rotation = face.world_from_view[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=PROJECTION_RELATIVE)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        np.testing.assert_array_equal(face.world_from_view[:3, 3], place)
        x, y, depth = face.view_to_pixel(directions @ rotation)
        seen += (depth > 0.0) & (np.abs(x - 5.0) < 5.0) & (np.abs(y - 5.0) < 5.0)
    assert (seen == 1).all()


def test_surround_of_a_perspective_frame_stands_at_its_camera(rng):
    """What the frame shows lies in the front face where a camera of 90 degrees would show it."""
    camera = Camera.perspective(64, 48, 1.2, shift_px=(3.0, -5.0), pixel_aspect=0.7, world_from_view=POSE)
    front = surround_cameras(camera, 5.0, 0.1, 10)[0]
    np.testing.assert_array_equal(front.world_from_view[:3, 3], POSE[:3, 3])
    x, y = rng.uniform(0, 64, 50), rng.uniform(0, 48, 50)
    point = camera.pixel_to_view(x, y, np.full(50, 3.0))
    found_x, found_y, _ = front.view_to_pixel(point)
    np.testing.assert_allclose(found_x, 5.0 + 5.0 * (x - camera.cx) / camera.fx, rtol=PROJECTION_RELATIVE)
    np.testing.assert_allclose(found_y, 5.0 + 5.0 * (y - camera.cy) / camera.fy, rtol=PROJECTION_RELATIVE)


@pytest.mark.parametrize(
    ("nearest", "ahead"), [(50.0, 47.0), (4.0, 1.0), (3.5, 1.0), (1.0, 1.0), (math.inf, 1.0)]
)
def test_orthographic_surround_stands_half_a_frame_before_the_nearest_surface(nearest, ahead):
    camera = Camera.orthographic(60, 30, 6.0, shift_px=(10.0, 0.0))
    front = surround_cameras(camera, nearest, 1.0, 4)[0]
    np.testing.assert_allclose(front.world_from_view[:3, 3], (-1.0, 0.0, -ahead))
    np.testing.assert_array_equal(front.world_from_view[:3, :3], camera.world_from_view[:3, :3])


def test_orthographic_frame_lies_in_the_front_face():
    camera = Camera.orthographic(60, 30, 6.0, shift_px=(10.0, -4.0), pixel_aspect=0.8, world_from_view=POSE)
    front = surround_cameras(replace(camera), 9.0, 0.1, 8)[0]
    x, y = np.meshgrid([0.0, 60.0], [0.0, 30.0])
    moved = np.linalg.inv(front.world_from_view) @ POSE
    corner = camera.pixel_to_view(x.ravel(), y.ravel(), np.full(4, 9.0)) @ moved[:3, :3].T + moved[:3, 3]
    x, y, depth = front.view_to_pixel(corner)
    assert depth.min() > 0.0
    # The wider side reaches from border to border
    borders = (x.min(), x.max()) if 60 / camera.fx >= 30 / camera.fy else (y.min(), y.max())
    np.testing.assert_allclose(borders, (0.0, 8.0), atol=8.0 * PROJECTION_RELATIVE)
    assert max(abs(x - 4.0).max(), abs(y - 4.0).max()) <= 4.0 * (1.0 + PROJECTION_RELATIVE)
