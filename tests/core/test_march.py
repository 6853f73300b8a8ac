# SPDX-License-Identifier: GPL-3.0-or-later
"""The march in even steps: against a plain loop, against the exact walk, and what it is known to miss."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera, GBuffer, ReflectionSettings, Settings, march, tracer, walk
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.field_stack import FieldStack
from ssgi_addon.core.scene import TraceScene
from ssgi_addon.core.tracer import MarchOptions
from tests.budget import examples
from tests.core.synthetic import Plane, Sphere, capture, look_at, uniform_gbuffer
from tests.core.test_tracer import (
    as_float64,
    centres,
    frames,
    is_same_answer,
    lenses,
    rays_beside,
    some_rays,
    unit,
)
from tests.reference.scalar_tracer import comes_over_edge
from tests.tolerances import (
    FLOAT32_DISTANCE,
    FLOAT32_POSITION_PX,
    MARCH_RAYS_THAT_DIFFER,
)

# Odd lengths: no point of a bisection falls on a border between pixels, where rounding decides
STEPS = st.sampled_from([0.0713, 0.2771, 0.9137, 2.3119, 8.0713, 1000.0])
ROOM = [Plane((0.0, -1.5, -6.0), (0.0, 1.0, 0.5)), Plane((0.0, 0.0, -8.0), (0.1, 0.0, 1.0)),
        Sphere((0.2, -0.1, -5.0), 0.9)]  # fmt: skip
VAULT = [Sphere((0.0, 0.0, -2.0), 5.0)]


def march_ray(field, rays, number, direction, step, bisections, starts_on_surface):
    """Return (status, flat pixel or -1, distance) of one ray by a plain loop over its samples."""
    camera = field.camera
    size = (camera.width, camera.height)
    x0, y0, q0 = (float(component[number]) for component in rays.start)
    vx, vy, vq = (float(component[number]) for component in rays.velocity)
    at = lambda s: (x0 + vx * s, y0 + vy * s)  # noqa: E731
    s = float(rays.s_begin[number])
    exits = [((n if v > 0 else 0) - p) / v for p, v, n in zip((x0, y0), (vx, vy), size) if v]
    s_vanish = float(rays.s_vanish[number])
    s_end = min([s_vanish, float(rays.s_limit[number]), *exits])
    if not s < s_end:
        return tracer.UNKNOWN, -1, math.inf

    def distance_at(s):
        q = 1.0 if camera.is_orthographic else q0 + vq * s
        return s / q if q else math.inf

    def cell_below(s):
        cells = (math.ceil(p) - 1 if v < 0 else math.floor(p) for p, v in zip(at(s), (vx, vy)))
        return tuple(min(max(cell, 0), n - 1) for cell, n in zip(cells, size))

    def height(cell, s):
        pixel = cell[1] * camera.width + cell[0]
        x, y = at(s)
        front, gx, gy, slab = (float(value) for value in field.planes[pixel])
        return q0 + vq * s - front - gx * (x - cell[0] - 0.5) - gy * (y - cell[1] - 0.5), slab

    home = (math.floor(x0), math.floor(y0)) if starts_on_surface else None

    def is_inside(s):
        h, slab = height(cell_below(s), s)
        return -slab <= h <= 0.0

    if home is not None:
        out = [((cell + (v > 0)) - p) / v for p, v, cell in zip((x0, y0), (vx, vy), home) if v]
        s = min([s_end, *out])
    speed = max(abs(vx), abs(vy))
    length = 0.5 * step / speed if speed else math.inf
    while s < s_end:
        outside, s = s, min(s + length, s_end)
        length = step / speed if speed else math.inf
        if is_inside(s):
            inside = s
            for _ in range(bisections):
                middle = 0.5 * (outside + inside)
                outside, inside = (outside, middle) if is_inside(middle) else (middle, inside)
            status = judge(field, cell_below(inside), home, ((x0, y0), (vx, vy)), height, outside, direction)
            if status is not None:
                cell = cell_below(inside)
                return status, cell[1] * camera.width + cell[0], distance_at(inside)
    if s == s_vanish:
        column, row = cell_below(s)
        is_open = field.is_background[row * camera.width + column]
        return (tracer.ESCAPED if is_open else tracer.UNKNOWN), -1, math.inf
    return tracer.UNKNOWN, -1, distance_at(s)


def cell_before(cell, start, velocity):
    """Return the cell that a ray was in before it came into one; where it starts there, that one."""
    passed = []
    for axis in (0, 1):
        sign = -1 if velocity[axis] < 0.0 else 1
        ahead = sign * (cell[axis] + (sign < 0) - start[axis])
        # The border that it crossed last is the one that takes it longer to reach
        passed.append(ahead * abs(velocity[1 - axis]) if ahead > 0.0 else -math.inf)
    if passed == [-math.inf, -math.inf]:
        return cell
    return tuple(
        c - (int(math.copysign(1, v)) if p == max(passed) else 0) for c, p, v in zip(cell, passed, velocity)
    )


def judge(field, cell, home, line, height, outside, direction):
    """Return HIT or BLOCKED, or None for the origin's own surface."""
    width = field.camera.width
    pixel = cell[1] * width + cell[0]
    h, slab = height(cell, outside)
    faces = float(field.normal[pixel] @ direction) < 0.0
    reach = float(field.reach[pixel])
    if comes_over_edge(field, cell, cell_before(cell, *line)):
        reach = min(reach, float(field.footprint[pixel]))
    if home is not None:
        away = max(abs(cell[0] - home[0]), abs(cell[1] - home[1]))
        if not faces and away <= 2:
            return None
        if away <= 1:
            reach += 0.5 * float(np.abs(field.planes[home[1] * width + home[0], 1:3]).sum())
    return tracer.HIT if faces and h >= -min(slab, reach) else tracer.BLOCKED


def assert_march_is_the_loop(frame, origin, direction, step, bisections, starts_on_surface=True) -> None:
    """The march finds what the loop does: for each ray, or for one beside it where rounding decides.

    So it does where the middle of a bisection falls on a border between pixels.
    """
    gbuffer, camera, thickness, _ = frame
    field = as_float64(DepthField.build(gbuffer, camera, thickness, max_level=0))
    found = tracer.trace_rays(
        field, origin, direction, march=MarchOptions(step, bisections), starts_on_surface=starts_on_surface
    )

    def agrees(one, start, toward):
        rays = tracer.project_rays(field, start[:, None].copy(), toward[:, None].copy())
        answer = march_ray(field, rays, 0, toward, step, bisections, starts_on_surface)
        # A parallel ray that ends before it comes into view tells where, the loop does not
        told = 2 if camera.is_orthographic and answer[2] == math.inf else 3
        return is_same_answer(one[:told], answer[:told])

    for number, (start, toward) in enumerate(zip(origin.T, direction.T)):
        one = [values[number] for values in (found.status, found.pixel, found.distance)]
        assert any(agrees(one, *beside) for beside in rays_beside(start, toward)), (start, toward, one)


@given(frames(), STEPS, st.sampled_from([0, 1, 5]))
@examples(max_examples=60)
def test_march_finds_what_a_plain_loop_finds(frame, step, bisections):
    assert_march_is_the_loop(frame, *some_rays(frame, 30), step, bisections)


@given(frames(), STEPS, st.sampled_from([0, 1, 5]))
@examples(max_examples=30)
def test_march_finds_what_a_plain_loop_finds_from_outside(frame, step, bisections):
    _, camera, _, rng = frame
    x, y = rng.uniform(-1.0, 2.0, 30) * camera.width, rng.uniform(-1.0, 2.0, 30) * camera.height
    origin = np.ascontiguousarray(camera.pixel_to_view(x, y, rng.uniform(0.5, 20.0, 30)).T)
    direction = unit(rng.normal(size=(3, 30)))
    assert_march_is_the_loop(frame, origin, direction, step, bisections, starts_on_surface=False)


@given(frames(), st.sampled_from([0.03, 1.0, 3.0]), st.sampled_from([0, 4]), st.sampled_from([np.inf, 3.0]))
@examples(max_examples=30)
def test_march_answers_each_ray_in_full(frame, step, bisections, reach):
    """Status, pixel, position and distance belong together, in float32; a hit is never on background."""
    gbuffer, camera, thickness, _ = frame
    field = DepthField.build(gbuffer, camera, thickness, max_level=0)
    origin, direction = (array.astype(np.float32) for array in some_rays(frame, 60))
    found = tracer.trace_rays(
        field, origin, direction, march=MarchOptions(step, bisections), max_distance=reach
    )
    assert np.isin(found.status, (tracer.UNKNOWN, tracer.BLOCKED, tracer.ESCAPED, tracer.HIT)).all()
    for values in (found.distance, found.x_px, found.y_px):
        assert not np.isnan(values).any()
    assert (found.distance >= 0.0).all()
    is_met = np.isin(found.status, (tracer.BLOCKED, tracer.HIT))
    assert (found.pixel[~is_met] == -1).all()
    assert not field.is_background[found.pixel[is_met]].any()
    row, column = np.divmod(found.pixel[is_met], camera.width)
    assert (np.abs(found.x_px[is_met] - column - 0.5) <= 0.5 + FLOAT32_POSITION_PX).all()
    assert (np.abs(found.y_px[is_met] - row - 0.5) <= 0.5 + FLOAT32_POSITION_PX).all()
    assert (found.distance[is_met] <= reach * (1.0 + FLOAT32_DISTANCE)).all()


@given(frames(), st.sampled_from([0.3, 1.0, 4.0]), st.sampled_from([1, 3, 40]))
@examples(max_examples=30)
def test_march_out_of_budget_is_unknown_and_a_larger_budget_changes_no_answer(frame, step, budget):
    gbuffer, camera, thickness, _ = frame
    field = DepthField.build(gbuffer, camera, thickness, max_level=0)
    rays = [array.astype(np.float32) for array in some_rays(frame, 60)]
    options = MarchOptions(step, 3)
    whole = tracer.trace_rays(field, *rays, march=options)
    part = tracer.trace_rays(field, *rays, march=options, max_steps=budget)
    is_out = (part.status != whole.status) | (part.distance != whole.distance)
    assert (part.status[is_out] == tracer.UNKNOWN).all()
    assert (part.pixel[is_out] == -1).all()
    assert (part.distance[is_out] < whole.distance[is_out]).all()
    np.testing.assert_array_equal(part.pixel[~is_out], whole.pixel[~is_out])
    samples = 2 + int((camera.width + camera.height) / step)
    enough = tracer.trace_rays(field, *rays, march=options, max_steps=samples)
    assert_same(enough, whole)


@given(frames())
@examples(max_examples=30)
def test_no_ray_meets_the_pixel_that_it_leaves(frame):
    gbuffer, camera, thickness, _ = frame
    field = DepthField.build(gbuffer, camera, thickness, max_level=0)
    origin, direction = (array.astype(np.float32) for array in some_rays(frame, 200))
    found = tracer.trace_rays(field, origin, direction, march=MarchOptions(1.0, 16))
    x, y, _ = camera.view_to_pixel(origin.T.astype(np.float64))
    assert (found.pixel != np.floor(y) * camera.width + np.floor(x)).all()


def assert_same(one: tracer.TraceResult, other: tracer.TraceResult) -> None:
    for name in ("status", "pixel", "distance", "x_px", "y_px"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


@pytest.mark.parametrize("max_steps", [None, 5])
def test_march_does_not_depend_on_how_rays_are_shared(rng, monkeypatch, max_steps):
    camera = Camera.perspective(64, 32, 1.0)  # no pyramid adds padding
    gbuffer = uniform_gbuffer((32, 64), rng.uniform(1.0, 5.0, (32, 64)))
    field = DepthField.build(gbuffer, camera, 0.1, max_level=0)
    rays = [array.astype(np.float32) for array in some_rays((gbuffer, camera, 0.1, rng), 2000)]
    options = {"march": MarchOptions(1.0, 3), "max_steps": max_steps}
    together = tracer.trace_rays(field, *rays, **options)
    assert_same(tracer.trace_rays(DepthField.build(gbuffer, camera, 0.1), *rays, **options), together)
    monkeypatch.setattr(tracer, "LEAST_RAYS", 1)
    monkeypatch.setattr(walk, "CAPACITY", 97)
    for threads in (1, 2, 8):
        assert_same(tracer.trace_rays(field, *rays, threads=threads, **options), together)


# Closed forms and the exact walk


def ways(camera: Camera, surfaces, rng) -> tuple[DepthField, np.ndarray, np.ndarray]:
    """Return the field of some surfaces, and a ray into the open from each pixel."""
    gbuffer = capture(camera, surfaces)
    origin, normal = centres(gbuffer, camera)
    direction = unit(rng.normal(size=origin.shape)).astype(np.float32)
    direction *= np.where((direction * normal).sum(axis=0) < 0.0, -1.0, 1.0).astype(np.float32)
    return DepthField.build(gbuffer, camera, 0.1, max_level=0), origin, direction


@pytest.mark.parametrize("surfaces", [ROOM, VAULT], ids=["room", "vault"])
@pytest.mark.parametrize("camera", lenses(96, 72), ids=["perspective", "orthographic"])
def test_finer_marches_come_closer_to_the_exact_walk(camera, surfaces, rng):
    field, origin, direction = ways(camera, surfaces, rng)
    exact = tracer.trace_rays(field, origin, direction)
    assert (exact.status == tracer.HIT).sum() > 30
    differing = []
    for step in (16.0, 4.0, 1.0, 0.25):
        found = tracer.trace_rays(field, origin, direction, march=MarchOptions(step, 8))
        differing.append(np.mean(found.status != exact.status))
    assert differing == sorted(differing, reverse=True)
    assert differing[2] <= MARCH_RAYS_THAT_DIFFER
    assert differing[0] > differing[-1]


@pytest.mark.parametrize("camera", lenses(96, 72), ids=["perspective", "orthographic"])
def test_bisections_bring_hits_nearer_to_where_the_exact_walk_finds_them(camera, rng):
    field, origin, direction = ways(camera, ROOM, rng)
    exact = tracer.trace_rays(field, origin, direction)
    off = []
    for bisections in range(7):
        found = tracer.trace_rays(field, origin, direction, march=MarchOptions(2.0, bisections))
        both = (found.status == tracer.HIT) & (exact.status == tracer.HIT)
        off.append(np.hypot(found.x_px - exact.x_px, found.y_px - exact.y_px)[both].mean())
    assert off == sorted(off, reverse=True)
    assert off[-1] < 0.25 * off[0]


@pytest.mark.parametrize("bisections", [0, 4])
@pytest.mark.parametrize("camera", lenses(48, 36), ids=["perspective", "orthographic"])
def test_hits_on_a_plane_lie_behind_it_by_less_than_the_last_step(camera, bisections, rng):
    point, normal = np.array([0.0, 0.0, -8.0]), np.array([0.4, -0.3, 1.0])
    field = DepthField.build(capture(camera, [Plane(point, normal)]), camera, 10.0)
    x, y, depth = rng.uniform(2, 46, 400), rng.uniform(2, 34, 400), rng.uniform(1.0, 4.0, 400)
    origin = np.ascontiguousarray(camera.pixel_to_view(x, y, depth).T)
    direction = unit(rng.normal(size=(3, 400)) + np.array([[0.0], [0.0], [-1.5]]))
    found = tracer.trace_rays(field, origin, direction, march=MarchOptions(3.0, bisections))
    exact = tracer.trace_rays(field, origin, direction)
    hit = (found.status == tracer.HIT) & (exact.status == tracer.HIT)
    assert hit.sum() > 100
    late = np.maximum(np.abs(found.x_px - exact.x_px), np.abs(found.y_px - exact.y_px))[hit]
    assert (late <= 3.0 / 2**bisections + FLOAT32_POSITION_PX).all()
    assert (found.distance[hit] >= exact.distance[hit] * (1.0 - FLOAT32_DISTANCE)).all()


@pytest.mark.parametrize("reach", [1.0, np.inf])
@pytest.mark.parametrize("camera", lenses(48, 36), ids=["perspective", "orthographic"])
def test_rays_that_meet_nothing_end_as_in_the_exact_walk(camera, reach, rng):
    gbuffer = capture(camera, [Sphere((0.3, -0.2, -6.0), 1.0)])
    field = DepthField.build(gbuffer, camera, 0.0, max_level=0)
    rays = [array.astype(np.float32) for array in some_rays((gbuffer, camera, 0.0, rng), 1000)]
    exact = tracer.trace_rays(field, *rays, max_distance=reach)
    found = tracer.trace_rays(field, *rays, max_distance=reach, march=MarchOptions(1.0, 3))
    is_open = np.isin(exact.status, (tracer.UNKNOWN, tracer.ESCAPED))
    assert (exact.status == tracer.ESCAPED).any() == np.isinf(reach)
    np.testing.assert_array_equal(found.status[is_open], exact.status[is_open])
    np.testing.assert_array_equal(found.distance[is_open], exact.distance[is_open])


@pytest.mark.parametrize(("step", "status"), [(1.0, tracer.BLOCKED), (8.0, tracer.HIT)])
def test_long_steps_miss_what_is_narrower(step, status):
    """A solid post of two pixels: samples eight pixels apart lie before it and beyond it, on the wall."""
    depth = np.full((3, 33), 10.0)
    depth[:, 16:18] = 3.0
    gbuffer = uniform_gbuffer((3, 33), depth, thickness=np.full((3, 33), 9.0))
    camera = Camera.perspective(33, 3, 1.0)
    origin, target = (
        camera.pixel_to_view(np.array([x]), np.array([1.5]), np.array([depth])).T
        for x, depth in ((6.5, 8.0), (26.0, 10.0))
    )
    field = DepthField.build(gbuffer, camera, 0.1)
    found = tracer.trace_rays(field, origin, unit(target - origin), march=MarchOptions(step, 5))
    assert found.status.tolist() == [status]


def test_rays_from_far_away_and_steps_of_no_length_end():
    """Steps of 1/32 pixel are lost in the digits of a place ten million pixels away."""
    field = DepthField.build(uniform_gbuffer((9, 9), 5.0), Camera.perspective(9, 9, 1.0), 0.1, max_level=0)
    origin = field.camera.pixel_to_view(np.array([-1e7, 4.5]), np.array([4.5, 4.5]), np.array([4.0, 4.0])).T
    origin, direction = origin.astype(np.float32), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]], np.float32)
    found = tracer.trace_rays(field, origin, direction, march=MarchOptions(0.0, 2), starts_on_surface=False)
    assert found.status.tolist() == [tracer.UNKNOWN, tracer.UNKNOWN]


def test_visitors_march_each_through_its_own_field(rng):
    camera = Camera.perspective(24, 18, 1.0)
    fields = [
        DepthField.build(uniform_gbuffer((18, 24), depth), camera, 0.1, max_level=0) for depth in (3.0, 5.0)
    ]
    origin = np.ascontiguousarray(camera.pixel_to_view(*rng.uniform(1.0, 17.0, (2, 50)), np.full(50, 2.0)).T)
    direction = unit(rng.normal(size=(3, 50)) - np.array([[0.0], [0.0], [1.0]]))
    parts = [tracer.project_rays(field, origin, direction, index=index) for index, field in enumerate(fields)]
    options = {"march": MarchOptions(1.0, 3)}
    found = tracer.trace_visitors(
        FieldStack(fields), tracer.ScreenRays.joined(parts), np.tile(direction, 2), **options
    )
    for index, field in enumerate(fields):
        alone = tracer.trace_rays(field, origin, direction, starts_on_surface=False, **options)
        part = slice(50 * index, 50 * (index + 1))
        pixel = np.where(alone.pixel < 0, -1, alone.pixel + index * 18 * 24)
        np.testing.assert_array_equal(found.status[part], alone.status)
        np.testing.assert_array_equal(found.pixel[part], pixel)
        np.testing.assert_array_equal(found.distance[part], alone.distance)
        assert (alone.status == tracer.HIT).any()


@pytest.mark.parametrize(("method", "step"), [("linear", 2.0), ("linear", 0.0), ("hierarchical", 2.0)])
def test_scene_marches_through_all_views_where_its_method_is_linear_and_has_a_step(
    method, step, rng, monkeypatch
):
    camera = Camera.perspective(48, 36, 1.0)
    beside = Camera.perspective(48, 36, 1.0, world_from_view=look_at((0.0, 0.0, 0.0), (2.0, 0.0, -2.0)))
    settings = Settings(reflections=ReflectionSettings(method=method, march_step=step, bisections=0))
    marched = []

    class March(march.March):
        def __init__(self, *arguments):
            marched.append(arguments[3])
            super().__init__(*arguments)

    monkeypatch.setattr(tracer, "March", March)
    gbuffer = capture(camera, ROOM)
    scene = TraceScene(gbuffer, camera, [(capture(beside, ROOM), beside)], settings, method=method)
    field, origin, direction = ways(camera, ROOM, rng)
    answers = scene.answer(origin, direction)
    if method == "linear" and step:
        assert marched == [True, False]
        found = tracer.trace_rays(field, origin, direction, march=MarchOptions(step, 0))
        hit = found.status == tracer.HIT
        np.testing.assert_array_equal(answers.texel[hit], found.pixel[hit])
    else:
        assert not marched
    assert (answers.texel[answers.status == tracer.HIT] >= gbuffer.depth.size).any()


def test_what_is_met_at_the_vanishing_point_is_far_away_and_not_behind():
    """There q is what rounding leaves of it: below 0 for this ray, after its last sample."""
    depth = [540.32513, 0.26796645, 0.0023375542, 0.0014084736, 20865.662, 163983.52, 288.2186]
    normal = [
        (-0.8068032, -0.4741877, 0.35244083),
        (-0.2715929, 0.35344884, 0.8951599),
        (-0.084274106, 0.8959256, 0.43613675),
        (0.36089712, 0.9275972, 0.09652288),
        (-0.58561736, -0.7259972, 0.36052784),
        (0.2088524, -0.9576105, 0.19840047),
        (-0.26393282, 0.8965105, 0.3558209),
    ]
    black = np.zeros((7, 1, 3))
    gbuffer = GBuffer(
        np.float32(depth)[:, None], np.float32(normal)[:, None], black, black, black[..., 0], black,
        thickness=np.full((7, 1), np.inf),
    )  # fmt: skip
    camera = Camera(1, 7, 0.7308479735390511, 0.7308479735390511, 0.5, 3.5, False, np.eye(4))
    field = DepthField.build(gbuffer, camera, 0.0, max_level=0)
    origin = np.float32([[0.0], [-448748.62], [-163983.52]])
    direction = np.float32([[-0.32875022], [0.6968637], [-0.63742006]])
    found = tracer.trace_rays(field, origin, direction, march=MarchOptions(3.0, 0))
    assert found.status[0] == tracer.BLOCKED
    assert found.distance[0] == np.inf
