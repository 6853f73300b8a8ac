# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture says which materials are shown otherwise than Cycles shows them."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import compat
from ssgi_addon.blender.build import add_box, add_camera, new_material, node_tree
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.capture_notes import capture_notes
from tests.scenes import WHITE


@pytest.fixture
def scene(empty_file):
    """A box of plain metal, and a camera that sees it."""
    add_box(empty_file, "Box", new_material("Metal", WHITE, metallic=1.0), (-1, 2, -1), (1, 3, 1))
    add_camera(empty_file, (0, 0, 0), (0, 2, 0), lens=50.0)
    return empty_file


def anisotropy_notes(scene):
    return [note for note in capture_notes(scene) if "nisotropic" in note]


def add_glossy(tree, kind, socket, value):
    lobe = tree.nodes.new(kind)
    lobe.inputs[socket].default_value = value
    tree.links.new(lobe.outputs["BSDF"], tree.get_output_node("CYCLES").inputs["Surface"])
    return lobe


def test_isotropic_materials_are_not_mentioned(scene):
    tree = node_tree(scene.objects["Box"].data.materials[0])
    add_glossy(tree, "ShaderNodeBsdfGlossy", "Anisotropy", 0.0)
    assert anisotropy_notes(scene) == []


@pytest.mark.parametrize(
    ("kind", "socket", "value"),
    [
        ("ShaderNodeBsdfPrincipled", "Anisotropic", 0.4),
        ("ShaderNodeBsdfGlossy", "Anisotropy", 0.4),
        ("ShaderNodeBsdfGlossy", "Anisotropy", -0.4),
        ("ShaderNodeBsdfMetallic", "Anisotropy", 0.4),
    ],
)
def test_anisotropic_material_is_named(scene, kind, socket, value):
    add_glossy(node_tree(scene.objects["Box"].data.materials[0]), kind, socket, value)
    [note] = anisotropy_notes(scene)
    assert "'Metal'" in note
    assert "isotropic ones" in note


def test_anisotropy_that_a_texture_gives_counts(scene):
    tree = node_tree(scene.objects["Box"].data.materials[0])
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs[0], tree.nodes["Principled BSDF"].inputs["Anisotropic"])
    assert len(anisotropy_notes(scene)) == 1


def test_anisotropy_within_a_group_counts(scene):
    group = bpy.data.node_groups.new("Brushed", "ShaderNodeTree")
    group.nodes.new("ShaderNodeBsdfAnisotropic").inputs["Anisotropy"].default_value = 0.5
    tree = node_tree(scene.objects["Box"].data.materials[0])
    tree.nodes.new("ShaderNodeGroup").node_tree = group
    assert len(anisotropy_notes(scene)) == 1


def test_frame_carries_the_note(scene):
    tree = node_tree(scene.objects["Box"].data.materials[0])
    tree.nodes["Principled BSDF"].inputs["Anisotropic"].default_value = 0.8
    frame = capture_frame(scene, CaptureOptions(samples=1, denoiser="none", resolution=(8, 8)))
    assert set(anisotropy_notes(scene)) <= set(frame.notes)
    assert anisotropy_notes(scene)


def test_blended_materials_are_named_where_eevee_renders(scene):
    bpy.data.materials["Metal"].surface_render_method = "BLENDED"
    scene.render.engine = "CYCLES"
    assert not any("lended" in note for note in capture_notes(scene))
    scene.render.engine = compat.eevee_engine_id()
    assert any("lended" in note and "'Metal'" in note for note in capture_notes(scene))
