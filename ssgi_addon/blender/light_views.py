# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras that look from lamps: reflective shadow maps.

After Dachsbacher and Stamminger 2005, "Reflective Shadow Maps": the first bounce starts where lamps shine,
and a lamp sees all of that. Here such a view is a G-buffer like any other, which rays are traced through.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..core import Camera
from ..core.frame_points import surface_points
from ..frame import CapturedFrame

# What an area lamp shows most of its light to: cosine-weighted, a cone of this angle holds three quarters.
_AREA_ANGLE = math.radians(120.0)
_POINT_ANGLE = math.radians(90.0)
# Blender's lamps spread wider than a plane can show.
_LARGEST_ANGLE = math.radians(140.0)
# A sun's view holds this share of the frame's surfaces.
_SHARE_IN_SUN = 0.9
_PIXELS = 1024


def light_cameras(
    view_layer: bpy.types.ViewLayer, frame: CapturedFrame, count: int, size: int
) -> list[Camera]:
    """Return what the lamps see that are strongest where the frame's surfaces are.

    Emissive meshes and the world are no lamps here.

    Parameters
    ----------
    view_layer
        The one that renders: its lamps.
    frame
        What they shall light.
    count
        Most cameras to return.
    size
        Width and height, pixels.
    """
    if not count:
        return []
    points = _surfaces(frame)
    middle = Vector(np.median(points, axis=1))
    lamps = sorted(
        _lamps(view_layer.layer_collection), key=lambda lamp: _irradiance(lamp, middle), reverse=True
    )
    return [_camera(lamp, points, middle, size) for lamp in lamps[:count] if _irradiance(lamp, middle) > 0.0]


def _lamps(collection: bpy.types.LayerCollection) -> list[bpy.types.Object]:
    """Return the lamps of a collection and of those in it that a render shows."""
    lamps = {
        item.name_full: item
        for item in collection.collection.objects
        if item.type == "LIGHT" and not item.hide_render
    }
    for child in collection.children:
        if not (child.exclude or child.collection.hide_render):
            lamps.update((lamp.name_full, lamp) for lamp in _lamps(child))
    return list(lamps.values())


def _surfaces(frame: CapturedFrame) -> np.ndarray:
    """Return some of the frame's surface points, world space, (3, N)."""
    pixel = np.flatnonzero(~frame.gbuffer.is_background)
    pixel = pixel[:: max(1, pixel.size // _PIXELS)]
    points, _ = surface_points(frame.gbuffer, frame.camera, pixel)
    pose = frame.camera.world_from_view
    return pose[:3, :3] @ points.astype(np.float64) + pose[:3, 3:]


def _irradiance(lamp: bpy.types.Object, at: Vector) -> float:
    """Return roughly what an unhidden surface there receives that faces the lamp."""
    light = lamp.data
    strength = light.energy * sum(light.color) / 3.0
    if light.type == "SUN":
        return strength
    toward = at - lamp.matrix_world.translation
    distance = max(toward.length, 1e-6)
    along = toward.dot(-lamp.matrix_world.col[2].to_3d().normalized()) / distance
    if light.type == "SPOT" and along < math.cos(0.5 * light.spot_size):
        return 0.0
    if light.type == "AREA":
        return strength * max(along, 0.0) / (math.pi * distance**2)
    return strength / (4.0 * math.pi * distance**2)


def _camera(lamp: bpy.types.Object, points: np.ndarray, middle: Vector, size: int) -> Camera:
    light, place = lamp.data, lamp.matrix_world.translation
    ahead = -lamp.matrix_world.col[2].to_3d()
    if light.type == "SUN":
        return _sun_camera(ahead, points, middle, size)
    angle = _POINT_ANGLE
    if light.type == "SPOT":
        angle = min(light.spot_size, _LARGEST_ANGLE)
    elif light.type == "AREA":
        angle = _AREA_ANGLE
    else:
        ahead = middle - place  # a point shines everywhere: look where the frame is
    return Camera.perspective(size, size, angle, world_from_view=_pose(place, ahead))


def _sun_camera(ahead: Vector, points: np.ndarray, middle: Vector, size: int) -> Camera:
    """Return a parallel view along the sunlight, as wide as the frame's surfaces spread."""
    away = points - np.array(middle)[:, None]
    radius = float(np.quantile(np.sqrt((away * away).sum(axis=0)), _SHARE_IN_SUN))
    pose = _pose(middle - ahead.normalized() * 2.0 * radius, ahead)
    return Camera.orthographic(size, size, 2.0 * radius, world_from_view=pose)


def _pose(place: Vector, ahead: Vector) -> np.ndarray:
    turn = ahead.to_track_quat("-Z", "Y").to_matrix().to_4x4()
    return np.array(Matrix.Translation(place) @ turn, dtype=np.float64)
