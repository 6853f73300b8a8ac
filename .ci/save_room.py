# SPDX-License-Identifier: GPL-3.0-or-later
"""Save a small room, for checks that bring no scene of their own.

python save_room.py FILE.blend
blender --background --python save_room.py -- FILE.blend
"""

import sys

import bpy

# Corners of boxes: floor, back, left, right and a block on the floor
WHITE, RED, GREEN = (0.75, 0.75, 0.75, 1.0), (0.7, 0.08, 0.06, 1.0), (0.1, 0.5, 0.12, 1.0)
BOXES = (
    ("Floor", WHITE, (-2.0, -2.0, -0.2), (2.0, 2.0, 0.0)),
    ("Back", WHITE, (-2.0, 2.0, 0.0), (2.0, 2.2, 3.0)),
    ("Left", RED, (-2.2, -2.0, 0.0), (-2.0, 2.0, 3.0)),
    ("Right", GREEN, (2.0, -2.0, 0.0), (2.2, 2.0, 3.0)),
    ("Block", WHITE, (-0.6, 0.4, 0.0), (0.4, 1.2, 1.0)),
)


def build_room() -> None:
    """Fill an empty file: four walls' worth of room, a lamp and a camera, in a small frame."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    for name, color, low, high in BOXES:
        center = [(a + b) / 2 for a, b in zip(low, high)]
        bpy.ops.mesh.primitive_cube_add(size=1, location=center)
        box = bpy.context.object
        box.name, box.scale = name, [b - a for a, b in zip(low, high)]
        material = bpy.data.materials.new(name)
        if material.node_tree is None:  # before Blender 5.0
            material.use_nodes = True
        surface = material.node_tree.nodes["Principled BSDF"].inputs
        surface["Base Color"].default_value = color
        surface["Roughness"].default_value = 0.6
        box.data.materials.append(material)
    bpy.ops.object.light_add(type="POINT", location=(0.0, -0.5, 2.6))
    bpy.context.object.data.energy = 120.0
    bpy.ops.object.camera_add(location=(0.0, -4.5, 1.5), rotation=(1.5, 0.0, 0.0))
    scene = bpy.context.scene
    scene.camera = bpy.context.object
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 96, 54
    scene.render.compositor_device = "CPU"
    scene.cycles.samples = 8


build_room()
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1])
