# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera
from ssgi_addon.core.pose import solve_camera
from tests.tolerances import SOLVED_POSE_PX, SOLVED_ROTATION


def random_pose(rng, distance=10.0):
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = rng.normal(size=3) * distance
    return pose


def passes_of(camera, rng, unit=1.0):
    """Position and Depth as Blender writes them, float32, of a bumpy surface with some sky."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    depth = unit * (5.0 + np.sin(0.13 * x) + np.cos(0.11 * y) + rng.uniform(0, 0.5, x.shape))
    points = camera.pixel_to_view(x, y, depth)
    position_ws = points @ camera.world_from_view[:3, :3].T + camera.world_from_view[:3, 3]
    depth[:3] = np.inf
    position_ws[:3] = 0.0
    return position_ws.astype(np.float32), depth.astype(np.float32)


def largest_error_px(found, camera, rng, unit):
    """How far apart two cameras put what the first of them sees."""
    points_vs = camera.pixel_to_view(
        rng.uniform(0, camera.width, 500), rng.uniform(0, camera.height, 500), rng.uniform(3, 9, 500) * unit
    )
    points_ws = points_vs @ camera.world_from_view[:3, :3].T + camera.world_from_view[:3, 3]
    pose = found.world_from_view
    there = found.view_to_pixel((points_ws - pose[:3, 3]) @ pose[:3, :3])
    here = camera.view_to_pixel(points_vs)
    return max(np.abs(there[0] - here[0]).max(), np.abs(there[1] - here[1]).max())


@given(
    seed=st.integers(0, 2**32 - 1),
    fov_x=st.floats(0.2, 2.5),
    shift=st.tuples(st.floats(-30, 30), st.floats(-30, 30)),
    pixel_aspect=st.floats(0.5, 2.0),
    unit=st.sampled_from([1e-3, 1.0, 1e4]),
    is_orthographic=st.booleans(),
)
def test_camera_is_solved_from_position_and_depth(seed, fov_x, shift, pixel_aspect, unit, is_orthographic):
    rng = np.random.default_rng(seed)
    make = Camera.orthographic if is_orthographic else Camera.perspective
    extent = 6.0 * fov_x * unit if is_orthographic else fov_x
    camera = make(
        64,
        48,
        extent,
        shift_px=shift,
        pixel_aspect=pixel_aspect,
        world_from_view=random_pose(rng, 10.0 * unit),
    )
    found = solve_camera(*passes_of(camera, rng, unit))
    assert found.is_orthographic == is_orthographic
    assert largest_error_px(found, camera, rng, unit) < SOLVED_POSE_PX
    np.testing.assert_allclose(
        found.world_from_view[:3, :3], camera.world_from_view[:3, :3], rtol=0, atol=SOLVED_ROTATION
    )


def test_samples_beside_the_pixel_centre_do_no_harm(rng):
    camera = Camera.perspective(160, 90, 0.9, world_from_view=random_pose(rng))
    y, x = np.mgrid[:90, :160] + 0.5
    depth = 5.0 + np.sin(0.13 * x) + np.cos(0.11 * y)
    points = camera.pixel_to_view(x + rng.normal(0, 0.05, x.shape), y + rng.normal(0, 0.05, x.shape), depth)
    position_ws = points @ camera.world_from_view[:3, :3].T + camera.world_from_view[:3, 3]
    found = solve_camera(position_ws, depth)
    assert largest_error_px(found, camera, rng, 1.0) < SOLVED_POSE_PX


def test_one_plane_is_refused(rng):
    camera = Camera.perspective(64, 48, 0.9, world_from_view=random_pose(rng))
    y, x = np.mgrid[:48, :64] + 0.5
    depth = 1.0 / (0.2 + 0.001 * x)
    points = camera.pixel_to_view(x, y, depth)
    position_ws = points @ camera.world_from_view[:3, :3].T + camera.world_from_view[:3, 3]
    with pytest.raises(ValueError, match="one plane"):
        solve_camera(position_ws.astype(np.float32), depth.astype(np.float32))


def test_panoramic_camera_is_refused(rng):
    y, x = np.mgrid[:48, :96] + 0.5
    longitude, latitude = (x / 96 - 0.5) * np.pi, (0.5 - y / 48) * np.pi / 2
    directions = np.stack(
        [np.cos(latitude) * np.sin(longitude), np.sin(latitude), -np.cos(latitude) * np.cos(longitude)],
        axis=-1,
    )
    distance = 5.0 + rng.uniform(0, 1, x.shape)
    with pytest.raises(ValueError, match="no perspective or orthographic camera fits"):
        solve_camera(directions * distance[..., None], distance)


def test_passes_of_different_frames_are_refused(rng):
    camera = Camera.perspective(64, 48, 0.9, world_from_view=random_pose(rng))
    position_ws, _ = passes_of(camera, rng)
    _, depth = passes_of(camera, rng)
    with pytest.raises(ValueError, match="fits Position and Depth"):
        solve_camera(position_ws, depth[::-1])


def test_mirrored_picture_is_refused(rng):
    camera = Camera.perspective(64, 48, 0.9, world_from_view=random_pose(rng))
    position_ws, depth = passes_of(camera, rng)
    with pytest.raises(ValueError, match="fits Position and Depth"):
        solve_camera(position_ws[:, ::-1], depth[:, ::-1])


def test_empty_sky_is_refused():
    with pytest.raises(ValueError, match="only 0 pixels show a surface"):
        solve_camera(np.zeros((48, 64, 3), np.float32), np.full((48, 64), np.inf, np.float32))
