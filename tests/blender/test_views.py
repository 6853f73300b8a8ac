# SPDX-License-Identifier: GPL-3.0-or-later
"""Views beyond the frame: a render shows exactly what a camera of the core sees."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Vector

from ssgi_addon.blender.build import add_ball
from ssgi_addon.blender.engines import engine_named
from ssgi_addon.blender.render_settings import borrow_scene
from ssgi_addon.blender.restore import Restorer
from ssgi_addon.blender.views import capture_views
from ssgi_addon.core import Camera
from ssgi_addon.view_cameras import overscan_camera
from tests.blender.fingerprint import changes, fingerprint
from tests.core.synthetic import look_at
from tests.scenes import WHITE, build_closed_room, new_material
from tests.tolerances import REPROJECTED_PX, SURROUND_DEPTH, UNIT_NORMAL

# +Y up in `look_at`; Blender's room has its floor in the plane of X and Y.
ASKEW = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]) @ look_at(
    (0.4, 1.6, 1.0), (-0.5, 0.6, -1.0)
)
CAMERAS = {
    "perspective": Camera.perspective(16, 12, 1.1, world_from_view=ASKEW),
    "shifted": Camera.perspective(16, 12, 1.1, shift_px=(3.0, -2.0), world_from_view=ASKEW),
    "tall": Camera.perspective(9, 20, 0.6, shift_px=(-2.0, 4.0), world_from_view=ASKEW),
    "parallel": Camera.orthographic(16, 12, 1.4, world_from_view=ASKEW),
    "parallel and shifted": Camera.orthographic(10, 13, 1.2, shift_px=(2.0, 3.0), world_from_view=ASKEW),
    "overscan": overscan_camera(
        Camera.perspective(20, 9, 0.7, shift_px=(1.0, -2.0), pixel_aspect=0.8, world_from_view=ASKEW), 1.5
    ),
}


@pytest.fixture
def room(empty_file):
    scene = build_closed_room()
    add_ball(scene, "Ball", new_material("Clay", WHITE), (-0.6, 0.4, 0.6), 0.4)
    # None of this is the views' own
    scene.camera.data.shift_x, scene.render.pixel_aspect_y = 0.3, 1.6
    scene.render.use_border, scene.render.border_max_x = True, 0.5
    return scene


def captured(scene, cameras, engine="cycles"):
    engine = engine_named(engine)
    with Restorer() as restorer:
        view_layer = borrow_scene(
            restorer, scene, resolution=None, frame=None, view_layer=None, engine_id=engine.engine_id()
        )
        engine.borrow_scene(restorer, scene, view_layer)
        views, _ = capture_views(
            engine, scene, view_layer, cameras, samples=1, denoiser="none", progress=lambda _: None
        )
    return views


def assert_same_camera(found, expected):
    assert (found.width, found.height) == (expected.width, expected.height)
    assert found.is_orthographic == expected.is_orthographic
    np.testing.assert_allclose(found.world_from_view, expected.world_from_view, atol=UNIT_NORMAL)
    # The corners of the picture lie where they did
    x, y = np.meshgrid([0.0, expected.width], [0.0, expected.height])
    found_x, found_y, _ = found.view_to_pixel(expected.pixel_to_view(x, y, np.full_like(x, 2.0)))
    np.testing.assert_allclose(found_x, x, atol=REPROJECTED_PX)
    np.testing.assert_allclose(found_y, y, atol=REPROJECTED_PX)


def first_hits(scene, camera):
    """Return the depth (H, W) of what rays through the pixels' centres meet, by Blender's own ray cast."""
    depsgraph, pose = bpy.context.evaluated_depsgraph_get(), camera.world_from_view
    depth = np.full((camera.height, camera.width), np.inf)
    for row, column in np.ndindex(depth.shape):
        near, far = (camera.pixel_to_view(column + 0.5, row + 0.5, z) for z in (0.0, 1.0))
        begin = pose[:3, :3] @ near + pose[:3, 3]
        direction = pose[:3, :3] @ (far - near)
        is_hit, place, *_ = scene.ray_cast(depsgraph, Vector(begin), Vector(direction))
        if is_hit:
            depth[row, column] = np.linalg.norm(np.array(place) - begin) / np.linalg.norm(direction)
    return depth


@pytest.mark.parametrize("name", CAMERAS)
def test_a_view_is_rendered_by_exactly_the_camera_that_was_given(room, name):
    camera = CAMERAS[name]
    ((gbuffer, found),) = captured(room, [camera])
    assert_same_camera(found, camera)
    expected = first_hits(room, camera)
    assert np.isfinite(expected).all()
    is_near = np.isclose(gbuffer.depth, expected, rtol=SURROUND_DEPTH)
    assert is_near.mean() > 0.98  # the ball's rim may lie on either side of a sample


def test_cameras_of_all_sizes_and_kinds_take_turns_and_leave_nothing(room):
    cameras = list(CAMERAS.values())
    before = fingerprint()
    views = captured(room, cameras)
    assert changes(before, fingerprint()) == {}
    for (gbuffer, found), camera in zip(views, cameras, strict=True):
        assert gbuffer.shape == (camera.height, camera.width)
        assert_same_camera(found, camera)
