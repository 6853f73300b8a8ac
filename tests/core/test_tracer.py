# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through a depth field: the accelerated walks against the scalar oracle, and against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera, GBuffer, tracer, walk
from ssgi_addon.core.depth_field import DepthField
from tests.budget import examples
from tests.core.synthetic import Plane, Sphere, capture, uniform_gbuffer
from tests.reference.scalar_tracer import trace_ray
from tests.tolerances import (
    CONVEX_SELF_HITS,
    FLOAT32_DISTANCE,
    FLOAT32_RAYS_THAT_DIFFER,
    FLOAT64_DISTANCE,
    FLOAT64_ROUNDINGS,
)

SIZES = st.one_of(
    st.sampled_from([(1, 1), (1, 7), (9, 1), (3, 5), (13, 11), (16, 16), (33, 17), (31, 37)]),
    st.tuples(st.integers(1, 40), st.integers(1, 40)),
)


def as_float64(field: DepthField) -> DepthField:
    names = ("planes", "reach", "footprint", "largest_step", "normal", "bounds")
    return replace(field, **{name: getattr(field, name).astype(np.float64) for name in names})


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=0)


@st.composite
def frames(draw) -> tuple[GBuffer, Camera, float, np.random.Generator]:
    """Frames of random depths and normals under both cameras, with and without sky and thickness."""
    width, height = draw(SIZES)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(["noise", "steps", "smooth", "wide range"]))
    if kind == "noise":
        depth = rng.uniform(1.0, 10.0, (height, width))
    elif kind == "steps":
        depth = rng.choice([2.0, 3.0, 8.0], (height, width))
    elif kind == "smooth":
        depth = np.maximum(5.0 + np.cumsum(rng.normal(0.0, 0.05, (height, width)), axis=1), 0.5)
    else:
        depth = 10.0 ** rng.uniform(-3.0, 6.0, (height, width))
    depth = np.where(rng.random((height, width)) < draw(st.sampled_from([0.0, 0.3, 0.95])), np.inf, depth)
    normal = rng.normal(size=(height, width, 3))
    normal[..., 2] = np.abs(normal[..., 2])
    thickness = draw(st.sampled_from(["relative", "zero", "map", "solid"]))
    slabs = {
        "relative": None,
        "zero": np.zeros_like(depth),
        "map": rng.uniform(0.0, 3.0, depth.shape),
        "solid": np.full_like(depth, np.inf),
    }
    black = np.zeros((height, width, 3))
    gbuffer = GBuffer(depth, normal, black, black, black[..., 0], black, thickness=slabs[thickness])
    lens = {
        "shift_px": draw(st.sampled_from([(0.0, 0.0), (3.3, -1.7)])),
        "pixel_aspect": draw(st.sampled_from([1.0, 0.6])),
    }
    if draw(st.booleans()):
        camera = Camera.orthographic(width, height, 8.0, **lens)
    else:
        camera = Camera.perspective(width, height, 1.2, **lens)
    return gbuffer, camera, draw(st.sampled_from([0.0, 0.1, 1.0])), rng


def some_rays(frame, count: int, axis: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return origins on the frame's surfaces (3, N), and random directions or such along one axis."""
    gbuffer, camera, _, rng = frame
    x, y = rng.integers(0, camera.width, count), rng.integers(0, camera.height, count)
    depth = gbuffer.depth[y, x].astype(np.float64)
    origin = camera.pixel_to_view(x + 0.5, y + 0.5, np.where(np.isinf(depth), 5.0, depth)).T
    direction = rng.normal(size=(3, count))
    if axis is not None:
        direction[[other for other in range(3) if other != axis]] = 0.0
    return np.ascontiguousarray(origin), unit(direction)


def assert_walks_agree(frame, origin, direction, max_distance=np.inf, starts_on_surface=True) -> None:
    """The hierarchical, the linear and the scalar walk find the same in float64.

    Where rounding decides (a ray within a surface, along a row of equal depths), they find what the scalar
    walk finds for a ray that is beside this one by roundings.
    """
    gbuffer, camera, thickness, _ = frame
    options = {"max_distance": max_distance, "starts_on_surface": starts_on_surface, "notes_hidden": True}
    field = as_float64(DepthField.build(gbuffer, camera, thickness))
    flat = as_float64(DepthField.build(gbuffer, camera, thickness, max_level=0))
    for found in (tracer.trace_rays(field, origin, direction, **options),
                  tracer.trace_rays(flat, origin, direction, **options)):  # fmt: skip
        for ray, (start, toward) in enumerate(zip(origin.T, direction.T)):
            one = [values[ray] for values in (found.status, found.pixel, found.distance, found.hidden)]
            rays = rays_beside(start, toward)
            answers = (trace_ray(field, *beside, max_distance, starts_on_surface) for beside in rays)
            assert any(is_same_answer(one, answer) for answer in answers), (start, toward, one)


def rays_beside(origin, direction):
    """Yield a ray, and those that some roundings make of it."""
    yield origin, direction
    for change in (*np.eye(3), *-np.eye(3)):
        yield origin + FLOAT64_ROUNDINGS * np.abs(origin).max() * change, direction
        yield origin, direction + FLOAT64_ROUNDINGS * change


def is_same_answer(found, answer) -> bool:
    """Whether status, pixel, distance and hidden distance are the same, but for rounding."""
    return list(found[:2]) == list(answer[:2]) and bool(
        np.allclose(found[2:], answer[2:], rtol=FLOAT64_DISTANCE, atol=0.0)
    )


@given(frames(), st.sampled_from([np.inf, 3.0]))
@examples(max_examples=60)
def test_hierarchical_linear_and_scalar_walks_agree(frame, max_distance):
    assert_walks_agree(frame, *some_rays(frame, 60), max_distance)


@given(frames(), st.sampled_from([0, 1, 2]))
@examples(max_examples=30)
def test_walks_agree_along_rows_columns_and_the_view_axis(frame, axis):
    assert_walks_agree(frame, *some_rays(frame, 30, axis))


@given(
    st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([(8, 8), (16, 5), (3, 5), (7, 13), (32, 32)])
)
@examples(max_examples=40)
def test_walks_agree_on_exact_diagonals_through_cell_corners(seed, is_orthographic, size):
    """All numbers are dyadic, so corners are met exactly and rounding decides nothing."""
    width, height = size
    rng = np.random.default_rng(seed)
    camera = Camera(width, height, 8.0, 8.0, width // 2, height // 2, is_orthographic, np.eye(4))
    depth = rng.choice([1.0, 2.0, 4.0, 8.0, np.inf], (height, width))
    normal = rng.normal(size=(height, width, 3))
    normal[..., 2] = np.abs(normal[..., 2])
    black = np.zeros((height, width, 3))
    gbuffer = GBuffer(depth, normal, black, black, black[..., 0], black)
    x, y = rng.integers(0, width, 40), rng.integers(0, height, 40)
    start_depth = np.where(np.isinf(depth[y, x]), 4.0, depth[y, x])
    origin = camera.pixel_to_view(x + 0.5, y + 0.5, start_depth).T
    dz = rng.choice([-0.5, -0.25, 0.0, 0.25], 40)
    step = rng.choice([-0.25, 0.25], (2, 40))
    # Speeds over the frame are (+-2, +-2) px: undo what the motion along the view axis adds
    slope = np.zeros(40) if is_orthographic else -dz / start_depth
    direction = np.stack([step[0] + origin[0] * slope, step[1] + origin[1] * slope, dz])
    assert_walks_agree((gbuffer, camera, 0.25, rng), np.ascontiguousarray(origin), direction)


@given(frames())
@examples(max_examples=40)
def test_walks_agree_on_rays_that_come_in_from_outside(frame):
    _, camera, _, rng = frame
    far = rng.uniform(0.5, 20.0, 40)
    x = rng.uniform(-1.0, 2.0, 40) * camera.width
    y = rng.uniform(-1.0, 2.0, 40) * camera.height
    origin = np.ascontiguousarray(camera.pixel_to_view(x, y, far).T)
    target = camera.pixel_to_view(
        rng.uniform(0, camera.width, 40), rng.uniform(0, camera.height, 40), rng.uniform(0.5, 20.0, 40)
    ).T
    assert_walks_agree(frame, origin, unit(target - origin), starts_on_surface=False)


@pytest.mark.parametrize("is_orthographic", [False, True])
def test_float32_finds_what_float64_finds(rng, is_orthographic):
    differing = total = 0
    for _ in range(8):
        shape = tuple(int(n) for n in rng.integers(20, 120, 2))
        depth = np.maximum(5.0 + np.cumsum(rng.normal(0.0, 0.05, shape), axis=1), 0.5)
        normal = rng.normal(size=(*shape, 3))
        normal[..., 2] = np.abs(normal[..., 2])
        black = np.zeros((*shape, 3))
        gbuffer = GBuffer(depth, normal, black, black, black[..., 0], black)
        make = Camera.orthographic if is_orthographic else Camera.perspective
        camera = make(shape[1], shape[0], 1.2)
        field = DepthField.build(gbuffer, camera, 0.1)
        origin, direction = some_rays((gbuffer, camera, 0.1, rng), 4000)
        exact = tracer.trace_rays(as_float64(field), origin, direction)
        found = tracer.trace_rays(field, origin.astype(np.float32), direction.astype(np.float32))
        assert found.distance.dtype == np.float32
        same = (found.status == exact.status) & (found.pixel == exact.pixel)
        differing, total = differing + int((~same).sum()), total + same.size
        hit = same & (found.status == tracer.HIT)
        np.testing.assert_allclose(found.distance[hit], exact.distance[hit], rtol=FLOAT32_DISTANCE)
    assert differing <= FLOAT32_RAYS_THAT_DIFFER * total


def test_walks_do_not_depend_on_how_many_rays_walk_at_once(rng, monkeypatch):
    gbuffer, camera = (
        uniform_gbuffer((17, 23), rng.uniform(1.0, 5.0, (17, 23))),
        Camera.perspective(23, 17, 1.0),
    )
    field = DepthField.build(gbuffer, camera, 0.1)
    origin, direction = (array.astype(np.float32) for array in some_rays((gbuffer, camera, 0.1, rng), 500))
    together = tracer.trace_rays(field, origin, direction)
    monkeypatch.setattr(walk, "CAPACITY", 7)
    in_turn = tracer.trace_rays(field, origin, direction)
    for name in ("status", "pixel", "distance"):
        np.testing.assert_array_equal(getattr(together, name), getattr(in_turn, name))


def test_no_rays_have_no_answers():
    field = DepthField.build(uniform_gbuffer((3, 4)), Camera.perspective(4, 3, 1.0), 0.1)
    found = tracer.trace_rays(field, np.zeros((3, 0), np.float32), np.zeros((3, 0), np.float32))
    assert found.status.shape == found.pixel.shape == found.distance.shape == (0,)


# Closed forms. Frames of planes and spheres, rays in float32 as the passes trace them.


def trace(gbuffer, camera, origin, direction, thickness=0.1, max_level=7, **options):
    field = DepthField.build(gbuffer, camera, thickness, max_level=max_level)
    origin = np.asarray(origin, dtype=np.float32).reshape(3, -1)
    direction = np.asarray(direction, dtype=np.float32).reshape(3, -1)
    return tracer.trace_rays(field, origin, direction, **options)


def lenses(width: int, height: int) -> list[Camera]:
    return [Camera.perspective(width, height, 1.0), Camera.orthographic(width, height, 6.0)]


def centres(gbuffer: GBuffer, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and normals (3, N) of all surface pixels."""
    y, x = np.nonzero(~gbuffer.is_background)
    position = camera.pixel_to_view(x + 0.5, y + 0.5, gbuffer.depth[y, x])
    return position.T.astype(np.float32), gbuffer.normal[y, x].T


@pytest.mark.parametrize("camera", lenses(48, 36), ids=["perspective", "orthographic"])
def test_rays_meet_a_tilted_wall_where_geometry_says(camera, rng):
    point, normal = np.array([0.0, 0.0, -8.0]), np.array([0.4, -0.3, 1.0])
    gbuffer = capture(camera, [Plane(point, normal)])
    x, y, depth = rng.uniform(2, 46, 400), rng.uniform(2, 34, 400), rng.uniform(1.0, 4.0, 400)
    origin = camera.pixel_to_view(x, y, depth).T
    direction = unit(rng.normal(size=(3, 400)) + np.array([[0.0], [0.0], [-1.5]]))
    distance = (point @ normal - normal @ origin) / (normal @ direction)
    meets = origin + distance * direction
    x_px, y_px, _ = camera.view_to_pixel(meets.T)
    inside = (distance > 0) & (x_px > 0) & (x_px < 48) & (y_px > 0) & (y_px < 36)
    # The origin's own cell is not tested
    away = np.maximum(abs(np.floor(x_px) - np.floor(x)), abs(np.floor(y_px) - np.floor(y))) >= 1
    found = trace(gbuffer, camera, origin, direction)
    expected = inside & away
    assert expected.sum() > 100
    assert (found.status[expected] == tracer.HIT).all()
    assert not (found.status[~inside] == tracer.HIT).any()
    np.testing.assert_allclose(found.distance[expected], distance[expected], rtol=FLOAT32_DISTANCE)


@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("tilt", [0.0, 30.0, 60.0, 80.0, 89.0])
def test_flat_plane_has_no_hits_on_itself(tilt, is_orthographic, rng):
    make = Camera.orthographic if is_orthographic else Camera.perspective
    camera = make(64, 48, 0.7)
    for azimuth in np.radians([0.0, 33.0, 90.0, 180.0, 215.0]):
        lean = np.sin(np.radians(tilt))
        normal = [lean * np.cos(azimuth), lean * np.sin(azimuth), np.cos(np.radians(tilt))]
        gbuffer = capture(camera, [Plane((0.0, 0.0, -10.0), normal)])
        position, facing = centres(gbuffer, camera)
        direction = unit(rng.normal(size=position.shape)).astype(np.float32)
        direction *= np.where((direction * facing).sum(axis=0) < 0.0, -1.0, 1.0).astype(np.float32)
        found = trace(gbuffer, camera, position, direction)
        assert not np.isin(found.status, (tracer.HIT, tracer.BLOCKED)).any(), (tilt, azimuth)


def test_convex_ball_has_no_hits_on_itself(rng):
    for camera in lenses(64, 64):
        gbuffer = capture(camera, [Sphere((0.3, -0.2, -6.0), 2.0)])
        position, normal = centres(gbuffer, camera)
        direction = unit(rng.normal(size=position.shape)).astype(np.float32)
        direction *= np.where((direction * normal).sum(axis=0) < 0.0, -1.0, 1.0).astype(np.float32)
        found = trace(gbuffer, camera, position, direction)
        assert np.isin(found.status, (tracer.HIT, tracer.BLOCKED)).mean() <= CONVEX_SELF_HITS


def test_ray_into_open_background_escapes():
    camera = Camera.perspective(9, 9, 1.0)
    gbuffer = uniform_gbuffer((9, 9), np.where(np.arange(9) < 4, 5.0, np.inf))
    # Both go away from the camera: one vanishes over background, the other over the surface
    origin = camera.pixel_to_view(np.array([2.5, 3.5]), np.array([4.5, 4.5]), np.array([5.0, 5.0])).T
    direction = np.array([[0.3, -0.3], [0.0, 0.0], [-1.0, -1.0]])
    found = trace(gbuffer, camera, origin, direction, thickness=0.0)
    assert found.status.tolist() == [tracer.ESCAPED, tracer.UNKNOWN]
    assert np.isinf(found.distance).all()


def test_ray_over_the_border_is_unknown_from_where_it_left():
    camera = Camera.perspective(8, 8, np.pi / 2)  # the border is at 45 degrees
    gbuffer = uniform_gbuffer((8, 8), 4.0)
    origin = camera.pixel_to_view(np.array([6.5]), np.array([4.5]), np.array([4.0])).T
    found = trace(gbuffer, camera, origin, [1.0, 0.0, 0.0])
    assert found.status.tolist() == [tracer.UNKNOWN]
    assert found.pixel.tolist() == [-1]
    np.testing.assert_allclose(found.distance, 4.0 - origin[0], rtol=FLOAT32_DISTANCE)


def test_rays_straight_at_the_camera_and_straight_away_end():
    for camera in lenses(9, 9):
        gbuffer = uniform_gbuffer((9, 9), np.where(np.arange(9) == 4, np.inf, 5.0))
        origin = camera.pixel_to_view(np.array([4.5, 4.5]), np.array([4.5, 4.5]), np.array([5.0, 5.0])).T
        found = trace(gbuffer, camera, origin, np.array([[0.0, 0.0], [0.0, 0.0], [1.0, -1.0]]))
        assert found.status.tolist() == [tracer.UNKNOWN, tracer.ESCAPED]


def test_rays_that_cross_the_camera_plane_meet_nothing_behind_the_camera():
    camera = Camera.perspective(16, 16, 1.2)
    gbuffer = uniform_gbuffer((16, 16), 3.0)
    origin, _ = centres(gbuffer, camera)
    rng = np.random.default_rng(4)
    direction = rng.normal(size=origin.shape)
    direction[2] = np.abs(direction[2]) + 0.1  # toward the camera plane, away from the wall
    found = trace(gbuffer, camera, origin, unit(direction))
    assert (found.status == tracer.UNKNOWN).all()
    assert (found.distance <= 3.0 / unit(direction)[2] * (1.0 + FLOAT32_DISTANCE)).all()


def slit(foreground: float) -> tuple[GBuffer, Camera]:
    """A wall at depth 10 behind a strip at `foreground`, all facing the camera."""
    depth = np.full((3, 33), 10.0)
    depth[:, 14:19] = foreground
    return uniform_gbuffer((3, 33), depth), Camera.perspective(33, 3, 1.0)


def behind_the_strip(camera: Camera) -> tuple[np.ndarray, np.ndarray, float]:
    """A ray from (left, depth 8) to the wall at (right, depth 10), behind the strip."""
    origin = camera.pixel_to_view(np.array([6.5]), np.array([1.5]), np.array([8.0])).T
    target = camera.pixel_to_view(np.array([28.5]), np.array([1.5]), np.array([10.0])).T
    return origin, unit(target - origin), float(np.linalg.norm(target - origin))


@pytest.mark.parametrize("max_level", [0, 7])
def test_ray_passes_behind_a_thin_foreground_object_and_hits_beyond(max_level):
    gbuffer, camera = slit(3.0)
    origin, direction, distance = behind_the_strip(camera)
    found = trace(gbuffer, camera, origin, direction, thickness=0.1, max_level=max_level)
    assert (found.status[0], found.pixel[0]) == (tracer.HIT, 33 + 28)
    np.testing.assert_allclose(found.distance, distance, rtol=0.02)


@pytest.mark.parametrize("max_level", [0, 7])
def test_ray_inside_a_thick_object_is_blocked_not_lit(max_level):
    gbuffer, camera = slit(3.0)
    origin, direction, _ = behind_the_strip(camera)
    found = trace(gbuffer, camera, origin, direction, thickness=10.0, max_level=max_level)
    assert (found.status[0], found.pixel[0]) == (tracer.BLOCKED, 33 + 14)


def test_captured_thickness_decides_what_is_behind():
    camera = slit(3.0)[1]
    origin, direction, _ = behind_the_strip(camera)
    for thickness, status in ((1.0, tracer.HIT), (9.0, tracer.BLOCKED), (np.inf, tracer.BLOCKED)):
        gbuffer = replace(slit(3.0)[0], thickness=np.full((3, 33), thickness))
        assert trace(gbuffer, camera, origin, direction).status[0] == status


def test_ray_that_enters_a_slab_through_its_back_is_blocked():
    camera = Camera.perspective(33, 3, 1.0)
    depth = np.full((3, 33), 12.0)
    depth[:, 12:30] = 4.0
    gbuffer = replace(uniform_gbuffer((3, 33), depth), thickness=np.full((3, 33), 1.0))
    origin = camera.pixel_to_view(np.array([4.5]), np.array([1.5]), np.array([8.0])).T
    target = camera.pixel_to_view(np.array([24.0]), np.array([1.5]), np.array([4.5])).T
    found = trace(gbuffer, camera, origin, unit(target - origin))
    assert found.status[0] == tracer.BLOCKED
    assert 12 < found.pixel[0] - 33 < 24


@pytest.mark.parametrize(
    ("before", "depth", "starts_on_surface", "column", "status"),
    [
        (4.2, 4.12, True, 12.5, tracer.HIT),  # the step between two pixels of one surface
        (9.0, 4.12, True, 12.5, tracer.BLOCKED),  # the side of a thing before a far wall
        (np.inf, 4.12, True, 12.5, tracer.BLOCKED),  # or before the sky
        (9.0, 4.08, True, 12.5, tracer.HIT),  # no deeper than a pixel is wide
        (9.0, 4.12, False, 16.5, tracer.HIT),  # begins inside, came over no edge
        (9.0, 4.12, False, -3.0, tracer.BLOCKED),  # comes in from outside the frame
    ],
)
@pytest.mark.parametrize("is_mirrored", [False, True])
def test_ray_meets_a_step_but_not_the_side_of_an_edge(
    before, depth, starts_on_surface, column, status, is_mirrored
):
    camera = Camera.orthographic(33, 3, 3.3)  # a pixel is 0.1 wide, and a step may be 0.33
    depths = np.full((3, 33), 3.7)
    depths[:, :16], depths[:, 16] = before, 4.0  # a ray may enter the middle column 0.15 deep
    gbuffer = uniform_gbuffer((3, 33), depths, thickness=np.full((3, 33), 1.0))
    origin = camera.pixel_to_view(np.array([column]), np.array([1.5]), np.array([depth - 1e-5])).T
    direction = np.array([[1.0], [0.0], [-1e-5]])
    if is_mirrored:
        gbuffer = uniform_gbuffer((3, 33), depths[:, ::-1], thickness=np.full((3, 33), 1.0))
        origin[0], direction[0] = -origin[0], -1.0
    field = DepthField.build(gbuffer, camera, 0.1)
    found = tracer.trace_rays(field, origin, direction, starts_on_surface=starts_on_surface)
    assert (found.status.tolist(), found.pixel.tolist()) == ([status], [49])


def test_surface_that_faces_away_blocks():
    camera = Camera.perspective(33, 3, 1.0)
    gbuffer = uniform_gbuffer((3, 33), np.where(np.arange(33) < 16, 9.0, 4.0))
    normal = gbuffer.normal.copy()
    normal[:, 16:] = [0.8, 0.0, 0.6]  # the back of something, for a ray toward +x
    gbuffer = replace(gbuffer, normal=normal)
    origin = camera.pixel_to_view(np.array([4.5]), np.array([1.5]), np.array([3.0])).T
    target = camera.pixel_to_view(np.array([24.5]), np.array([1.5]), np.array([4.2])).T
    assert trace(gbuffer, camera, origin, unit(target - origin)).status[0] == tracer.BLOCKED


def test_contact_is_met_from_the_next_pixel():
    """A floor that meets a wall: rays from the floor's last row find the wall's first, nothing is skipped."""
    camera = Camera.perspective(24, 32, 1.0)
    surfaces = [Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0))]
    gbuffer = capture(camera, surfaces)
    is_floor = gbuffer.normal[..., 1] > 0.9
    last = int(np.flatnonzero(is_floor[:, 12])[0])
    origin = camera.pixel_to_view(12.5, last + 0.5, gbuffer.depth[last, 12])
    target = np.array([origin[0], -1.0 + 0.1, -6.0])
    found = trace(gbuffer, camera, origin, unit(target - origin))
    _, y, _ = camera.view_to_pixel(target)
    assert (found.status[0], found.pixel[0] // 24) == (tracer.HIT, int(y))
    np.testing.assert_allclose(found.distance[0], np.linalg.norm(target - origin), rtol=0.01)


@given(frames(), st.floats(0.1, 20.0))
@examples(max_examples=25)
def test_reaching_farther_never_changes_a_hit_that_was_found(frame, reach):
    gbuffer, camera, thickness, _ = frame
    field = DepthField.build(gbuffer, camera, thickness)
    origin, direction = (array.astype(np.float32) for array in some_rays(frame, 40))
    near = tracer.trace_rays(field, origin, direction, max_distance=reach)
    far = tracer.trace_rays(field, origin, direction)
    hit = near.status == tracer.HIT
    np.testing.assert_array_equal(near.status[hit], far.status[hit])
    np.testing.assert_array_equal(near.pixel[hit], far.pixel[hit])
    assert (near.distance[hit] <= reach * (1.0 + FLOAT32_DISTANCE)).all()
    # And what is met within the reach is not lost
    within = (far.status == tracer.HIT) & (far.distance < reach * (1.0 - FLOAT32_DISTANCE))
    np.testing.assert_array_equal(near.status[within], far.status[within])


def test_rays_of_no_reach_meet_nothing(rng):
    gbuffer, camera = uniform_gbuffer((9, 9), rng.uniform(1.0, 5.0, (9, 9))), Camera.perspective(9, 9, 1.0)
    origin, direction = some_rays((gbuffer, camera, 0.1, rng), 100)
    assert (trace(gbuffer, camera, origin, direction, max_distance=0.0).status == tracer.UNKNOWN).all()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("is_orthographic", [False, True])
def test_flipping_the_frame_flips_the_answers(axis, is_orthographic, rng):
    """No floor or round favours a side. Sizes that are no powers of two get padding on one side only."""
    shape = (22, 27)
    depth = rng.uniform(2.0, 6.0, shape)
    gbuffer = uniform_gbuffer(shape, np.where(rng.random(shape) < 0.2, np.inf, depth))
    camera = (Camera.orthographic if is_orthographic else Camera.perspective)(shape[1], shape[0], 1.2)
    origin, direction = some_rays((gbuffer, camera, 0.1, rng), 2000)
    flipped = uniform_gbuffer(shape, np.flip(gbuffer.depth, axis=1 - axis))
    mirror = np.ones((3, 1))
    mirror[axis] = -1.0
    field = as_float64(DepthField.build(gbuffer, camera, 0.1))
    found = tracer.trace_rays(field, origin, direction)
    field = as_float64(DepthField.build(flipped, camera, 0.1))
    other = tracer.trace_rays(field, origin * mirror, direction * mirror)
    pixels = np.flip(np.arange(depth.size).reshape(shape), axis=1 - axis).ravel()
    np.testing.assert_array_equal(found.status, other.status)
    np.testing.assert_array_equal(np.where(found.pixel < 0, -1, pixels[found.pixel]), other.pixel)
    np.testing.assert_allclose(found.distance, other.distance, rtol=FLOAT64_DISTANCE)
