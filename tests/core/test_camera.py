# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras: the documented intrinsics, and projection there and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera
from tests.tolerances import PROJECTION_RELATIVE

MAKERS = {"perspective": Camera.perspective, "orthographic": Camera.orthographic}


@pytest.mark.parametrize("name", MAKERS)
@given(
    size=st.tuples(st.integers(1, 5000), st.integers(1, 5000)),
    extent=st.floats(0.05, 3.0),
    shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    aspect=st.floats(0.25, 4.0),
    point=st.tuples(st.floats(-2, 3), st.floats(-2, 3), st.floats(1e-3, 1e6)),
)
def test_projection_and_unprojection_are_inverse(name, size, extent, shift, aspect, point):
    camera = MAKERS[name](*size, extent, shift_px=shift, pixel_aspect=aspect)
    x, y, depth = point[0] * size[0], point[1] * size[1], point[2]
    found = camera.view_to_pixel(camera.pixel_to_view(np.array(x), np.array(y), np.array(depth)))
    scale = max(size) + max(abs(shift[0]), abs(shift[1]))
    np.testing.assert_allclose(found[:2], (x, y), atol=PROJECTION_RELATIVE * scale, rtol=PROJECTION_RELATIVE)
    assert float(found[2]) == depth


@pytest.mark.parametrize("name", MAKERS)
def test_optical_axis_meets_the_shifted_image_centre(name):
    camera = MAKERS[name](200, 100, 1.0, shift_px=(7.0, -3.0))
    x, y, depth = camera.view_to_pixel(np.array([0.0, 0.0, -4.0]))
    assert (float(x), float(y), float(depth)) == (107.0, 47.0, 4.0)


def test_field_of_view_spans_the_width():
    camera = Camera.perspective(200, 100, math.radians(70))
    edge = math.tan(math.radians(35))
    x, y, _ = camera.view_to_pixel(np.array([[-edge, 0.0, -1.0], [edge, 0.0, -1.0]]) * 3.0)
    np.testing.assert_allclose(x, [0.0, 200.0], atol=PROJECTION_RELATIVE * 200)
    np.testing.assert_allclose(y, 50.0)


def test_width_in_units_spans_the_width_at_any_depth():
    camera = Camera.orthographic(200, 100, 8.0)
    for depth in (0.1, 1e4):
        x, y, _ = camera.view_to_pixel(np.array([[-4.0, 2.0, -depth], [4.0, -2.0, -depth]]))
        np.testing.assert_allclose(x, [0.0, 200.0])
        np.testing.assert_allclose(y, [0.0, 100.0])


@pytest.mark.parametrize("name", MAKERS)
def test_pixel_aspect_is_width_over_height(name):
    camera = MAKERS[name](200, 100, 1.0, pixel_aspect=2.0)
    # A pixel that is twice as wide as high covers twice as many units across as down
    origin, right, below = camera.pixel_to_view(
        np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.ones(3)
    )
    assert right[0] - origin[0] == pytest.approx(2.0 * (origin[1] - below[1]), rel=PROJECTION_RELATIVE)
    assert camera.fy == camera.fx * 2.0


def test_rows_count_downwards_and_the_camera_looks_along_minus_z():
    camera = Camera.perspective(10, 10, 1.0)
    above = camera.pixel_to_view(np.array(5.0), np.array(0.0), np.array(2.0))
    assert above[1] > 0.0
    assert above[2] == -2.0


def test_pose_is_the_identity_unless_given_and_is_copied():
    assert (Camera.perspective(4, 3, 1.0).world_from_view == np.eye(4)).all()
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0
    camera = Camera.orthographic(4, 3, 1.0, world_from_view=pose)
    pose[0, 3] = 99.0
    assert camera.world_from_view[0, 3] == 1.0
    assert camera.world_from_view.dtype == np.float64


def test_integer_and_numpy_numbers_are_taken():
    camera = Camera.perspective(
        np.int64(4), np.int32(3), np.float32(1.0), shift_px=np.zeros(2), pixel_aspect=1
    )
    assert (camera.width, camera.height) == (4, 3)
    assert isinstance(camera.fx, float)


BAD_POSE = np.eye(4)
BAD_POSE[1, 2] = np.nan
NOTHING = np.zeros((4, 4))


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize(
    ("field", "arguments"),
    [
        ("width", {"width": 0}),
        ("width", {"width": 4.5}),
        ("width", {"width": True}),
        ("height", {"height": -3}),
        ("height", {"height": "3"}),
        ("shift_px", {"shift_px": (1.0,)}),
        ("shift_px", {"shift_px": 1.0}),
        ("shift_px", {"shift_px": (math.nan, 0.0)}),
        ("pixel_aspect", {"pixel_aspect": 0.0}),
        ("pixel_aspect", {"pixel_aspect": math.inf}),
        ("world_from_view", {"world_from_view": np.eye(3)}),
        ("world_from_view", {"world_from_view": BAD_POSE}),
        ("world_from_view", {"world_from_view": NOTHING}),
        ("world_from_view", {"world_from_view": "here"}),
    ],
)
def test_bad_arguments_are_named(name, field, arguments):
    size = arguments.get("width", 4), arguments.get("height", 3)
    lens = {key: value for key, value in arguments.items() if key not in ("width", "height")}
    with pytest.raises(ValueError, match=rf"^{field}: expected .*got"):
        MAKERS[name](*size, 1.0, **lens)


@pytest.mark.parametrize("fov", [0.0, math.pi, -1.0, math.nan, "wide", None])
def test_bad_fields_of_view_are_named(fov):
    with pytest.raises(ValueError, match=r"^fov_x: expected .*got"):
        Camera.perspective(4, 3, fov)


@pytest.mark.parametrize("units", [0.0, -1.0, math.inf, None])
def test_bad_widths_in_units_are_named(units):
    with pytest.raises(ValueError, match=r"^width_units: expected .*got"):
        Camera.orthographic(4, 3, units)
