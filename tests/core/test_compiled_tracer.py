# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmarks' compiled tracer is a fair yardstick: it finds what the oracle and the numpy walk find."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("numba", reason="the compiled tracer needs numba: pip install '.[bench]'")

from benchmarks import compiled_tracer
from benchmarks.inputs import analytic_room, glossy_rays
from benchmarks.tracer_speed import counted_steps
from ssgi_addon.core import Camera, tracer
from ssgi_addon.core.depth_field import DepthField
from tests.budget import examples
from tests.core.synthetic import uniform_gbuffer
from tests.core.test_tracer import as_float64, frames, some_rays, unit
from tests.reference.scalar_tracer import trace_ray
from tests.tolerances import COMPILED_RAYS_THAT_DIFFER, FLOAT64_DISTANCE


def assert_agrees(frame, origin, direction, max_distance=np.inf, starts_on_surface=True) -> None:
    """The compiled tracer finds in float64 what the scalar oracle finds."""
    gbuffer, camera, thickness, _ = frame
    field = as_float64(DepthField.build(gbuffer, camera, thickness))
    found, _ = compiled_tracer.trace_rays(
        field, origin, direction, max_distance=max_distance, starts_on_surface=starts_on_surface
    )
    status, pixel, distance, _ = zip(
        *(trace_ray(field, o, d, max_distance, starts_on_surface) for o, d in zip(origin.T, direction.T))
    )
    np.testing.assert_array_equal(found.status, status)
    np.testing.assert_array_equal(found.pixel, pixel)
    if not (camera.is_orthographic and np.isinf(distance).any()):
        np.testing.assert_allclose(found.distance, distance, rtol=FLOAT64_DISTANCE)


@given(frames(), st.sampled_from([np.inf, 3.0]), st.sampled_from([None, 0, 1, 2]))
@examples(max_examples=40)
def test_compiled_tracer_agrees_with_the_oracle_on_rays_from_surfaces(frame, max_distance, axis):
    assert_agrees(frame, *some_rays(frame, 30, axis), max_distance)


@given(frames())
@examples(max_examples=20)
def test_compiled_tracer_agrees_with_the_oracle_on_rays_that_come_in_from_outside(frame):
    target, _ = some_rays(frame, 20)
    origin = frame[3].uniform(-12.0, 12.0, target.shape)
    origin[2] = -np.abs(origin[2]) - 0.1  # in front of the camera
    assert_agrees(frame, origin, unit(target - origin), starts_on_surface=False)


@given(st.integers(0, 2**32 - 1))
@examples(max_examples=20)
def test_compiled_tracer_agrees_with_the_oracle_on_exact_diagonals_through_cell_corners(seed):
    """All numbers are dyadic, so corners are met exactly and rounding decides nothing."""
    rng = np.random.default_rng(seed)
    camera = Camera.orthographic(16, 16, 16.0)
    gbuffer = uniform_gbuffer((16, 16), rng.choice([1.0, 2.0, 4.0, np.inf], (16, 16)))
    origin = np.stack([*(rng.integers(-8, 8, (2, 20)) + 0.5), rng.choice([-1.0, -3.0], 20)])
    direction = np.stack([*rng.choice([-1.0, 1.0], (2, 20)), rng.choice([-0.25, 0.0, 0.25], 20)])
    assert_agrees((gbuffer, camera, 0.25, rng), origin, direction)


@pytest.fixture(scope="module", params=["both", "nearest", "linear"])
def interior(request):
    """Return the depth field of a furnished room by each kind of pyramid, and glossy rays in it."""
    frame = analytic_room(192, 108)
    options = {"max_level": 0} if request.param == "linear" else {"bounds": request.param}
    field = DepthField.build(frame.gbuffer, frame.camera, 0.1, **options)
    return field, glossy_rays(frame.gbuffer, frame.camera)


@pytest.mark.parametrize("threads", [1, 2])
def test_compiled_tracer_agrees_with_the_walk_in_an_interior(interior, threads):
    field, rays = interior
    walked = tracer.trace_rays(field, rays.origin_vs, rays.direction_vs)
    found, _ = compiled_tracer.trace_rays(field, rays.origin_vs, rays.direction_vs, threads=threads)
    assert {tracer.HIT, tracer.BLOCKED, tracer.UNKNOWN} <= set(walked.status)
    is_same = (found.status == walked.status) & (found.pixel == walked.pixel)
    assert 1.0 - is_same.mean() <= COMPILED_RAYS_THAT_DIFFER


def test_compiled_tracer_looks_at_the_cells_that_the_walk_looks_at(interior):
    field, rays = interior
    with counted_steps() as steps:
        tracer.trace_rays(field, rays.origin_vs, rays.direction_vs)
    _, compiled_steps = compiled_tracer.trace_rays(field, rays.origin_vs, rays.direction_vs)
    assert compiled_steps == pytest.approx(sum(steps), rel=COMPILED_RAYS_THAT_DIFFER)
