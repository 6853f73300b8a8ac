# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiny scenes that tests build: each function adds one scene to the current file and makes it current."""

from __future__ import annotations

import bpy

from ssgi_addon.blender.build import (
    add_ball,
    add_box,
    add_camera,
    add_lamp,
    new_material,
    new_world,
)

WHITE, RED, GREEN, BLACK = (0.75, 0.75, 0.75), (0.7, 0.1, 0.08), (0.1, 0.5, 0.12), (0.0, 0.0, 0.0)
LAMPLIGHT = (1.0, 1.0, 1.0)


def build_closed_room() -> bpy.types.Scene:
    """A room without openings: one lamp, a red and a green wall, a white block. The camera is inside."""
    scene = new_scene("Closed Room")
    _add_room(scene)
    lamp = add_lamp(scene, "Lamp", "POINT", (0.0, 0.3, 2.3), (0.0, 0.3, 0.0), energy=60.0, color=LAMPLIGHT)
    lamp.data.shadow_soft_size = 0.15
    return scene


def build_moving_room(frames: int = 3) -> bpy.types.Scene:
    """A room in which the camera moves from frame 1 to the last: frames differ."""
    scene = build_closed_room()
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x += 0.5
    scene.camera.keyframe_insert("location", frame=frames)
    return scene


def build_emissive_room() -> bpy.types.Scene:
    """The closed room lit by a glowing mesh in view instead of a lamp."""
    scene = new_scene("Emissive Room")
    _add_room(scene)
    glow = new_material("Glow", (1.0, 0.85, 0.6), emission=12.0)
    add_box(scene, "Glowing Panel", glow, (-0.5, 0.4, 2.85), (0.5, 1.4, 2.9))
    return scene


def build_open_field() -> bpy.types.Scene:
    """A ball on endless ground under an even sky, without lamps."""
    scene = new_scene("Open Field")
    scene.world = new_world("Sky", (0.8, 0.9, 1.0), 1.0)
    ground = new_material("Ground", (0.5, 0.4, 0.3), roughness=1.0, specular=0.0)
    add_box(scene, "Ground", ground, (-500.0, -500.0, -1.0), (500.0, 500.0, 0.0))
    add_ball(scene, "Ball", new_material("Ball", WHITE, roughness=1.0, specular=0.0), (0.0, 1.0, 0.8), 0.8)
    add_camera(scene, (0.0, -4.0, 1.5), (0.0, 1.0, 0.7), lens=30.0)
    return scene


def build_mirror_floor() -> bpy.types.Scene:
    """A red wall that stands on a mirror and touches it, in sunlight."""
    scene = new_scene("Mirror Floor")
    mirror = new_material("Mirror", (1.0, 1.0, 1.0), roughness=0.0, metallic=1.0)
    wall = new_material("Wall", RED, roughness=1.0, specular=0.0)
    add_box(scene, "Floor", mirror, (-5.0, -5.0, -0.2), (5.0, 5.0, 0.0))
    add_box(scene, "Wall", wall, (-5.0, 2.0, 0.0), (5.0, 2.2, 0.8))
    _add_sun(scene)
    add_camera(scene, (0.0, -4.0, 1.2), (0.0, 2.0, 0.4), lens=32.0)
    return scene


def build_ball_over_plane() -> bpy.types.Scene:
    """A red ball that floats close above a white plane, in sunlight: the plane reddens beneath it."""
    scene = new_scene("Ball over Plane")
    white = new_material("Plane", WHITE, roughness=1.0, specular=0.0)
    red = new_material("Ball", RED, roughness=1.0, specular=0.0)
    add_box(scene, "Plane", white, (-20.0, -20.0, -0.2), (20.0, 20.0, 0.0))
    add_ball(scene, "Ball", red, (0.0, 0.0, 0.75), 0.6)
    _add_sun(scene)
    add_camera(scene, (0.0, -4.0, 1.6), (0.0, 0.0, 0.5), lens=38.0)
    return scene


def new_scene(name: str) -> bpy.types.Scene:
    """An empty scene under a black world, set to few and honest samples of a small frame."""
    scene = bpy.data.scenes.new(name)
    scene.world = new_world("Black", BLACK, 0.0)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 64, 36
    scene.cycles.samples = 16
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.sample_clamp_indirect = 0.0
    scene.view_settings.view_transform = "Standard"
    bpy.context.window.scene = scene
    return scene


def _add_room(scene: bpy.types.Scene) -> None:
    """Six walls around x and z in -2..2 and 0..3, a block, and the camera inside."""
    plaster = new_material("Plaster", WHITE, roughness=1.0, specular=0.0)
    red = new_material("Red", RED, roughness=1.0, specular=0.0)
    green = new_material("Green", GREEN, roughness=1.0, specular=0.0)
    for name, material, low, high in (
        ("Floor", plaster, (-2.2, -2.7, -0.2), (2.2, 2.2, 0.0)),
        ("Ceiling", plaster, (-2.2, -2.7, 3.0), (2.2, 2.2, 3.2)),
        ("Back", plaster, (-2.2, 2.0, 0.0), (2.2, 2.2, 3.0)),
        ("Front", plaster, (-2.2, -2.7, 0.0), (2.2, -2.5, 3.0)),
        ("Left", red, (-2.2, -2.5, 0.0), (-2.0, 2.0, 3.0)),
        ("Right", green, (2.0, -2.5, 0.0), (2.2, 2.0, 3.0)),
        ("Block", plaster, (-0.9, 0.5, 0.0), (0.1, 1.4, 1.1)),
    ):
        add_box(scene, name, material, low, high)
    add_camera(scene, (0.0, -2.4, 1.5), (0.0, 2.0, 1.4), lens=20.0)


def _add_sun(scene: bpy.types.Scene) -> None:
    sun = add_lamp(scene, "Sun", "SUN", (-2.0, -4.0, 5.0), (0.0, 0.0, 0.0), energy=3.0, color=LAMPLIGHT)
    sun.data.angle = 0.05
