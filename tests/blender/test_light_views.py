# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras that look from lamps: which lamps, in which order, and what their cameras see."""

from __future__ import annotations

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Vector

from ssgi_addon.blender.build import add_box, add_camera, add_lamp, new_material
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.light_views import _irradiance, light_cameras
from tests.scenes import LAMPLIGHT, WHITE
from tests.tolerances import LAMP_IRRADIANCE, UNIT_NORMAL

UP = (0.0, 0.0, 4.0)
KINDS = ("SPOT", "AREA", "POINT", "SUN")


@pytest.fixture
def floor(empty_file):
    """A floor seen from above; its middle is the world's origin."""
    empty_file.render.resolution_x = empty_file.render.resolution_y = 16
    add_box(empty_file, "Floor", new_material("Clay", WHITE, specular=0.0), (-9, -9, -1), (9, 9, 0))
    add_camera(empty_file, (0.0, 0.0, 2.0), (0.0, 0.0, 0.0), lens=36.0)
    return empty_file


def lamp_of(scene, kind, place=UP, target=(0.0, 0.0, 0.0), energy=100.0):
    lamp = add_lamp(scene, kind, kind, place, target, energy=energy, color=LAMPLIGHT)
    bpy.context.view_layer.update()
    return lamp


def cameras_of(scene, count=8, size=32):
    frame = capture_frame(scene, CaptureOptions(samples=1, denoiser="none"))
    return light_cameras(scene.view_layers[0], frame, count, size)


def pixels_of(camera, points):
    pose = np.linalg.inv(camera.world_from_view)
    return camera.view_to_pixel(np.asarray(points) @ pose[:3, :3].T + pose[:3, 3])


@pytest.mark.parametrize("kind", KINDS)
def test_a_lamps_camera_looks_where_it_shines(floor, kind):
    lamp_of(floor, kind, place=(1.0, -2.0, 3.0))
    (camera,) = cameras_of(floor)
    assert (camera.width, camera.height) == (32, 32)
    assert camera.is_orthographic == (kind == "SUN")
    rotation = camera.world_from_view[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=UNIT_NORMAL)
    if kind != "SUN":
        np.testing.assert_allclose(camera.world_from_view[:3, 3], (1.0, -2.0, 3.0), atol=UNIT_NORMAL)
    x, y, depth = pixels_of(camera, [(0.0, 0.0, 0.0)])
    assert depth > 0.0
    # Where the frame's surfaces are is about the middle; the frame shows as much to each side
    np.testing.assert_allclose((x, y), 16.0, atol=1.0)


@pytest.mark.parametrize("degrees", [20.0, 75.0, 170.0])
def test_a_spots_camera_holds_its_cone(floor, degrees):
    lamp_of(floor, "SPOT").data.spot_size = math.radians(degrees)
    (camera,) = cameras_of(floor)
    angle = 2.0 * math.atan(0.5 * camera.width / camera.fx)
    assert angle == pytest.approx(min(math.radians(degrees), math.radians(140.0)), rel=UNIT_NORMAL)


def test_a_suns_camera_holds_most_of_what_the_frame_shows(floor):
    lamp_of(floor, "SUN", place=(3.0, 0.0, 3.0), energy=2.0)
    frame = capture_frame(floor, CaptureOptions(samples=1, denoiser="none"))
    (camera,) = light_cameras(floor.view_layers[0], frame, 1, 32)
    y, x = np.mgrid[0:16, 0:16] + 0.5
    points = frame.camera.pixel_to_view(x, y, frame.gbuffer.depth).reshape(-1, 3)
    pose = frame.camera.world_from_view
    x, y, depth = pixels_of(camera, points @ pose[:3, :3].T + pose[:3, 3])
    assert (depth > 0.0).all()
    assert ((x > 0) & (x < 32) & (y > 0) & (y < 32)).mean() >= 0.9


@pytest.mark.parametrize("scale", [(1, 1, 1), (3, 3, 3), (1, 2, 0.5)])
def test_scale_of_a_lamp_does_not_turn_its_camera(floor, scale):
    lamp_of(floor, "SPOT", place=(1.0, 0.0, 3.0)).scale = scale
    bpy.context.view_layer.update()
    (camera,) = cameras_of(floor)
    toward = np.array((-1.0, 0.0, -3.0)) / math.sqrt(10.0)
    np.testing.assert_allclose(-camera.world_from_view[:3, 2], toward, atol=UNIT_NORMAL)
    assert np.linalg.det(camera.world_from_view[:3, :3]) == pytest.approx(1.0, rel=UNIT_NORMAL)


def test_strongest_lamps_come_first_and_only_as_many_as_asked_for(floor):
    for index, energy in enumerate((10.0, 1000.0, 100.0)):
        lamp_of(floor, "POINT", place=(0.1 * index, 0.0, 3.0), energy=energy)
    places = [camera.world_from_view[0, 3] for camera in cameras_of(floor)]
    np.testing.assert_allclose(places, (0.1, 0.2, 0.0), atol=UNIT_NORMAL)
    assert len(cameras_of(floor, count=2)) == 2
    assert cameras_of(floor, count=0) == []


def hide(lamp):
    lamp.hide_render = True


def hide_its_collection(lamp):
    own = bpy.data.collections.new("Lamps")
    bpy.context.scene.collection.children.link(own)
    bpy.context.scene.collection.objects.unlink(lamp)
    own.objects.link(lamp)
    own.hide_render = True


def exclude_its_collection(lamp):
    hide_its_collection(lamp)
    bpy.data.collections["Lamps"].hide_render = False
    bpy.context.view_layer.layer_collection.children["Lamps"].exclude = True


def switch_off(lamp):
    lamp.data.energy = 0.0


def aim_elsewhere(lamp):
    lamp.rotation_euler = (math.pi, 0.0, 0.0)


@pytest.mark.parametrize(
    "change", [hide, hide_its_collection, exclude_its_collection, switch_off, aim_elsewhere]
)
def test_lamps_that_light_nothing_of_the_frame_are_left_out(floor, change):
    lamp = lamp_of(floor, "SPOT")
    assert len(cameras_of(floor)) == 1
    change(lamp)
    bpy.context.view_layer.update()
    assert cameras_of(floor) == []


@pytest.mark.parametrize("kind", KINDS)
def test_strength_of_a_lamp_is_what_a_surface_receives_from_it(floor, kind):
    """Or lamps of two kinds would come in the wrong order. Straight below each lamp, by Cycles."""
    lamp = lamp_of(floor, kind, energy=50.0)
    lamp.data.use_shadow = False
    if kind == "AREA":
        lamp.data.size = 0.2
    frame = capture_frame(floor, CaptureOptions(samples=64, denoiser="none"))
    received = np.pi * frame.gbuffer.direct[7:9, 7:9].mean() / WHITE[0]
    assert _irradiance(lamp, Vector((0.0, 0.0, 0.0))) == pytest.approx(float(received), rel=LAMP_IRRADIANCE)
