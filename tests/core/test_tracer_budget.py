# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks that end early, share their rays or run along borders find what they find however they run."""

from __future__ import annotations

import threading
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera, ray_queue, tracer, walk
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.field_stack import FieldStack
from ssgi_addon.core.types import FloatArray
from tests.budget import examples
from tests.core.synthetic import uniform_gbuffer
from tests.core.test_tracer import as_float64, assert_walks_agree, frames, some_rays, unit
from tests.reference.scalar_tracer import trace_ray
from tests.tolerances import FLOAT32_POSITION_PX, MET_POSITION_PX

# How a field is built for each method
METHODS = {
    "linear": {"max_level": 0},
    "min_z": {"bounds": "nearest"},
    "hierarchical": {},
}


def float32_rays(frame, count: int) -> list[FloatArray]:
    return [array.astype(np.float32) for array in some_rays(frame, count)]


def only(found: tracer.TraceResult, chosen) -> tracer.TraceResult:
    """Return the answers to some of the rays."""
    return tracer.TraceResult(*(getattr(found, item.name)[chosen] for item in fields(found)))


def assert_same(one: tracer.TraceResult, other: tracer.TraceResult) -> None:
    """Bit by bit."""
    for item in fields(one):
        np.testing.assert_array_equal(getattr(one, item.name), getattr(other, item.name), item.name)


def rough_field(rng, count: int = 1500, **how: object) -> tuple[DepthField, FloatArray, FloatArray]:
    """Return a field of noise with holes, and rays in all directions from its pixels."""
    shape = (37, 45)
    gbuffer = uniform_gbuffer(shape, np.where(rng.random(shape) < 0.2, np.inf, rng.uniform(1.0, 5.0, shape)))
    camera = Camera.perspective(45, 37, 1.0)
    return DepthField.build(gbuffer, camera, 0.1, **how), *float32_rays((gbuffer, camera, 0.1, rng), count)


# The budget of steps


@given(frames(), st.sampled_from(list(METHODS)), st.lists(st.integers(1, 60), min_size=2, max_size=3))
@examples(max_examples=30)
def test_ray_out_of_budget_is_unknown_and_a_larger_budget_changes_no_answer(frame, method, budgets):
    gbuffer, camera, thickness, _ = frame
    field = DepthField.build(gbuffer, camera, thickness, **METHODS[method])
    rays = float32_rays(frame, 60)
    whole = tracer.trace_rays(field, *rays)
    were_out = np.ones(60, dtype=bool)
    for budget in sorted(budgets):
        part = tracer.trace_rays(field, *rays, max_steps=budget)
        is_out = (part.status != whole.status) | (part.distance != whole.distance)
        assert (part.status[is_out] == tracer.UNKNOWN).all()
        assert (part.pixel[is_out] == -1).all()
        assert np.isfinite(part.distance[is_out]).all()
        assert (part.distance[is_out] <= whole.distance[is_out]).all()
        assert not (is_out & ~were_out).any()
        assert_same(only(part, ~is_out), only(whole, ~is_out))
        were_out = is_out


@given(frames(), st.sampled_from(list(METHODS)))
@examples(max_examples=20)
def test_budget_that_suffices_gives_the_whole_answer(frame, method):
    """A walk looks at each level at most twice on its way through a pixel."""
    gbuffer, camera, thickness, _ = frame
    field = DepthField.build(gbuffer, camera, thickness, **METHODS[method])
    rays = float32_rays(frame, 60)
    enough = (camera.width + camera.height) * 2 * field.levels
    assert_same(tracer.trace_rays(field, *rays, max_steps=enough), tracer.trace_rays(field, *rays))


@pytest.mark.parametrize("march", [None, tracer.MarchOptions(1.0, 5)], ids=["walk", "march"])
def test_each_pixel_after_the_first_is_one_step_of_a_linear_walk(march):
    """Along a row to a wall: the eighth pixel has it."""
    depth = np.where(np.arange(20) < 10, np.inf, 1.0)
    camera = Camera.perspective(20, 3, 1.0)
    gbuffer = uniform_gbuffer((3, 20), depth, normal=np.broadcast_to((-0.6, 0.0, 0.8), (3, 20, 3)))
    field = DepthField.build(gbuffer, camera, 10.0, max_level=0)
    origin = camera.pixel_to_view(np.array([2.5]), np.array([1.5]), np.array([1.01])).T
    rays = [origin.astype(np.float32), np.array([[1.0], [0.0], [0.0]], dtype=np.float32)]
    met = [tracer.trace_rays(field, *rays, max_steps=n, march=march) for n in range(1, 10)]
    assert [found.status[0] != tracer.UNKNOWN for found in met] == [False] * 7 + [True] * 2
    # Where it stands after n steps: at the border of a pixel, a march at the centre
    reached = (2.5 + camera.fx / 1.01 * np.array([found.distance[0] for found in met[:7]])).tolist()
    at = np.arange(4.0, 11.0) if march is None else np.arange(3.5, 10.0)
    np.testing.assert_allclose(reached, at, rtol=0.0, atol=FLOAT32_POSITION_PX)


# Rays that share a walk, and walks that share the rays


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("stragglers", "max_steps"), [(0, None), (5, 7), (10**6, None), (10**6, 7)])
def test_walks_find_the_same_however_they_share_the_rays(rng, monkeypatch, method, max_steps, stragglers):
    """Whatever the threads, the room in a walk, and when a walk leaves its last rays to another."""
    field, origin, direction = rough_field(rng, 120, **METHODS[method])
    alone = tracer.trace_rays(field, origin, direction, max_steps=max_steps)
    assert np.unique(alone.status).size > 2
    left = []

    class Queue(ray_queue.RayQueue):
        def leave(self, group):
            left.append(group.size)
            return super().leave(group)

    monkeypatch.setattr(tracer, "RayQueue", Queue)
    monkeypatch.setattr(tracer, "LEAST_RAYS", 1)
    monkeypatch.setattr(walk, "_STRAGGLERS", stragglers)
    for capacity, threads in ((7, 1), (7, 8), (50, 2), (131072, 2)):
        monkeypatch.setattr(walk, "CAPACITY", capacity)
        shared = tracer.trace_rays(field, origin, direction, max_steps=max_steps, threads=threads)
        assert_same(shared, alone)
    assert (sum(left) > 0) == (stragglers > 0)


@pytest.mark.parametrize("max_steps", [None, 7])
def test_ray_does_not_see_the_other_rays(rng, max_steps):
    field, origin, direction = rough_field(rng)
    together = tracer.trace_rays(field, origin, direction, max_steps=max_steps)
    chosen = rng.permutation(origin.shape[1])[:100]
    some = tracer.trace_rays(field, origin[:, chosen], direction[:, chosen], max_steps=max_steps)
    assert_same(some, only(together, chosen))
    one = tracer.trace_rays(field, origin[:, :1].copy(), direction[:, :1].copy(), max_steps=max_steps)
    assert_same(one, only(together, slice(0, 1)))


@pytest.mark.parametrize("max_steps", [None, 7])
def test_visitors_share_walks_too(rng, monkeypatch, max_steps):
    """Rays of two fields in one queue, by one thread and by many."""
    field, origin, direction = rough_field(rng)
    other = rough_field(rng)[0]
    rays = tracer.ScreenRays.joined(
        [
            tracer.project_rays(each, origin, direction, index=index)
            for index, each in enumerate((field, other))
        ]
    )
    stack, direction = FieldStack([field, other]), np.tile(direction, 2)
    alone = tracer.trace_visitors(stack, rays, direction, max_steps=max_steps)
    monkeypatch.setattr(tracer, "LEAST_RAYS", 1)
    monkeypatch.setattr(walk, "CAPACITY", 61)
    for threads in (2, 8):
        assert_same(
            tracer.trace_visitors(stack, rays, direction, max_steps=max_steps, threads=threads), alone
        )


class CancelledError(Exception):
    pass


@pytest.mark.parametrize("threads", [2, 8])
def test_raising_from_advance_leaves_the_waiting_rays_and_joins_all_threads(rng, monkeypatch, threads):
    field, origin, direction = rough_field(rng)
    taken, was_asked = [], threading.Event()

    def project_few(*arguments):
        """Let no walk go on before `advance` was called."""
        if len(taken) >= 20:
            assert was_asked.wait(timeout=60.0)
        taken.append(arguments[1].shape[1])
        return project_rays(*arguments)

    def advance(fraction: float) -> None:
        assert 0.0 <= fraction < 1.0
        was_asked.set()
        raise CancelledError

    project_rays = tracer.project_rays
    monkeypatch.setattr(tracer, "project_rays", project_few)
    monkeypatch.setattr(tracer, "LEAST_RAYS", 1)
    monkeypatch.setattr(walk, "CAPACITY", 8)
    with pytest.raises(CancelledError):
        tracer.trace_rays(field, origin, direction, threads=threads, advance=advance)
    assert sum(taken) < 0.5 * origin.shape[1]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ssgi")]


@pytest.mark.parametrize("threads", [1, 3])
def test_progress_rises_to_the_end(rng, monkeypatch, threads):
    field, origin, direction = rough_field(rng)
    monkeypatch.setattr(tracer, "LEAST_RAYS", 1)
    told: list[float] = []
    tracer.trace_rays(field, origin, direction, threads=threads, advance=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


# Methods, positions, addresses


@given(frames(), st.sampled_from([None, 0, 1, 2]), st.sampled_from([np.inf, 3.0]))
@examples(max_examples=30)
def test_pyramid_of_nearest_depths_alone_finds_the_same(frame, axis, reach):
    gbuffer, camera, thickness, _ = frame
    origin, direction = some_rays(frame, 30, axis)
    nearest = as_float64(DepthField.build(gbuffer, camera, thickness, bounds="nearest"))
    both = as_float64(DepthField.build(gbuffer, camera, thickness))
    found = tracer.trace_rays(nearest, origin, direction, max_distance=reach)
    assert_same(found, tracer.trace_rays(both, origin, direction, max_distance=reach))
    expected = [trace_ray(nearest, o, d, reach) for o, d in zip(origin.T, direction.T)]
    assert [(status, pixel) for status, pixel, _, _ in expected] == list(zip(found.status, found.pixel))


@given(frames(), st.sampled_from([np.inf, 3.0]))
@examples(max_examples=30)
def test_rays_meet_pixels_within_their_borders_and_at_their_distance(frame, reach):
    gbuffer, camera, thickness, _ = frame
    field = as_float64(DepthField.build(gbuffer, camera, thickness))
    origin, direction = some_rays(frame, 60)
    found = tracer.trace_rays(field, origin, direction, max_distance=reach)
    is_met = found.pixel >= 0
    np.testing.assert_array_equal(is_met, np.isin(found.status, (tracer.BLOCKED, tracer.HIT)))
    assert not found.x_px[~is_met].any()
    assert not found.y_px[~is_met].any()
    met = only(found, is_met)
    row, column = np.divmod(met.pixel, camera.width)
    assert (np.abs(met.x_px - column - 0.5) <= 0.5 + MET_POSITION_PX).all()
    assert (np.abs(met.y_px - row - 0.5) <= 0.5 + MET_POSITION_PX).all()
    point = origin[:, is_met] + met.distance * direction[:, is_met]
    x, y, _ = camera.view_to_pixel(point.T)
    np.testing.assert_allclose(met.x_px, x, rtol=0.0, atol=MET_POSITION_PX)
    np.testing.assert_allclose(met.y_px, y, rtol=0.0, atol=MET_POSITION_PX)


@pytest.mark.parametrize("method", METHODS)
def test_rays_and_field_may_differ_in_precision(rng, method):
    field, origin, direction = rough_field(rng, **METHODS[method])
    origin, direction = origin.astype(np.float64), direction.astype(np.float64)
    found = tracer.trace_rays(field, origin, direction)
    assert (found.status == tracer.HIT).any()
    assert_same(found, tracer.trace_rays(as_float64(field), origin, direction))


@pytest.mark.parametrize("levels", [1, 2])
def test_cells_beyond_what_float32_counts_are_found(levels):
    """One plate in an empty frame of 18 million pixels: most of the arrays is never touched."""
    width, height, column, row = 4244, 4242, 4201, 4205
    stride = width if levels == 1 else width + width // 2
    pixels, pixel = width * height, row * width + column
    small = DepthField.build(uniform_gbuffer((2, 2), 2.0), Camera.perspective(2, 2, 1.0), 0.1)
    field = replace(
        small,
        camera=Camera.perspective(width, height, 1.0),
        is_background=np.zeros(pixels, dtype=bool),
        planes=np.zeros((pixels, 4), dtype=np.float32),
        reach=np.zeros(pixels, dtype=np.float32),
        footprint=np.zeros(pixels, dtype=np.float32),
        largest_step=np.zeros(pixels, dtype=np.float32),
        normal=np.zeros((pixels, 3), dtype=np.float32),
        bounds=np.zeros((height * stride, 2), dtype=np.float32),
        stride=stride,
        origins=np.array([0, width][:levels], dtype=np.int64),
        padded_width=width,
        padded_height=height,
    )
    field.planes[pixel] = (0.5, 0.0, 0.0, 0.01)
    field.normal[pixel] = (0.0, 0.0, 1.0)
    field.bounds[row * stride + column] = (0.5, 0.49)
    if levels == 2:
        field.bounds[row // 2 * stride + width + column // 2] = (0.5, 0.49)
    assert field.bounds.shape[0] > 2**24
    for x_px in (column - 30.5, column + 31.5):
        origin = field.camera.pixel_to_view(np.array([x_px]), np.array([row + 0.5]), np.array([1.9])).T
        target = field.camera.pixel_to_view(
            np.array([column + 0.5]), np.array([row + 0.5]), np.array([2.0])
        ).T
        rays = [array.astype(np.float32) for array in (origin, unit(target - origin))]
        found = tracer.trace_rays(field, *rays)
        assert (found.status.tolist(), found.pixel.tolist()) == ([tracer.HIT], [pixel])


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0, 1]))
@examples(max_examples=20)
def test_walks_agree_along_the_borders_between_pixels(seed, is_orthographic, axis):
    """A ray that runs along a border never crosses it: neither 0 * inf nor rounding may hold it up."""
    rng = np.random.default_rng(seed)
    gbuffer = uniform_gbuffer((16, 16), rng.choice([1.0, 2.0, 4.0, 8.0, np.inf], (16, 16)))
    camera = Camera(16, 16, 8.0, 8.0, 8, 8, is_orthographic, np.eye(4))
    across, along = rng.integers(0, 16, 40), rng.integers(0, 16, 40) + 0.5
    x, y = (along, across) if axis == 0 else (across, along)
    origin = np.ascontiguousarray(camera.pixel_to_view(x, y, np.full(40, 4.0)).T)
    direction = np.zeros((3, 40))
    direction[axis] = rng.choice([-0.5, 0.5], 40)
    if is_orthographic:
        direction[2] = rng.choice([-0.25, 0.0, 0.25], 40)
    assert_walks_agree((gbuffer, camera, 0.25, rng), origin, direction)
