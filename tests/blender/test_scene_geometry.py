# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles to cast rays at: what a render shows, whatever the viewport hides."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from benchmarks.scene_geometry import show_as_rendered, world_triangles
from tests.tolerances import UNIT_HIT


def add_square(height: float, **properties):
    """A square of 2 x 2 units about the z axis, in the scene's collection."""
    mesh = bpy.data.meshes.new("square")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    square = bpy.data.objects.new("square", mesh)
    square.location = (0, 0, height)
    for name, value in properties.items():
        setattr(square, name, value)
    bpy.context.scene.collection.objects.link(square)
    return square


def distance_down(kind: str = "diffuse") -> tuple[float, bool]:
    """What a ray from 10 units up meets: how far, and whether that is a cut-out."""
    show_as_rendered(bpy.context.scene)
    triangles = world_triangles(kind)
    (distance,), (triangle,) = triangles.first_hits(
        np.array([(0.3, 0.2, 10.0)]), np.array([(0.0, 0.0, -2.0)])
    )
    return 2.0 * distance, bool(triangles.is_cut_out[triangle])


def test_ray_meets_the_nearest_triangle_in_units_of_its_direction(empty_file):
    add_square(1.0)
    add_square(3.0)
    assert distance_down() == (pytest.approx(7.0, abs=UNIT_HIT), False)
    np.testing.assert_allclose(np.abs(world_triangles("diffuse").normals[:-1]), [(0, 0, 1)] * 4)


def test_nothing_is_met_in_an_empty_scene(empty_file):
    assert distance_down() == (np.inf, False)


@pytest.mark.parametrize("hidden", [{"hide_render": True}, {"visible_diffuse": False}])
def test_what_renders_do_not_show_is_not_met(empty_file, hidden):
    add_square(1.0)
    add_square(3.0, **hidden)
    assert distance_down()[0] == pytest.approx(9.0, abs=UNIT_HIT)


def test_what_the_viewport_alone_hides_is_met(empty_file):
    add_square(1.0)
    add_square(3.0, hide_viewport=True)
    add_square(4.0).hide_set(True)
    assert distance_down()[0] == pytest.approx(6.0, abs=UNIT_HIT)


def test_kinds_of_rays_meet_what_they_see(empty_file):
    add_square(1.0)
    add_square(3.0, visible_camera=False)
    assert distance_down("camera")[0] == pytest.approx(9.0, abs=UNIT_HIT)
    assert distance_down("diffuse")[0] == pytest.approx(7.0, abs=UNIT_HIT)


def test_modifiers_and_instances_are_those_of_renders(empty_file):
    square = add_square(1.0)
    array = square.modifiers.new("up", "ARRAY")
    array.use_relative_offset, array.use_constant_offset = False, True
    array.count, array.constant_offset_displace = 3, (0.0, 0.0, 1.0)
    array.show_viewport = False
    assert distance_down()[0] == pytest.approx(7.0, abs=UNIT_HIT)
    array.show_render = False
    collection = bpy.data.collections.new("high")
    collection.objects.link(square)
    empty_file.collection.objects.unlink(square)
    instance = bpy.data.objects.new("instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    instance.location = (0, 0, 4)
    empty_file.collection.objects.link(instance)
    assert distance_down()[0] == pytest.approx(5.0, abs=UNIT_HIT)


@pytest.mark.parametrize(("alpha", "expected"), [(1.0, False), (0.5, True)])
def test_transparent_materials_are_cut_outs(empty_file, alpha, expected):
    material = bpy.data.materials.new("leaf")
    if material.node_tree is None:
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Alpha"].default_value = alpha
    add_square(1.0).data.materials.append(material)
    assert distance_down() == (pytest.approx(9.0, abs=UNIT_HIT), expected)
