# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects, materials and lamps for scenes that are built in Python, the same in every Blender."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import bmesh
import bpy
from mathutils import Matrix, Vector

Vec3 = Sequence[float]


def new_material(
    name: str,
    color: Vec3,
    *,
    roughness: float = 0.6,
    metallic: float = 0.0,
    specular: float = 0.5,
    emission: float = 0.0,
) -> bpy.types.Material:
    """Make a Principled BSDF material; `emission` is the radiance that it sends out, in its own colour."""
    material = bpy.data.materials.new(name)
    nodes = node_tree(material).nodes
    inputs = nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*color, 1.0)
    inputs["Roughness"].default_value = roughness
    inputs["Metallic"].default_value = metallic
    inputs["Specular IOR Level"].default_value = specular
    inputs["Emission Color"].default_value = (*color, 1.0)
    inputs["Emission Strength"].default_value = emission
    material.diffuse_color = (*color, 1.0)
    return material


def new_world(name: str, color: Vec3, strength: float) -> bpy.types.World:
    """Make a world of one colour."""
    world = bpy.data.worlds.new(name)
    background = node_tree(world).nodes["Background"].inputs
    background["Color"].default_value = (*color, 1.0)
    background["Strength"].default_value = strength
    return world


def node_tree(owner: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """Return the shader nodes of a new material or world, making them where Blender did not (4.5)."""
    if owner.node_tree is None:
        owner.use_nodes = True
    return owner.node_tree


def add_mesh(
    scene: bpy.types.Scene,
    name: str,
    material: bpy.types.Material,
    shape: Callable[[bmesh.types.BMesh], object],
    *,
    smooth: bool = False,
    bevel: float = 0.0,
) -> bpy.types.Object:
    """Add a mesh object whose geometry `shape` puts into a BMesh; `bevel` rounds its edges, in metres."""
    builder = bmesh.new()
    shape(builder)
    bmesh.ops.recalc_face_normals(builder, faces=builder.faces)
    for face in builder.faces:
        face.smooth = smooth or bevel > 0.0
    mesh = bpy.data.meshes.new(name)
    builder.to_mesh(mesh)
    builder.free()
    mesh.materials.append(material)

    thing = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(thing)
    if bevel > 0.0:
        modifier = thing.modifiers.new("Bevel", "BEVEL")
        modifier.width = bevel
        modifier.segments = 3
        modifier.harden_normals = True
    return thing


def add_box(
    scene: bpy.types.Scene,
    name: str,
    material: bpy.types.Material,
    low: Vec3,
    high: Vec3,
    *,
    bevel: float = 0.0,
) -> bpy.types.Object:
    """Add an axis-aligned box between two corners; the object's origin is the middle of its underside."""
    size = Vector(high) - Vector(low)
    stretch = Matrix.Translation((0.0, 0.0, size.z / 2)) @ Matrix.Diagonal((*size, 1.0))

    def shape(builder: bmesh.types.BMesh) -> None:
        bmesh.ops.create_cube(builder, size=1.0, matrix=stretch)

    box = add_mesh(scene, name, material, shape, bevel=bevel)
    box.location = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2])
    return box


def add_ball(
    scene: bpy.types.Scene, name: str, material: bpy.types.Material, center: Vec3, radius: float
) -> bpy.types.Object:
    """Add a smooth ball."""

    def shape(builder: bmesh.types.BMesh) -> None:
        bmesh.ops.create_uvsphere(builder, u_segments=64, v_segments=32, radius=radius)

    ball = add_mesh(scene, name, material, shape, smooth=True)
    ball.location = center
    return ball


def add_rod(
    scene: bpy.types.Scene,
    name: str,
    material: bpy.types.Material,
    start: Vec3,
    end: Vec3,
    radius: float,
) -> bpy.types.Object:
    """Add a round rod between two points."""
    axis = Vector(end) - Vector(start)
    size = {"radius1": radius, "radius2": radius, "depth": axis.length}

    def shape(builder: bmesh.types.BMesh) -> None:
        bmesh.ops.create_cone(builder, cap_ends=True, segments=20, **size)

    rod = add_mesh(scene, name, material, shape, smooth=True)
    rod.location = (Vector(start) + Vector(end)) / 2
    rod.rotation_euler = axis.to_track_quat("Z", "Y").to_euler()
    return rod


def add_lathe(
    scene: bpy.types.Scene,
    name: str,
    material: bpy.types.Material,
    profile: Sequence[tuple[float, float]],
    base: Vec3,
) -> bpy.types.Object:
    """Add the solid that a profile of (radius, height) points draws when it turns about the vertical."""

    def shape(builder: bmesh.types.BMesh) -> None:
        points = [builder.verts.new((radius, 0.0, height)) for radius, height in profile]
        edges = [builder.edges.new(pair) for pair in itertools.pairwise(points)]
        turn = {"axis": (0.0, 0.0, 1.0), "cent": (0.0, 0.0, 0.0), "angle": math.tau, "steps": 48}
        bmesh.ops.spin(builder, geom=points + edges, **turn)
        bmesh.ops.remove_doubles(builder, verts=builder.verts, dist=1e-5)

    turned = add_mesh(scene, name, material, shape, smooth=True)
    turned.location = base
    return turned


def add_lamp(
    scene: bpy.types.Scene, name: str, kind: str, place: Vec3, target: Vec3, *, energy: float, color: Vec3
) -> bpy.types.Object:
    """Add a lamp at `place` that shines at `target`; energy in watts (sun: W/m²)."""
    light = bpy.data.lights.new(name, kind)
    light.energy = energy
    light.color = color
    lamp = bpy.data.objects.new(name, light)
    lamp.location = place
    lamp.rotation_euler = look_at(place, target)
    scene.collection.objects.link(lamp)
    return lamp


def add_camera(scene: bpy.types.Scene, place: Vec3, target: Vec3, *, lens: float) -> bpy.types.Object:
    """Add a perspective camera and make it the scene's; `lens` in millimetres on a 36 mm sensor."""
    data = bpy.data.cameras.new("Camera")
    data.lens = lens
    data.clip_start = 0.05
    camera = bpy.data.objects.new("Camera", data)
    camera.location = place
    camera.rotation_euler = look_at(place, target)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def look_at(place: Vec3, target: Vec3) -> tuple[float, float, float]:
    """Euler angles that point a camera's or lamp's -Z axis from `place` to `target`, +Y up."""
    return tuple((Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler())
