# SPDX-License-Identifier: GPL-3.0-or-later
"""A floor with one glossy lobe that reflects a patterned wall: what a reflection pass has to get right."""

from __future__ import annotations

import math

import bpy

from ssgi_addon.blender.build import add_box, add_camera, add_lamp, new_material, node_tree

from . import LAMPLIGHT, new_scene

# Not grey, so that light that was not divided by the glossy colour shows.
METAL = (0.9, 0.7, 0.5)
# Colours of the wall run between these bounds, in three waves across it, each in a direction of its own.
DARKEST, BRIGHTEST = 0.1, 0.8
_WAVES_PER_UNIT = 0.5
_WAVE_TILT = (0.5, 0.6, 0.7)


def build_glossy_floor(roughness: float, *, is_metal: bool = False) -> bpy.types.Scene:
    """A floor that only reflects, before a diffuse wall, in the light of one lamp that it does not reflect.

    Only the wall hands light on, and most of what the floor sees of it is in the frame. Pixels are sampled at
    their centres, where rays start.

    Parameters
    ----------
    roughness
        Of the floor.
    is_metal
        A metallic Principled BSDF, whose Fresnel varies over the lobe, instead of a Glossy BSDF.
    """
    scene = new_scene("Glossy Floor")
    scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"  # a box filter would ignore its width
    scene.cycles.filter_width = 0.01
    if is_metal:
        floor = new_material("Floor", METAL, roughness=roughness, metallic=1.0)
    else:
        floor = _new_glossy_material("Floor", roughness)
    add_box(scene, "Floor", floor, (-3.0, -2.5, -0.2), (3.0, 2.0, 0.0))
    add_box(scene, "Wall", _new_patterned_material("Wall"), (-8.0, 2.0, 0.0), (8.0, 2.2, 7.0))
    lamp = add_lamp(scene, "Lamp", "POINT", (0.0, -2.5, 3.5), (0.0, 0.0, 0.0), energy=1000.0, color=LAMPLIGHT)
    lamp.data.shadow_soft_size = 0.0
    lamp.visible_glossy = False
    # At 96 x 72 floor and wall meet within a row of pixels
    add_camera(scene, (0.0, -2.6, 0.6), (0.0, 2.0, 1.36), lens=14.0)
    return scene


def _new_glossy_material(name: str, roughness: float) -> bpy.types.Material:
    """Make a material of a Glossy BSDF alone: its colour is its albedo in every direction."""
    material = bpy.data.materials.new(name)
    tree = node_tree(material)
    lobe = tree.nodes.new("ShaderNodeBsdfGlossy")
    lobe.distribution = "MULTI_GGX"
    lobe.inputs["Color"].default_value = (*METAL, 1.0)
    lobe.inputs["Roughness"].default_value = roughness
    tree.links.new(lobe.outputs["BSDF"], tree.get_output_node("CYCLES").inputs["Surface"])
    return material


def _new_patterned_material(name: str) -> bpy.types.Material:
    """Make a diffuse material with a smooth wave of world position in each channel."""
    material = new_material(name, (1.0, 1.0, 1.0), roughness=1.0, specular=0.0)
    tree = node_tree(material)
    position = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"]
    tilt = tree.nodes.new("ShaderNodeMapping")
    tilt.inputs["Rotation"].default_value = _WAVE_TILT
    tilt.inputs["Scale"].default_value = (math.tau * _WAVES_PER_UNIT,) * 3
    wave = tree.nodes.new("ShaderNodeVectorMath")
    wave.operation = "SINE"
    color = tree.nodes.new("ShaderNodeVectorMath")
    color.operation = "MULTIPLY_ADD"
    color.inputs[1].default_value = ((BRIGHTEST - DARKEST) / 2.0,) * 3
    color.inputs[2].default_value = ((BRIGHTEST + DARKEST) / 2.0,) * 3
    tree.links.new(position, tilt.inputs["Vector"])
    tree.links.new(tilt.outputs["Vector"], wave.inputs[0])
    tree.links.new(wave.outputs["Vector"], color.inputs[0])
    tree.links.new(color.outputs["Vector"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material
