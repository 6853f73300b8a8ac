# SPDX-License-Identifier: GPL-3.0-or-later
"""Further views and layers behind: they answer what the frame cannot, and change nothing that it can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, GBuffer, IndirectLight, Settings, render_indirect, tracer
from ssgi_addon.core.scene import TraceScene
from tests.core.synthetic import Plane, Sphere, capture, look_at, make_settings, uniform_gbuffer
from tests.tolerances import (
    CLOSED_FORM_RELATIVE,
    MIRROR_PIXELS_OFF,
    REPEATED_SUM,
    SPLIT_FRAME,
    VIEW_HIT_UNITS,
)

WHITE = Environment.constant((1.0, 1.0, 1.0))
BACKWARDS = np.diag([-1.0, 1.0, -1.0, 1.0])

View = tuple[GBuffer, Camera]


def light_of(frame: View, views=(), environment=None, **options) -> IndirectLight:
    return render_indirect(*frame, make_settings(**options), environment, views)


def crop(columns: slice) -> Camera:
    """Part of a panorama of 96 x 32 pixels: its own optical axis, the same pixels."""
    whole = Camera.perspective(96, 32, 2.2)
    width = columns.stop - columns.start
    shift = whole.cx - columns.start - 0.5 * width
    return Camera.perspective(width, 32, 2.0 * np.arctan(0.5 * width / whole.fx), shift_px=(shift, 0.0))


WALLS = (
    Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5, specular=0.5, source=0.2),
    Plane((-3.0, 0.0, 0.0), (1.0, 0.0, 0.2), albedo=(0.8, 0.2, 0.1), source=lambda p: 1.5 + np.sin(p)),
    Plane((3.0, 0.0, 0.0), (1.0, 0.0, -0.3), albedo=0.5, source=lambda p: 1.5 + np.cos(p)),
    Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0), albedo=0.5, specular=0.4, source=0.5),
    Sphere((0.3, -0.4, -3.5), 0.6, albedo=0.3, specular=0.7),
)


def panorama() -> tuple[View, View, list[View]]:
    """The whole panorama, its middle third, and the two others as views."""
    parts = [crop(slice(begin, end)) for begin, end in ((0, 96), (32, 64), (0, 32), (64, 96))]
    whole, middle, left, right = [(capture(camera, WALLS), camera) for camera in parts]
    return whole, middle, [left, right]


def test_a_panorama_in_three_parts_lights_its_middle_like_one():
    whole, middle, sides = panorama()
    np.testing.assert_allclose(middle[0].depth, whole[0].depth[:, 32:64], rtol=1e-5)
    options = {"rays": 32, "unknown": "nothing"}
    expected, alone, found = (
        light_of(frame, views, WHITE, **options)
        for frame, views in ((whole, ()), (middle, ()), (middle, sides))
    )
    centre = slice(32, 64)
    for name in ("diffuse", "glossy", "visibility", "known_diffuse", "known_glossy"):
        truth = getattr(expected, name)[:, centre]
        error = np.abs(getattr(found, name) - truth).mean()
        assert error <= SPLIT_FRAME * truth.mean(), name
        if name != "visibility":
            assert error < 0.2 * np.abs(getattr(alone, name) - truth).mean(), name
    assert found.known.mean() > alone.known.mean() + 0.05


def test_later_bounces_through_views_are_those_of_one_wide_frame():
    whole, middle, sides = panorama()
    expected, found = (
        light_of(frame, views, rays=64, bounces=6).diffuse for frame, views in ((whole, ()), (middle, sides))
    )
    assert found.mean() == pytest.approx(float(expected[:, 32:64].mean()), rel=CLOSED_FORM_RELATIVE)


def test_views_take_no_answer_away():
    _, middle, sides = panorama()
    alone, found = light_of(middle, unknown="nothing"), light_of(middle, sides, unknown="nothing")
    for name in ("known_diffuse", "known_glossy", "diffuse", "glossy"):
        assert (getattr(found, name) >= getattr(alone, name) * (1.0 - REPEATED_SUM)).all(), name


def test_the_same_view_twice_and_in_any_order_says_the_same():
    _, middle, sides = panorama()
    once, twice, turned = (light_of(middle, views) for views in (sides, [*sides, *sides], sides[::-1]))
    for other in (twice, turned):
        np.testing.assert_array_equal(other.known, once.known)
        np.testing.assert_allclose(other.diffuse, once.diffuse, rtol=REPEATED_SUM)
        np.testing.assert_allclose(other.glossy, once.glossy, rtol=REPEATED_SUM)


def mirror_and_what_is_behind_the_camera(view_pose: np.ndarray) -> tuple[View, View]:
    """A mirror in front of the camera, and a view of the wall 4 units behind it, which shows its x and y."""
    camera = Camera.perspective(32, 24, 0.8)
    mirror = (capture(camera, [Plane((0.0, 0.0, -3.0), (0.0, 0.0, 1.0), specular=1.0)]), camera)
    back = Camera.perspective(160, 120, 2.0, world_from_view=view_pose)
    wall = Plane((0.0, 0.0, 4.0), (0.0, 0.0, 1.0), source=lambda p: p + 10.0)
    return mirror, (capture(back, [wall]), back)


@pytest.mark.parametrize(
    "pose", [BACKWARDS, look_at((0.5, 0.2, -1.0), (0.3, 0.1, 4.0)), look_at((2.0, 1.5, 1.0), (0.0, 0.0, 4.0))]
)
def test_mirror_shows_what_stands_behind_the_camera(pose):
    mirror, view = mirror_and_what_is_behind_the_camera(pose)
    light = light_of(mirror, [view], diffuse=False)
    y, x = np.mgrid[0:24, 0:32] + 0.5
    ahead = mirror[1].pixel_to_view(x, y, np.ones_like(x))
    expected = ahead[..., :2] * (3.0 + 7.0) + 10.0  # 3 to the mirror, 7 back to the wall
    known = light.known_glossy == 1.0
    assert known.mean() > 0.9
    np.testing.assert_allclose(light.glossy[..., :2][known], expected[known], atol=VIEW_HIT_UNITS)
    # Without the view nothing is known of it
    assert (light_of(mirror, diffuse=False).known_glossy == 0.0).all()


def test_rays_reach_into_views_as_far_as_they_may():
    mirror, view = mirror_and_what_is_behind_the_camera(BACKWARDS)
    for reach, is_known in ((6.9, False), (9.0, True)):
        light = light_of(mirror, [view], diffuse=False, max_distance=reach)
        assert (light.known_glossy[10:14, 14:18] == float(is_known)).all()


def test_parallel_views_answer_too():
    mirror, _ = mirror_and_what_is_behind_the_camera(BACKWARDS)
    camera = Camera.orthographic(80, 60, 10.0, world_from_view=BACKWARDS)
    wall = Plane((0.0, 0.0, 4.0), (0.0, 0.0, 1.0), source=lambda p: p + 10.0)
    light = light_of(mirror, [(capture(camera, [wall]), camera)], diffuse=False)
    y, x = np.mgrid[0:24, 0:32] + 0.5
    expected = mirror[1].pixel_to_view(x, y, np.ones_like(x))[..., :2] * 10.0 + 10.0
    assert (light.known_glossy == 1.0).all()
    np.testing.assert_allclose(light.glossy[..., :2], expected, atol=VIEW_HIT_UNITS)


def test_nearest_answer_of_all_views_wins():
    """Two views see walls behind the camera, at 4 and at 2 units: the nearer one hides the other."""
    mirror, far = mirror_and_what_is_behind_the_camera(BACKWARDS)
    near_wall = Plane((0.0, 0.0, 2.0), (0.0, 0.0, 1.0), source=77.0)
    near = (capture(far[1], [near_wall]), far[1])
    for views in ([far, near], [near, far]):
        light = light_of(mirror, views, diffuse=False)
        np.testing.assert_array_equal(light.glossy[2:-2, 2:-2], 77.0)  # the outer ones pass the nearer wall


def test_sky_in_a_view_is_known_sky():
    mirror, _ = mirror_and_what_is_behind_the_camera(BACKWARDS)
    camera = Camera.perspective(40, 30, 2.0, world_from_view=BACKWARDS)
    sky = (uniform_gbuffer((30, 40), np.inf), camera)
    light = light_of(mirror, [sky], WHITE, diffuse=False, unknown="nothing")
    assert (light.known_glossy == 1.0).all()
    np.testing.assert_allclose(light.glossy, 1.0)


def surround(radius: float, albedo: float, faces: int = 24) -> list[View]:
    """Six views of 90 degrees from the centre of a ball whose walls hand on 1."""
    targets = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    poses = [look_at((0.0, 0.0, 0.0), target) for target in targets]
    poses = [look_at((0.0, 0.0, 0.0), target) for target in targets]
    cameras = [Camera.perspective(faces, faces, np.pi / 2, world_from_view=pose) for pose in poses]
    ball = Sphere((0.0, 0.0, 0.0), radius, albedo=albedo, source=1.0)
    return [(capture(camera, [ball]), camera) for camera in cameras]


@pytest.mark.parametrize("bounces", [1, 2, 3, 6])
def test_light_in_a_closed_ball_is_the_geometric_series(bounces):
    """Every wall sees walls alone: k bounces of walls that hand on 1 are 1 + a + ... + a^(k-1)."""
    albedo = 0.5
    camera = Camera.perspective(24, 24, 1.0)
    frame = (capture(camera, [Sphere((0.0, 0.0, 0.0), 3.0, albedo=albedo, source=1.0)]), camera)
    light = light_of(frame, surround(3.0, albedo), rays=32, bounces=bounces)
    assert light.known_diffuse.mean() > 0.99
    expected = sum(albedo**k for k in range(bounces))
    assert float(light.diffuse.mean()) == pytest.approx(expected, rel=CLOSED_FORM_RELATIVE)
    assert light.diffuse.max() <= expected * (1.0 + REPEATED_SUM)


def test_white_furnace_with_views_is_white():
    camera = Camera.perspective(24, 24, 1.0)
    frame = (capture(camera, [Sphere((0.0, 0.0, 0.0), 3.0, albedo=1.0, specular=1.0, source=1.0)]), camera)
    light = light_of(frame, surround(3.0, 1.0), WHITE, rays=8)
    np.testing.assert_allclose(light.diffuse, 1.0, rtol=REPEATED_SUM)
    np.testing.assert_allclose(light.glossy, 1.0, rtol=REPEATED_SUM)


def test_moving_the_whole_world_changes_nothing():
    _, middle, sides = panorama()
    motion = look_at((5.0, -2.0, 7.0), (1.0, 1.0, 1.0))
    moved = [
        (gbuffer, replace(camera, world_from_view=motion @ camera.world_from_view))
        for gbuffer, camera in sides
    ]
    frame = (middle[0], replace(middle[1], world_from_view=motion))
    found, expected = light_of(frame, moved, WHITE), light_of(middle, sides, WHITE)
    for name in ("diffuse", "glossy", "known"):
        difference = np.abs(getattr(found, name) - getattr(expected, name))
        assert (difference > 1e-3).mean() <= MIRROR_PIXELS_OFF, name


def test_views_of_views_see_the_sky_where_the_world_has_it():
    """A view that looks elsewhere gathers the environment of its own directions for its own bounce."""
    up_is_z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    image = np.zeros((16, 32, 3))
    image[:8] = 1.0  # the upper half of the sky is bright
    sky = Environment.equirectangular(image, up_is_z)
    camera = Camera.perspective(16, 16, 0.6)
    ceiling = Plane((0.0, 3.0, 0.0), (0.0, 1.0, 0.0), albedo=1.0)
    ground = Plane((0.0, -3.0, 0.0), (0.0, 1.0, 0.0), albedo=1.0)
    results = {}
    for name, surface, target in (
        ("ground", ground, (0.0, -1.0, 0.01)),
        ("ceiling", ceiling, (0.0, 1.0, 0.01)),
    ):
        pose = look_at((0.0, 0.0, 0.0), target)
        looking = replace(camera, world_from_view=pose)
        frame = (uniform_gbuffer((16, 16), 3.0, albedo=1.0, direct=0.0), camera)
        views = [(capture(looking, [surface]), looking)]
        results[name] = light_of(frame, views, sky, rays=64, bounces=2, reflections=False)
    # The ground hands on light of the sky; the ceiling has its face to the dark half
    assert all(light.rays["views"] > 0 for light in results.values())
    bounced = {
        name: float((light.diffuse - light.environment_diffuse).sum()) for name, light in results.items()
    }
    assert bounced["ground"] > 0.0
    assert bounced["ceiling"] < 0.01 * bounced["ground"]


# Layers behind the frame's surfaces.


def post_before_a_wall() -> tuple[Camera, list[Plane]]:
    """A mirror floor, a wall that shows its x and y, and a bar that floats before it."""
    camera = Camera.perspective(48, 64, 0.9)
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), specular=1.0)
    wall = Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), source=lambda p: p + 10.0)
    bar = Plane(
        (0.0, 0.0, -3.0), (0.0, 0.0, 1.0), source=99.0, bounds=lambda p: (p[:, 1] > -0.35) & (p[:, 1] < 0.1)
    )
    return camera, [floor, wall, bar]


def test_layer_behind_answers_rays_that_pass_behind_a_foreground_object():
    camera, surfaces = post_before_a_wall()
    frame = capture(camera, surfaces, layers=2)
    y, x = np.mgrid[0:64, 0:48] + 0.5
    depth = np.where(frame.is_background, 1.0, frame.depth.astype(np.float64))
    position = camera.pixel_to_view(x, y, depth)
    direction = position / np.linalg.norm(position, axis=-1, keepdims=True) * (1.0, -1.0, 1.0)
    distance = (-6.0 - position[..., 2]) / direction[..., 2]
    point = position + distance[..., None] * direction
    at_x, at_y, _ = camera.view_to_pixel(point)
    is_floor = frame.specular[..., 0] > 0.0
    on_bar = (point[..., 1] / 6.0 > -0.35 / 3.0 + 0.02) & (point[..., 1] / 6.0 < 0.1 / 3.0 - 0.02)
    # Starts behind the bar, ends on the part of the wall that the bar hides
    hidden = is_floor & on_bar & (position[..., 2] < -3.5) & (np.abs(at_x - 24) < 20) & (at_y > 0)
    assert hidden.sum() > 50
    alone = light_of((replace(frame, behind=None), camera), diffuse=False)
    found = light_of((frame, camera), diffuse=False)
    assert (alone.known_glossy[hidden] == 0.0).all()
    assert (found.known_glossy[hidden] == 1.0).mean() >= 1.0 - MIRROR_PIXELS_OFF
    answered = hidden & (found.known_glossy == 1.0)
    np.testing.assert_allclose(
        found.glossy[answered][:, :2], point[answered][:, :2] + 10.0, atol=VIEW_HIT_UNITS
    )
    # What the front layer had answered keeps its answer, but for the next pixel beside an edge
    before = is_floor & (alone.known_glossy == 1.0)
    assert (found.known_glossy[before] == 1.0).all()
    np.testing.assert_allclose(found.glossy[before], alone.glossy[before], atol=VIEW_HIT_UNITS)


def test_layer_behind_never_shows_through_a_solid_front():
    """A ray that meets the bar's front shows the bar, whatever lies behind it."""
    camera, surfaces = post_before_a_wall()
    frame = capture(camera, surfaces, layers=2)
    found = light_of((frame, camera), diffuse=False)
    alone = light_of((replace(frame, behind=None), camera), diffuse=False)
    shows_bar = alone.glossy[..., 0] == 99.0
    assert shows_bar.sum() > 10
    np.testing.assert_array_equal(found.glossy[shows_bar], 99.0)


def test_layers_of_further_views_answer_too():
    """The view behind the camera sees a board; the wall behind the board is its second layer."""
    mirror, view = mirror_and_what_is_behind_the_camera(BACKWARDS)
    wall = Plane((0.0, 0.0, 4.0), (0.0, 0.0, 1.0), source=5.0)
    board = Plane((0.0, 0.0, 2.0), (0.0, 0.0, 1.0), source=7.0, bounds=lambda p: p[:, 0] < 0.0)
    gbuffer = capture(view[1], [wall, board], layers=2)
    light = light_of(mirror, [(gbuffer, view[1])], diffuse=False)
    assert set(np.unique(light.glossy[2:-2, 2:14])) == {7.0}
    assert set(np.unique(light.glossy[2:-2, 18:-2])) == {5.0}


@pytest.mark.parametrize(
    ("front", "thickness", "layer"),
    [(8.0, 1.2, None), (3.0, 6.0, 1), (3.0, 4.0, 0)],
    ids=["too far", "within", "past"],
)
def test_blocked_ray_takes_answers_of_other_layers_as_far_as_the_blocker_is_thick(front, thickness, layer):
    """A strip before a wall: a ray from beside it to the wall 7 units on meets the strip's side."""
    depth = np.full((3, 33), 10.0)
    depth[:, 14:19] = front
    behind = uniform_gbuffer((3, 33), 10.0)
    frame = replace(uniform_gbuffer((3, 33), depth), thickness=np.full((3, 33), thickness), behind=behind)
    camera = Camera.perspective(33, 3, 1.0)
    origin = camera.pixel_to_view(np.array([6.5]), np.array([1.5]), np.array([8.2])).T.astype(np.float32)
    target = camera.pixel_to_view(np.array([28.5]), np.array([1.5]), np.array([10.0])).T
    direction = ((target - origin) / np.linalg.norm(target - origin)).astype(np.float32)
    answers = TraceScene(frame, camera, (), Settings()).answer(origin, direction)
    nothing = 2 * depth.size
    wall = 33 + 28
    expected = (tracer.BLOCKED, nothing) if layer is None else (tracer.HIT, layer * depth.size + wall)
    assert (answers.status[0], answers.texel[0]) == expected
