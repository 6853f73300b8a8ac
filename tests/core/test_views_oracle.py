# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through many views: what all rays at once find against the scalar definition, one ray at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import Camera, GBuffer, Settings, tracer
from ssgi_addon.core import scene as scene_module
from ssgi_addon.core.answers import MergedAnswers, Sight
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.frame_points import surface_points
from ssgi_addon.core.scene import TraceScene
from tests.budget import examples
from tests.core.synthetic import Plane, Sphere, capture, look_at, uniform_gbuffer
from tests.core.test_tracer import as_float64, unit
from tests.reference.scalar_views import answer_ray
from tests.tolerances import ANSWERS_BY_ORDER, DISTANCES_BY_ORDER, FLOAT64_DISTANCE, SAME_HIT

RAYS = 12


class Float64Field:
    """Builds fields whose arrays are float64, so that all that follows computes in float64."""

    @staticmethod
    def build(*args, **options) -> DepthField:
        return as_float64(DepthField.build(*args, **options))


@pytest.fixture(autouse=True, scope="module")
def float64_fields():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_module, "DepthField", Float64Field)
        yield


def random_pose(rng, place) -> np.ndarray:
    """Return a pose at a place that looks about where the others do, upright or not."""
    pose = look_at(place, np.array([0.0, 0.0, -4.0]) + rng.normal(0.0, 1.5, 3))
    turn, roll = rng.uniform(0.0, 2.0 * np.pi), np.eye(4)
    roll[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    return pose @ roll


def random_layers(rng, camera, kind, thickness, sky) -> GBuffer:
    """Return what a view of noise shows; its second layer, where it has one, lies behind the first."""
    shape = (camera.height, camera.width)

    def depths() -> np.ndarray:
        if kind == "noise":
            return rng.uniform(1.0, 6.0, shape)
        if kind == "steps":
            return rng.choice([2.0, 3.0, 8.0], shape)
        return np.maximum(4.0 + np.cumsum(rng.normal(0.0, 0.1, shape), axis=1), 0.5)

    front = depths()
    behind, black = None, np.zeros((*shape, 3))
    for depth in [front + depths(), front] if rng.random() < 0.5 else [front]:
        normal = rng.normal(size=(*shape, 3))
        normal[..., 2] = np.abs(normal[..., 2])
        light = np.repeat(1.0 * (rng.random((*shape, 1)) < 0.7), 3, axis=2)
        behind = GBuffer(
            np.where(rng.random(shape) < sky, np.inf, depth), normal, black, black, black[..., 0], light,
            thickness=thickness if thickness is None else np.full(shape, thickness), behind=behind,
        )  # fmt: skip
    return behind


@dataclass(frozen=True)
class ManyViews:
    """Two to five views, the frame first: some at the frame's place or at each other's, some parallel.

    `thickness` is of every pixel, None where none was captured; `sky` the share of background.
    """

    seed: int
    count: int
    kind: str
    thickness: float | None
    sky: float

    def make(self) -> tuple[list[tuple[GBuffer, Camera]], np.random.Generator]:
        """Return the views, and what draws on."""
        rng = np.random.default_rng(self.seed)
        places, views = [np.zeros(3)], []
        size = self.random_size(rng)
        for index in range(self.count):
            if rng.random() < 0.6:
                places.append(rng.normal((0.0, 0.0, -2.0), 2.5, 3))
            place = places[rng.integers(len(places)) if index else 0]
            if rng.random() < 0.3:
                size = self.random_size(rng)
            lens = {"shift_px": (1.3, -0.7)} if rng.random() < 0.3 else {}
            lens["world_from_view"] = random_pose(rng, place)
            if rng.random() < 0.25:
                is_wider = index > 0 and rng.random() < 0.3
                if is_wider:
                    lens["world_from_view"] = views[0][1].world_from_view
                # Its pixels' borders lie on none of the frame's: rounding would decide there
                camera = Camera.orthographic(*size, 8.37 if is_wider else 6.0, **lens)
            else:
                camera = Camera.perspective(*size, rng.uniform(0.8, 2.2), **lens)
            views.append((random_layers(rng, camera, self.kind, self.thickness, self.sky), camera))
        return views, rng

    @staticmethod
    def random_size(rng) -> tuple[int, int]:
        return int(rng.integers(1, 24)), int(rng.integers(1, 24))


MANY_VIEWS = st.builds(
    ManyViews,
    st.integers(0, 2**32 - 1),
    st.integers(2, 5),
    st.sampled_from(["noise", "steps", "smooth"]),
    st.sampled_from([None, 0.0, 0.5, np.inf]),
    st.sampled_from([0.0, 0.3, 0.95]),
)


def some_rays(gbuffer, camera, rng, count) -> tuple[np.ndarray, np.ndarray]:
    """Return origins on a view's surfaces (3, N), and random directions."""
    x, y = rng.integers(0, camera.width, count), rng.integers(0, camera.height, count)
    depth = gbuffer.depth[y, x].astype(np.float64)
    origin = camera.pixel_to_view(x + 0.5, y + 0.5, np.where(np.isinf(depth), 4.0, depth)).T
    return np.ascontiguousarray(origin), unit(rng.normal(size=(3, count)))


def scene_of(views, **options) -> TraceScene:
    return TraceScene(*views[0], views[1:], replace(Settings(), **options))


THICKNESS = st.sampled_from([0.0, 0.1])
REACH = st.sampled_from([1e4, 4.0])


@given(MANY_VIEWS, THICKNESS, REACH)
@examples(max_examples=80)
def test_all_rays_at_once_find_what_each_finds_alone(drawn, thickness, max_distance):
    views, rng = drawn.make()
    scene = scene_of(views, thickness=thickness, max_distance=max_distance)
    home = int(rng.integers(len(views)))
    origin, direction = some_rays(*views[home], rng, RAYS)
    found = scene.answer(origin, direction, home)
    expected = [answer_ray(scene.views, home, o, d, max_distance) for o, d in zip(origin.T, direction.T)]
    np.testing.assert_array_equal(found.status, [status for status, _, _ in expected])
    texels = [scene.texels if texel is None else texel for _, texel, _ in expected]
    np.testing.assert_array_equal(found.texel, texels)
    np.testing.assert_allclose(found.distance, [d for _, _, d in expected], rtol=FLOAT64_DISTANCE)


def assert_same_answers(one, other, texel_of_other=None) -> None:
    np.testing.assert_array_equal(one.status, other.status)
    hit = one.status == tracer.HIT
    np.testing.assert_array_equal(one.distance[hit], other.distance[hit])
    texel = other.texel if texel_of_other is None else texel_of_other[other.texel]
    np.testing.assert_array_equal(one.texel[hit], texel[hit])


def blank(camera: Camera) -> GBuffer:
    return uniform_gbuffer((camera.height, camera.width), np.inf)


@given(MANY_VIEWS, THICKNESS)
@examples(max_examples=30)
def test_a_view_that_no_ray_comes_into_changes_no_answer(drawn, thickness):
    views, rng = drawn.make()
    origin, direction = some_rays(*views[0], rng, RAYS)
    far = Camera.orthographic(9, 7, 5.0, world_from_view=look_at((0.0, 500.0, 0.0), (0.0, 1000.0, 1.0)))
    options = {"thickness": thickness, "max_distance": 100.0}
    found = scene_of(views, **options).answer(origin, direction)
    assert_same_answers(found, scene_of([*views, (blank(far), far)], **options).answer(origin, direction))


def test_a_view_of_the_sky_alone_sees_rays_go_by():
    """Rays leave the frame upward; a view from elsewhere, of the sky alone, sees them go on for ever."""
    camera = Camera.perspective(24, 24, 1.2)
    wall = Plane((0.0, 0.0, -3.0), (0.0, 0.0, 1.0), bounds=lambda p: p[:, 0] < 0.0)
    ground = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    frame = capture(camera, [wall, ground])
    up = Camera.perspective(64, 64, 2.6, world_from_view=look_at((0.0, -0.9, -4.0), (0.0, 5.0, -4.0)))
    sky = capture(up, [Plane((0.0, -9.0, 0.0), (0.0, 1.0, 0.0))])
    assert sky.is_background.all()
    # From the ground beside the wall's edge
    origin = np.array([[0.05], [-1.0], [-2.5]]).repeat(5, axis=1)
    direction = unit(np.stack([np.linspace(0.0, 0.2, 5), np.full(5, 2.0), np.full(5, -0.9)]))
    alone, found = (
        TraceScene(frame, camera, views, Settings()).merge(origin, direction) for views in ((), [(sky, up)])
    )
    assert not np.isinf(alone.open_until).any()
    assert np.isinf(found.open_until).all()


@given(MANY_VIEWS, THICKNESS, REACH)
@examples(max_examples=30)
def test_the_same_views_again_change_no_answer(drawn, thickness, max_distance):
    views, rng = drawn.make()
    origin, direction = some_rays(*views[0], rng, RAYS)
    once, twice = (
        scene_of(each, thickness=thickness, max_distance=max_distance).answer(origin, direction)
        for each in (views, [*views, *views[1:]])
    )
    assert_same_answers(once, twice)


def texels_in_order(views, order) -> np.ndarray:
    """Return the texel, where views stand in one order, of each texel where they stand in another."""
    counts = [texel_count(gbuffer) for gbuffer, _ in views]
    begins = np.concatenate([[0], np.cumsum(counts)])
    parts = [np.arange(begins[index], begins[index + 1]) for index in order]
    return np.concatenate([*parts, begins[-1:]])


def texel_count(gbuffer: GBuffer | None) -> int:
    return 0 if gbuffer is None else gbuffer.depth.size + texel_count(gbuffer.behind)


@given(MANY_VIEWS, THICKNESS, st.booleans())
@examples(max_examples=30)
def test_views_of_one_place_answer_the_same_in_any_order(drawn, thickness, is_home):
    views, rng = drawn.make()
    place = views[0][1].world_from_view[:3, 3] if is_home else np.array([1.0, 0.5, -1.0])
    moved = [
        (random_layers(rng, camera, "noise", None, 0.3), camera)
        for camera in (
            Camera.perspective(11, 8, 1.4, world_from_view=random_pose(rng, place)) for _ in range(4)
        )
    ]
    views = [views[0], *moved]
    order = [0, *(1 + rng.permutation(len(moved)))]
    origin, direction = some_rays(*views[0], rng, 2 * RAYS)
    given_so, otherwise = (
        scene_of(each, thickness=thickness).answer(origin, direction)
        for each in (views, [views[index] for index in order])
    )
    assert_same_answers(given_so, otherwise, texels_in_order(views, order))


@given(MANY_VIEWS)
@examples(max_examples=20)
def test_an_answer_does_not_depend_on_what_other_rays_are_asked(drawn):
    views, rng = drawn.make()
    origin, direction = some_rays(*views[0], rng, 3 * RAYS)
    scene = scene_of(views)
    together = scene.answer(origin, direction)
    for part in (slice(0, 5), slice(5, 3 * RAYS)):
        alone = scene.answer(origin[:, part], direction[:, part])
        for name in ("status", "texel", "distance", "x_px", "y_px"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name)[part])


@given(MANY_VIEWS)
@examples(max_examples=10)
def test_threads_change_no_bit_with_many_views(drawn):
    views, rng = drawn.make()
    origin, direction = some_rays(*views[0], rng, 200)
    scene = scene_of(views)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracer, "LEAST_RAYS", 20)
        one, four = (scene.answer(origin, direction, threads=threads) for threads in (1, 4))
    for name in ("status", "texel", "distance", "x_px", "y_px"):
        np.testing.assert_array_equal(getattr(one, name), getattr(four, name))


# What single rules say.


def test_stretches_join_in_whatever_order_rays_need_them():
    merged = MergedAnswers(2, np.dtype(np.float64))
    both = np.arange(2)
    # The first ray needs the third, the second, the first; the second one the third, the first, the second
    merged.see(Sight(both, np.array([2.0, 1.0]), np.array([3.0, 2.0])))
    merged.see(Sight(both, np.array([1.0, 2.0]), np.array([2.0, 3.0])))
    merged.see(Sight(both, np.array([0.0, 0.0]), np.array([1.0, 1.0])))
    assert merged.open_until.tolist() == [3.0, 3.0]


def test_ray_past_the_corner_of_a_view_is_not_in_its_sight():
    camera = Camera.perspective(8, 8, np.pi / 2)  # at depth 1 from -1 to 1
    field = DepthField.build(uniform_gbuffer((8, 8), 5.0), camera, 0.1)
    # Both rise to the frame's lower border; one has left its width by then
    origin = np.array([[0.0, 0.9], [-1.5, -1.5], [-1.0, -1.0]])
    direction = np.array([[0.1, 0.1], [0.1, 0.1], [0.0, 0.0]])
    lines = tracer.project_rays(field, origin, direction)
    assert np.isfinite(lines.s_begin).tolist() == [True, False]


def test_parallel_view_sees_nothing_behind_its_camera():
    camera = Camera.orthographic(8, 8, 8.0)
    field = DepthField.build(uniform_gbuffer((8, 8), 5.0), camera, 0.1)
    found = tracer.trace_rays(field, np.array([[0.0], [0.0], [-5.0]]), np.array([[0.1], [0.0], [1.0]]))
    assert found.status[0] == tracer.UNKNOWN
    np.testing.assert_allclose(found.distance, 5.0, rtol=FLOAT64_DISTANCE)
    # And a ray that comes from behind it comes into its sight at the camera's plane
    ray = np.array([[0.0], [0.0], [3.0]]), np.array([[0.0], [0.0], [-1.0]])
    scene = scene_of([(uniform_gbuffer((8, 8), 5.0), camera)])
    assert scene.open_from(*ray).tolist() == [0.0]
    ray = np.array([[0.0], [0.0], [0.0]]), ray[1]
    np.testing.assert_allclose(scene.open_from(*ray), 5.0, rtol=FLOAT64_DISTANCE)


@pytest.mark.parametrize("hidden", [1.0, 3.0], ids=["hidden before", "begins inside"])
def test_ray_whose_hit_turns_out_to_be_empty_goes_on(hidden):
    """A hit that one view guesses, another sees through: a third one is asked what comes after."""
    merged = MergedAnswers(1, np.dtype(np.float64))
    field = DepthField.build(uniform_gbuffer((1, 1), 5.0), Camera.perspective(1, 1, 1.0), 0.1)
    found = tracer.TraceResult.empty(1, np.dtype(np.float64))
    found.status[0], found.pixel[0], found.distance[0], found.hidden[0] = tracer.HIT, 0, 3.0, hidden
    ray = np.zeros(1, dtype=np.int64)
    merged.add(field, 0, ray, found)
    merged.see(Sight(ray, np.zeros(1), np.ones(1)))
    assert merged.is_uncertain()[0]
    merged.see(Sight(ray, np.zeros(1), np.array([5.0])))
    assert merged.is_uncertain()[0]
    assert merged.answers(1).status[0] == tracer.UNKNOWN


def test_ray_that_ends_before_it_comes_over_a_frame_was_followed_to_its_end():
    camera = Camera.perspective(8, 8, np.pi / 2)
    field = DepthField.build(uniform_gbuffer((8, 8), 5.0), camera, 0.1)
    origin, direction = np.array([[-3.0], [0.0], [-1.0]]), np.array([[1.0], [0.0], [0.0]])
    found = tracer.trace_rays(field, origin, direction, max_distance=1.5, starts_on_surface=False)
    np.testing.assert_allclose(found.distance, 1.5, rtol=FLOAT64_DISTANCE)


def test_rays_of_the_largest_distance_go_nowhere_else(rng):
    """They end in the air before the frame's wall, where another view has a solid surface before them."""
    camera = Camera.perspective(16, 16, np.pi / 2)
    solid = uniform_gbuffer((16, 16), 1.0, thickness=np.full((16, 16), np.inf))
    beside = Camera.perspective(16, 16, 2.5, world_from_view=look_at((30.0, 0.0, -8.0), (0.0, 0.0, -8.0)))
    direction = unit(rng.normal(size=(3, 500)) + np.array([[0.0], [0.0], [4.0]]))
    origin = np.tile([[0.0], [0.0], [-10.0]], 500)
    origin, direction = origin.astype(np.float32), direction.astype(np.float32)
    options = {"views": [(uniform_gbuffer((16, 16), 10.0), camera), (solid, beside)]}
    within = scene_of(**options, max_distance=3.0).answer(origin, direction)
    assert (within.status == tracer.UNKNOWN).all()
    beyond = scene_of(**options).answer(origin, direction)
    assert (beyond.status != tracer.UNKNOWN).mean() > 0.5


# Views of a room. What each shows is true, up to the size of its pixels.


def test_order_of_places_changes_few_answers(rng):
    room = [
        *(Plane(axis, axis) for axis in 2.5 * np.concatenate([np.eye(3), -np.eye(3)])),
        *(Sphere((x, -1.9, z), 0.6) for x, z in ((-1.5, -1.0), (1.2, -0.5), (0.2, 1.2))),
    ]
    camera = Camera.perspective(48, 36, 1.0, world_from_view=look_at((0.0, 0.5, 2.3), (0.0, -0.5, 0.0)))
    frame = (capture(camera, room), camera)
    views = []
    for place in ((-2.2, 0.5, 0.0), (2.2, 1.0, 0.5), (0.0, 2.2, -2.0), (0.5, 0.0, -2.2)):
        other = Camera.perspective(48, 48, 1.8, world_from_view=look_at(place, (0.0, -1.0, 0.0)))
        views.append((capture(other, room), other))
    pixel = np.repeat(np.arange(48 * 36), 2)
    origin, normal = surface_points(*frame, pixel)
    direction = unit(normal + unit(rng.normal(size=normal.shape))).astype(np.float32)
    one, other = (scene_of([frame, *each]).answer(origin, direction) for each in (views, views[::-1]))
    assert (one.status == tracer.HIT).mean() > 0.8
    assert (one.status != other.status).mean() <= ANSWERS_BY_ORDER
    hit = (one.status == tracer.HIT) & (other.status == tracer.HIT)
    is_near = np.isclose(one.distance[hit], other.distance[hit], rtol=SAME_HIT)
    assert 1.0 - is_near.mean() <= DISTANCES_BY_ORDER
