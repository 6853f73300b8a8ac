# SPDX-License-Identifier: GPL-3.0-or-later
"""Stations: where views are chosen from elsewhere, in rooms of which the frame hides a part."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import Camera, Settings, tracer
from ssgi_addon.core.frame_points import surface_points
from ssgi_addon.core.scene import TraceScene
from ssgi_addon.core.stations import find_lost_rays
from ssgi_addon.view_cameras import square_camera, surround_cameras
from tests.core.synthetic import Plane, capture, look_at, uniform_gbuffer
from tests.core.test_tracer import unit
from tests.tolerances import (
    HIDDEN_WALL_SEEN,
    HIDDEN_WALL_SEEN_BY_FOUR,
    LOST_RAYS_WON_BACK,
    SAME_HIT,
    UNIT_NORMAL,
)

CLAY = {"albedo": 0.5}
BACK_WALL = -6.0


def box(low, high) -> list[Plane]:
    """Return the six sides of a box that stands along the axes."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    sides = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]

        def is_within(p, others=others):
            return ((p[:, others] >= low[others]) & (p[:, others] <= high[others])).all(axis=1)

        normal = np.eye(3)[axis]
        sides += [Plane(at[axis] * normal, normal, bounds=is_within, **CLAY) for at in (low, high)]
    return sides


ROOM = [Plane(at, at, **CLAY) for at in (*(2.0 * np.eye(3)), (-2.0, 0, 0), (0, -2.0, 0), (0, 0, BACK_WALL))]
LOW, HIGH = np.array([-0.6, -0.8, -3.5]), np.array([0.6, 0.5, -3.0])
HIDING = box(LOW, HIGH)


def room_and_box():
    """Return the frame, its camera, and a surround: what rays lose lies behind the box."""
    camera = Camera.perspective(64, 48, 1.1)
    around = surround_cameras(camera, 2.0, 0.1, 48)
    return capture(camera, [*ROOM, *HIDING]), camera, [(capture(c, [*ROOM, *HIDING]), c) for c in around]


def sees(station: Camera, points: np.ndarray) -> np.ndarray:
    """Return which world-space points (N, 3) a camera sees past the box, in closed form."""
    place = station.world_from_view[:3, 3]
    toward = points - place
    nearest = np.min([t for side in HIDING for t, _ in side.meet(place, toward)], axis=0)
    pose = np.linalg.inv(station.world_from_view)
    x, y, depth = station.view_to_pixel(points @ pose[:3, :3].T + pose[:3, 3])
    is_in_frame = (x > 0) & (x < station.width) & (y > 0) & (y < station.height)
    return (depth > 0.0) & is_in_frame & (nearest > 1.0)


def hidden_wall(camera: Camera) -> np.ndarray:
    """Return points of the back wall that the box hides from the frame."""
    x, y = np.meshgrid(np.linspace(-1.9, 1.9, 40), np.linspace(-1.9, 1.9, 40))
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, BACK_WALL)], axis=1)
    x, y, _ = camera.view_to_pixel(points)
    is_in_frame = (x > 0) & (x < camera.width) & (y > 0) & (y < camera.height)
    return points[is_in_frame & ~sees(camera, points)]


def test_first_station_sees_the_wall_that_a_box_hides():
    frame, camera, around = room_and_box()
    hidden = hidden_wall(camera)
    assert 100 < len(hidden) < 1000
    poses = find_lost_rays(frame, camera, around, Settings()).stations(3)
    first = square_camera(poses[0], 64)
    assert sees(first, hidden).mean() >= HIDDEN_WALL_SEEN
    # It stands in the room, and not within the box
    place = poses[0][:3, 3]
    assert (np.abs(place[:2]) < 2.0).all()
    assert BACK_WALL < place[2] < 2.0
    assert not ((place > LOW) & (place < HIGH)).all()


def test_poses_are_rigid_and_in_world_space():
    moved = look_at((3.0, -2.0, 5.0), (1.0, 0.0, -3.0))
    frame, camera, _ = room_and_box()
    there = Camera.perspective(64, 48, 1.1, world_from_view=moved)
    here, away = (find_lost_rays(frame, one, (), Settings()).stations(4) for one in (camera, there))
    assert len(here) == len(away) == 4
    for pose, other in zip(here, away):
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=UNIT_NORMAL)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_array_equal(pose[3], (0.0, 0.0, 0.0, 1.0))
        np.testing.assert_allclose(other, moved @ pose, atol=UNIT_NORMAL)


def test_stations_are_the_same_again_with_any_number_of_threads(monkeypatch):
    monkeypatch.setattr(tracer, "LEAST_RAYS", 100)
    frame, camera, around = room_and_box()
    first, again, threaded = (
        find_lost_rays(frame, camera, around, Settings(threads=threads)).stations(4) for threads in (1, 1, 4)
    )
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, threaded)
    # And asking for fewer gives the first of them
    np.testing.assert_array_equal(find_lost_rays(frame, camera, around, Settings()).stations(2), first[:2])


def test_stations_differ_from_each_other_and_win_rays_back(rng):
    frame, camera, around = room_and_box()
    stations = [
        square_camera(pose, 48) for pose in find_lost_rays(frame, camera, around, Settings()).stations(4)
    ]
    assert len({one.world_from_view.tobytes() for one in stations}) == 4
    hidden = hidden_wall(camera)
    assert np.any([sees(one, hidden) for one in stations], axis=0).mean() >= HIDDEN_WALL_SEEN_BY_FOUR
    views = [(capture(one, [*ROOM, *HIDING]), one) for one in stations]
    origin, normal = surface_points(frame, camera, np.arange(64 * 48))
    direction = (normal + unit(rng.normal(size=normal.shape))).astype(np.float32)
    lifted = (0.9999 * origin.T).astype(np.float64)
    meetings = [side.meet(lifted, direction.T.astype(np.float64)) for side in (*ROOM, *HIDING)]
    true = np.min([t for met in meetings for t, _ in met], axis=0)
    alone, with_one, with_four = (
        is_right(TraceScene(frame, camera, [*around, *views[:count]], Settings()), origin, direction, true)
        for count in (0, 1, 4)
    )
    assert with_one - alone >= LOST_RAYS_WON_BACK["one"] * (1.0 - alone)
    assert with_four - alone >= LOST_RAYS_WON_BACK["four"] * (1.0 - alone)


def is_right(scene, origin, direction, true) -> float:
    """Return the share of rays whose hit lies where it should."""
    found = scene.answer(origin, direction)
    return float(((found.status == tracer.HIT) & np.isclose(found.distance, true, rtol=SAME_HIT)).mean())


def test_no_station_where_nothing_is_lost():
    """A closed convex room, and all of it around the camera."""
    camera = Camera.perspective(64, 48, 1.1)
    surround = [(capture(one, ROOM), one) for one in surround_cameras(camera, 2.0, 0.1, 48)]
    assert find_lost_rays(capture(camera, ROOM), camera, surround, Settings()).stations(4) == []


def test_no_station_without_surfaces_that_receive_light():
    camera = Camera.perspective(16, 12, 1.1)
    empty = uniform_gbuffer((12, 16), np.inf)
    black = uniform_gbuffer((12, 16), 5.0, albedo=0.0)
    for frame in (empty, black):
        assert find_lost_rays(frame, camera, (), Settings()).stations(4) == []
        assert find_lost_rays(frame, camera, [(empty, camera)], Settings()).stations(4) == []
    frame, camera, _ = room_and_box()
    assert find_lost_rays(frame, camera, (), Settings()).stations(0) == []


def test_views_of_nothing_are_no_places_to_look_from():
    frame, camera, around = room_and_box()
    nothing = Camera.perspective(8, 8, 1.0, world_from_view=look_at((0, 0, 50.0), (0, 0, 90.0)))
    views = [*around, (uniform_gbuffer((8, 8), np.inf), nothing)]
    poses = find_lost_rays(frame, camera, views, Settings()).stations(1)
    assert sees(square_camera(poses[0], 64), hidden_wall(camera)).mean() >= HIDDEN_WALL_SEEN
