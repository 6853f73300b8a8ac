# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene: a reading corner in evening sun, where most of the light is bounced light."""

from __future__ import annotations

import itertools
import math

import bmesh
import bpy

from .build import add_box, add_camera, add_lamp, add_mesh, new_material, new_world
from .demo_furniture import furnish

# The room, in metres: x from the red wall to the window wall, y from the camera's end to the back wall
_LEFT, _RIGHT = -2.2, 2.2
_FRONT, _BACK = -3.4, 2.3
_HEIGHT = 2.75
_WALL = 0.16
# The window's opening in the right wall
_WINDOW_Y = (-0.75, 1.25)
_WINDOW_Z = (0.45, 2.35)


def build_demo_scene() -> bpy.types.Scene:
    """Add the demo scene to the current file, ready to render with Cycles at 960 × 540.

    Low sun comes through the window and strikes the red wall, the floor and the chair, all in the
    camera's view; the rest of the room lives on what these hand on: bounces bring three quarters of the
    light of the median pixel.

    Returns
    -------
    bpy.types.Scene
        A new scene; scenes that the file already holds stay as they are.
    """
    scene = bpy.data.scenes.new("SSGI Demo")
    _set_up_render(scene)
    _build_room(scene)
    _build_window(scene)
    _build_daylight(scene)
    furnish(scene, left=_LEFT, back=_BACK, height=_HEIGHT)
    add_camera(scene, (1.28, -2.85, 1.22), (-0.60, 1.6, 0.92), lens=24.0)
    return scene


def _set_up_render(scene: bpy.types.Scene) -> None:
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 960, 540, 100
    scene.cycles.samples = 64
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.sample_clamp_indirect = 0.0
    scene.cycles.caustics_reflective = False
    scene.cycles.caustics_refractive = False
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = 0.3


def _build_room(scene: bpy.types.Scene) -> None:
    plaster = new_material("Plaster", (0.80, 0.78, 0.74), roughness=0.9, specular=0.2)
    red = new_material("Red Wall", (0.72, 0.13, 0.055), roughness=0.85, specular=0.2)
    green = new_material("Green Wall", (0.10, 0.30, 0.22), roughness=0.85, specular=0.2)
    wood = new_material("White Wood", (0.82, 0.81, 0.78), roughness=0.4)

    left, right, front, back = _LEFT - _WALL, _RIGHT + _WALL, _FRONT - _WALL, _BACK + _WALL
    add_box(scene, "Floor", _floor_material(), (left, front, -_WALL), (right, back, 0.0))
    add_box(scene, "Ceiling", plaster, (left, front, _HEIGHT), (right, back, _HEIGHT + _WALL))
    add_box(scene, "Back Wall", plaster, (left, _BACK, 0.0), (right, back, _HEIGHT))
    add_box(scene, "Front Wall", plaster, (left, front, 0.0), (right, _FRONT, _HEIGHT))
    add_box(scene, "Left Wall", red, (left, _FRONT, 0.0), (_LEFT, _BACK, _HEIGHT))
    for name, low, high in (
        ("Front", (_FRONT, 0.0), (_WINDOW_Y[0], _HEIGHT)),
        ("Back", (_WINDOW_Y[1], 0.0), (_BACK, _HEIGHT)),
        ("Below", (_WINDOW_Y[0], 0.0), (_WINDOW_Y[1], _WINDOW_Z[0])),
        ("Above", (_WINDOW_Y[0], _WINDOW_Z[1]), (_WINDOW_Y[1], _HEIGHT)),
    ):
        add_box(scene, f"Right Wall {name}", green, (_RIGHT, *low), (right, *high))

    add_box(scene, "Skirting Left", wood, (_LEFT, _FRONT, 0.0), (_LEFT + 0.018, _BACK, 0.1), bevel=0.004)
    add_box(scene, "Skirting Back", wood, (_LEFT, _BACK - 0.018, 0.0), (_RIGHT, _BACK, 0.1), bevel=0.004)


def _floor_material() -> bpy.types.Material:
    """Polished planks: a brick pattern of two browns with thin dark joints."""
    material = new_material("Polished Planks", (0.35, 0.2, 0.1), roughness=0.16)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    planks = nodes.new("ShaderNodeTexBrick")
    planks.offset_frequency = 2
    planks.offset = 0.37
    for name, value in (
        ("Color1", (0.30, 0.165, 0.085, 1.0)),
        ("Color2", (0.42, 0.25, 0.135, 1.0)),
        ("Mortar", (0.10, 0.05, 0.025, 1.0)),
        ("Scale", 1.0),
        ("Mortar Size", 0.003),
        ("Mortar Smooth", 0.2),
        ("Brick Width", 1.3),
        ("Row Height", 0.155),
    ):
        planks.inputs[name].default_value = value
    place = nodes.new("ShaderNodeTexCoord")
    links.new(place.outputs["Object"], planks.inputs["Vector"])
    links.new(planks.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return material


def _build_window(scene: bpy.types.Scene) -> None:
    paint = new_material("Window Paint", (0.85, 0.85, 0.83), roughness=0.35)
    (near, far), (low, high) = _WINDOW_Y, _WINDOW_Z
    x0, x1 = _RIGHT + 0.05, _RIGHT + 0.11
    sill_low, sill_high = (_RIGHT - 0.12, near - 0.06, low - 0.04), (x1, far + 0.06, low)
    add_box(scene, "Window Sill", paint, sill_low, sill_high, bevel=0.008)
    for position in (near, (near + far) / 2, far):
        y = min(max(position, near + 0.03), far - 0.03)
        add_box(scene, "Window Post", paint, (x0, y - 0.03, low), (x1, y + 0.03, high), bevel=0.006)
    for position in (low, low + 0.68 * (high - low), high):
        z = min(max(position, low + 0.03), high - 0.03)
        add_box(scene, "Window Rail", paint, (x0, near, z - 0.025), (x1, far, z + 0.025), bevel=0.006)
    _build_curtain(scene, far - 0.08, far + 0.62)


def _build_curtain(scene: bpy.types.Scene, start: float, end: float) -> None:
    linen = new_material("Linen", (0.78, 0.66, 0.46), roughness=0.95, specular=0.1)

    def shape(builder: bmesh.types.BMesh) -> None:
        columns = []
        for step in range(97):
            y = start + (end - start) * step / 96
            x = _RIGHT - 0.13 + 0.045 * math.sin(step * 0.62) + 0.012 * math.sin(step * 1.7)
            columns.append([builder.verts.new((x, y, z)) for z in (0.03, _HEIGHT - 0.12)])
        for (low0, high0), (low1, high1) in itertools.pairwise(columns):
            builder.faces.new((low0, low1, high1, high0))

    add_mesh(scene, "Curtain", linen, shape, smooth=True)


def _build_daylight(scene: bpy.types.Scene) -> None:
    scene.world = new_world("Evening Sky", (0.55, 0.72, 1.0), 1.2)
    sun = add_lamp(
        scene, "Evening Sun", "SUN", (6.0, -0.6, 2.6), (0.0, 0.45, 0.25), energy=22.0, color=(1.0, 0.80, 0.56)
    )
    sun.data.angle = math.radians(0.8)
    middle = (sum(_WINDOW_Y) / 2, sum(_WINDOW_Z) / 2)
    sky = add_lamp(
        scene,
        "Window Skylight",
        "AREA",
        (_RIGHT + 0.2, *middle),
        (_LEFT, middle[0], middle[1] - 0.6),
        energy=22.0,
        color=(0.62, 0.78, 1.0),
    )
    sky.data.shape = "RECTANGLE"
    sky.data.size = _WINDOW_Y[1] - _WINDOW_Y[0]
    sky.data.size_y = _WINDOW_Z[1] - _WINDOW_Z[0]
    sky.visible_camera = False
