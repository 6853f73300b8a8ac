# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes of the pictures in ``docs/reflections.md``, built in Python.

Everything that is reflected is diffuse and lit by lamps: Cycles counts the reflections of lamps, of what
glows and of the world as direct light, and they would be no work of ours.
"""

from __future__ import annotations

import math

import bpy

from ssgi_addon.blender.build import (
    add_ball,
    add_box,
    add_camera,
    add_lamp,
    add_rod,
    new_material,
    new_world,
    node_tree,
)

STRIPS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.8)  # roughness, from the left
_STRIP_WIDTH = 0.8
_METAL = (0.62, 0.62, 0.64)
_RED, _GREEN, _BLUE = (0.75, 0.09, 0.05), (0.10, 0.50, 0.16), (0.07, 0.20, 0.65)
_YELLOW, _WHITE, _ORANGE = (0.80, 0.58, 0.07), (0.85, 0.85, 0.85), (0.80, 0.28, 0.04)


def build_strips(metallic: float = 1.0) -> bpy.types.Scene:
    """A metal floor in strips of growing roughness, a coloured post at the end of each, before a wall."""
    scene = _new_scene("Strips")
    left = -0.5 * len(STRIPS) * _STRIP_WIDTH
    colors = (_RED, _GREEN, _YELLOW, _BLUE, _ORANGE, _WHITE)
    for number, (roughness, color) in enumerate(zip(STRIPS, colors, strict=True)):
        x = left + number * _STRIP_WIDTH
        metal = new_material(f"Roughness {roughness}", _METAL, roughness=roughness, metallic=metallic)
        add_box(scene, "Strip", metal, (x, -4.0, -0.1), (x + _STRIP_WIDTH, 2.0, 0.0))
        paint = _paint(f"Post {number}", color)
        middle = x + 0.5 * _STRIP_WIDTH
        add_box(scene, "Post", paint, (middle - 0.16, 0.6, 0.0), (middle + 0.16, 0.9, 1.25))
    add_box(scene, "Wall", _paint("Wall", (0.16, 0.19, 0.24)), (-4.0, 2.0, -0.1), (4.0, 2.1, 2.6))
    _light(scene, (-3.0, -3.5, 3.6), (0.0, 1.4, 0.5), 500.0)
    _light(scene, (3.5, -3.0, 3.2), (0.0, 1.4, 0.5), 250.0)
    add_camera(scene, (0.0, -4.3, 1.15), (0.0, 0.6, 0.42), lens=30.0)
    return scene


def build_varnished_strips() -> bpy.types.Scene:
    """The same strips of paint beneath a clear varnish."""
    return build_strips(metallic=0.0)


def build_night_road() -> bpy.types.Scene:
    """A wet road at a low view, and brightly lit balls over its far end."""
    scene = _new_scene("Night Road")
    road = new_material("Wet Road", (0.55, 0.56, 0.60), roughness=0.3, metallic=1.0)
    add_box(scene, "Road", road, (-6.0, -6.0, -0.1), (6.0, 8.0, 0.0))
    add_box(scene, "Night", _paint("Night", (0.012, 0.014, 0.02)), (-9.0, 8.0, -0.1), (9.0, 8.1, 6.0))
    for number, color in enumerate((_RED, _WHITE, _GREEN, _YELLOW, _BLUE)):
        x = 1.1 * (number - 2)
        add_ball(scene, "Ball", _paint(f"Ball {number}", color), (x, 4.0, 0.75 + 0.12 * (number % 2)), 0.17)
    lamp = _light(scene, (0.0, -3.0, 3.0), (0.0, 4.0, 0.8), 2500.0)
    lamp.data.spot_size = math.radians(50.0)
    add_camera(scene, (0.0, -3.4, 0.42), (0.0, 4.0, 0.20), lens=48.0)
    return scene


def build_room() -> bpy.types.Scene:
    """A room with a patterned floor, a mirror, thin rods, a shelf that floats, and posts beyond the frame."""
    scene = _new_scene("Room")
    add_box(scene, "Floor", _patterned_floor(), (-4.0, -4.0, -0.1), (1.0, 3.0, 0.0))
    add_box(scene, "Waves", _wavy_floor(), (1.0, -4.0, -0.1), (4.0, 3.0, 0.0))
    add_box(
        scene,
        "Wall",
        _chequered_paint("Stripes", (0.30, 0.34, 0.40), (0.12, 0.14, 0.19), (2.5, 0.0, 0.0)),
        (-4.0, 3.0, -0.1),
        (4.0, 3.1, 3.2),
    )
    for name, color, low, high in (
        ("Red Block", _RED, (-2.55, 0.3, 0.0), (-1.95, 0.9, 0.55)),
        ("Blue Block", _BLUE, (-1.35, 1.3, 0.0), (-0.75, 1.9, 1.0)),
        ("Yellow Block", _YELLOW, (1.35, 0.6, 0.0), (1.95, 1.2, 0.45)),
        ("Green Block", _GREEN, (2.2, 1.6, 0.0), (2.8, 2.2, 1.3)),
        ("Tall Post", _ORANGE, (-3.2, 2.0, 0.0), (-2.85, 2.35, 3.0)),
        ("Shelf", _WHITE, (-0.45, 0.2, 0.45), (0.75, 0.9, 0.62)),
    ):
        add_box(scene, name, _paint(name, color), low, high)
    add_ball(scene, "Ball", _paint("Ball", _ORANGE), (-0.9, -0.5, 0.22), 0.22)
    chrome = new_material("Chrome", (0.9, 0.9, 0.9), roughness=0.0, metallic=1.0)
    add_ball(scene, "Chrome Ball", chrome, (1.0, -0.7, 0.3), 0.3)
    rod = _paint("Rods", _WHITE)
    for x in (-1.75, -1.55, 0.95, 1.1):
        add_rod(scene, "Rod", rod, (x, 0.15, 0.0), (x, 0.15, 1.5), 0.02)
    _light(scene, (-3.0, -4.0, 3.4), (0.0, 1.6, 0.4), 620.0)
    _light(scene, (3.4, -3.4, 3.0), (0.0, 1.6, 0.4), 320.0)
    add_camera(scene, (0.0, -4.6, 1.35), (0.0, 0.8, 0.42), lens=31.0)
    return scene


def build_checks() -> bpy.types.Scene:
    """A wall of small slanted squares that stands on a floor, a mirror at the left and rough at the right."""
    scene = _new_scene("Checks")
    for name, roughness, low, high in (("Mirror", 0.02, -4.0, 0.0), ("Rough", 0.35, 0.0, 4.0)):
        metal = new_material(name, (0.9, 0.9, 0.9), roughness=roughness, metallic=1.0)
        add_box(scene, name, metal, (low, -4.0, -0.1), (high, 1.5, 0.0))
    checks = _chequered_paint("Checks", (0.80, 0.52, 0.20), (0.03, 0.07, 0.16), (6.0, 6.0, 6.0), 0.35)
    add_box(scene, "Wall", checks, (-6.0, 1.5, -0.1), (6.0, 1.6, 5.0))
    _light(scene, (-2.5, -3.0, 3.4), (0.0, 1.5, 0.8), 500.0)
    _light(scene, (2.5, -3.0, 3.4), (0.0, 1.5, 0.8), 500.0)
    add_camera(scene, (0.0, -3.0, 0.9), (0.0, 1.5, 0.45), lens=28.0)
    return scene


def build_hidden() -> bpy.types.Scene:
    """A bar that floats before the camera and hides what the rough floor reflects of a bright wall."""
    scene = _new_scene("Hidden")
    metal = new_material("Floor", (0.9, 0.9, 0.9), roughness=0.3, metallic=1.0)
    add_box(scene, "Floor", metal, (-4.0, -4.0, -0.1), (4.0, 1.5, 0.0))
    add_box(scene, "Wall", _paint("Wall", (0.80, 0.52, 0.20)), (-6.0, 1.5, -0.1), (6.0, 1.6, 5.0))
    add_box(scene, "Bar", _paint("Bar", _BLUE), (-0.45, -1.2, 0.62), (0.45, -1.1, 0.78))
    _light(scene, (-2.5, -3.0, 3.4), (0.0, 1.5, 0.8), 500.0)
    _light(scene, (2.5, -3.0, 3.4), (0.0, 1.5, 0.8), 500.0)
    add_camera(scene, (0.0, -3.0, 0.9), (0.0, 1.5, 0.45), lens=28.0)
    return scene


def build_corner() -> bpy.types.Scene:
    """Paint alone: blocks, a ball and rods in a corner before a red wall, for ``docs/diffuse.md``."""
    scene = _new_scene("Corner")
    for name, color, low, high in (
        ("Floor", _WHITE, (-3.0, -4.0, -0.1), (3.0, 2.0, 0.0)),
        ("Wall", _WHITE, (-3.0, 2.0, -0.1), (3.0, 2.1, 3.0)),
        ("Red Wall", _RED, (-2.1, -4.0, -0.1), (-2.0, 2.0, 3.0)),
        ("Green Block", _GREEN, (0.6, 0.5, 0.0), (1.4, 1.3, 0.9)),
        ("Shelf", _YELLOW, (-1.6, 1.0, 0.7), (-0.2, 1.7, 0.8)),
    ):
        add_box(scene, name, _paint(name, color), low, high)
    add_ball(scene, "Ball", _paint("Ball", _WHITE), (-0.5, -0.2, 0.4), 0.4)
    for x in (1.7, 1.9):
        add_rod(scene, "Rod", _paint("Rod", _BLUE), (x, 0.2, 0.0), (x, 0.2, 1.6), 0.03)
    _light(scene, (2.6, -3.6, 3.4), (-1.0, 1.0, 0.4), 700.0)
    add_camera(scene, (0.3, -4.2, 1.9), (0.0, 0.6, 0.6), lens=31.0)
    return scene


def build_mirror_room() -> bpy.types.Scene:
    """A mirror and a glossy floor that show what is behind the camera, for ``docs/beyond_the_frame.md``."""
    scene = _new_scene("Mirror Room")
    mirror = new_material("Mirror", (0.9, 0.9, 0.9), roughness=0.0, metallic=1.0)
    floor = new_material("Glossy Floor", (0.5, 0.5, 0.52), roughness=0.15, metallic=1.0)
    checks = _chequered_paint("Checks", (0.80, 0.52, 0.20), (0.10, 0.16, 0.30), (1.5, 1.5, 1.5))
    white = _paint("White", _WHITE)
    for name, material, low, high in (
        ("Floor", floor, (-4.0, -6.0, -0.1), (4.0, 3.0, 0.0)),
        ("Ceiling", white, (-4.0, -6.0, 4.0), (4.0, 3.0, 4.1)),
        ("Wall", white, (-4.0, 3.0, 0.0), (4.0, 3.1, 4.0)),
        ("Left Wall", _paint("Left", (0.35, 0.45, 0.50)), (-4.1, -6.0, 0.0), (-4.0, 3.0, 4.0)),
        ("Right Wall", _paint("Right", (0.50, 0.42, 0.35)), (4.0, -6.0, 0.0), (4.1, 3.0, 4.0)),
        ("Wall Behind", checks, (-4.0, -6.1, 0.0), (4.0, -6.0, 4.0)),
        ("Mirror", mirror, (-1.9, 2.9, 0.15), (1.9, 3.0, 2.2)),
        ("Red Post", _paint("Red", _RED), (-1.6, -4.2, 0.0), (-1.1, -3.7, 2.2)),
        ("Blue Post", _paint("Blue", _BLUE), (1.3, -4.6, 0.0), (1.9, -4.0, 1.6)),
        ("Green Block", _paint("Green", _GREEN), (2.4, 0.2, 0.0), (3.2, 1.0, 1.2)),
        ("Yellow Front", _paint("Yellow", _YELLOW), (-1.15, 0.6, 0.0), (-0.55, 0.8, 1.0)),
        ("Red Back", _paint("Red Back", _RED), (-1.15, 0.8, 0.0), (-0.55, 0.85, 1.0)),
    ):
        add_box(scene, name, material, low, high)
    add_ball(scene, "Ball", _paint("Orange", _ORANGE), (0.6, -3.6, 0.5), 0.5)
    _light(scene, (-2.0, 2.4, 3.7), (0.0, -5.0, 0.8), 1400.0)
    _light(scene, (2.4, -5.0, 3.7), (0.0, 2.0, 0.8), 1200.0)
    add_camera(scene, (0.0, -2.2, 1.35), (0.0, 3.0, 0.8), lens=26.0)
    return scene


def build_hidden_light() -> bpy.types.Scene:
    """A room that is lit by what a lamp strikes behind a counter, for ``docs/beyond_the_frame.md``."""
    scene = _new_scene("Hidden Light")
    white = _paint("White", _WHITE)
    for name, material, low, high in (
        ("Floor", white, (-3.0, -4.5, -0.1), (3.0, 3.0, 0.0)),
        ("Orange Floor", _paint("Orange", _ORANGE), (-1.9, 0.6, 0.0), (1.9, 2.0, 0.01)),
        ("Ceiling", white, (-3.0, -4.5, 2.6), (3.0, 3.0, 2.7)),
        ("Wall", white, (-3.0, 3.0, 0.0), (3.0, 3.1, 2.6)),
        ("Left Wall", white, (-3.1, -4.5, 0.0), (-3.0, 3.0, 2.6)),
        ("Right Wall", _paint("Blue", _BLUE), (3.0, -4.5, 0.0), (3.1, 3.0, 2.6)),
        ("Wall Behind", white, (-3.0, -4.6, 0.0), (3.0, -4.5, 2.6)),
        ("Counter", _paint("Counter", (0.45, 0.45, 0.45)), (-2.0, 0.3, 0.0), (2.0, 0.5, 1.15)),
        ("Stool", _paint("Green", _GREEN), (-1.3, -1.1, 0.0), (-0.8, -0.6, 0.6)),
    ):
        add_box(scene, name, material, low, high)
    add_ball(scene, "Ball", white, (0.9, -0.8, 0.4), 0.4)
    lamp = _light(scene, (0.0, 1.3, 2.5), (0.0, 1.3, 0.0), 500.0)
    lamp.data.spot_size = math.radians(55.0)
    dim = _light(scene, (-2.6, -4.0, 2.4), (0.5, 0.5, 0.3), 60.0)
    dim.data.spot_size = math.radians(80.0)
    add_camera(scene, (0.0, -4.0, 1.25), (0.0, 1.0, 1.05), lens=24.0)
    return scene


def _new_scene(name: str) -> bpy.types.Scene:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.data.scenes.new(name)
    scene.render.engine = "CYCLES"
    scene.world = new_world("Black", (0.0, 0.0, 0.0), 0.0)
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = 0.5
    return scene


def _paint(name: str, color: tuple[float, float, float]) -> bpy.types.Material:
    return new_material(name, color, roughness=1.0, specular=0.0)


def _light(
    scene: bpy.types.Scene,
    place: tuple[float, float, float],
    target: tuple[float, float, float],
    energy: float,
) -> bpy.types.Object:
    """Add a spot with soft shadows that metal does not reflect."""
    lamp = add_lamp(scene, "Spot", "SPOT", place, target, energy=energy, color=(1.0, 0.95, 0.88))
    lamp.data.spot_size = math.radians(95.0)
    lamp.data.spot_blend = 0.3
    lamp.data.shadow_soft_size = 0.15
    lamp.visible_glossy = False
    return lamp


def _patterned_floor() -> bpy.types.Material:
    """Metal in squares of two roughnesses."""
    material = new_material("Chequered Roughness", _METAL, metallic=1.0)
    tree = node_tree(material)
    squares = tree.nodes.new("ShaderNodeTexChecker")
    squares.inputs["Scale"].default_value = 2.0
    squares.inputs["Color1"].default_value = (0.04, 0.04, 0.04, 1.0)
    squares.inputs["Color2"].default_value = (0.38, 0.38, 0.38, 1.0)
    _place(tree, squares)
    tree.links.new(squares.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Roughness"])
    return material


def _wavy_floor() -> bpy.types.Material:
    """Metal with waves that are only in its normals."""
    material = new_material("Waves", _METAL, roughness=0.08, metallic=1.0)
    tree = node_tree(material)
    waves = tree.nodes.new("ShaderNodeTexNoise")
    waves.inputs["Scale"].default_value = 3.0
    waves.inputs["Detail"].default_value = 0.0
    _place(tree, waves)
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value = 1.0
    bump.inputs["Distance"].default_value = 0.06
    tree.links.new(waves.outputs[0], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])
    return material


def _chequered_paint(
    name: str,
    color: tuple[float, float, float],
    other: tuple[float, float, float],
    scale: tuple[float, float, float],
    turn: float = 0.0,
) -> bpy.types.Material:
    """Two colours in squares, or in stripes where they have no scale; turned on a wall that faces -Y."""
    material = _paint(name, _WHITE)
    tree = node_tree(material)
    squares = tree.nodes.new("ShaderNodeTexChecker")
    squares.inputs["Scale"].default_value = 1.0
    squares.inputs["Color1"].default_value = (*color, 1.0)
    squares.inputs["Color2"].default_value = (*other, 1.0)
    _place(tree, squares, scale, turn)
    tree.links.new(squares.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


def _place(
    tree: bpy.types.NodeTree,
    texture: bpy.types.ShaderNode,
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
    turn: float = 0.0,
) -> None:
    """Fix a texture to the world, off the origin, where the edges of its squares would meet the geometry."""
    position = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"]
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Location"].default_value = (0.013, 0.017, 0.019)
    mapping.inputs["Rotation"].default_value = (0.0, turn, 0.0)
    mapping.inputs["Scale"].default_value = scale
    tree.links.new(position, mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
