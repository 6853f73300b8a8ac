# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk the shader trees that a render uses."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from . import compat


def shaded_materials() -> list[bpy.types.Material]:
    """Return the materials whose look comes from shader nodes; Grease Pencil's does not."""
    return [
        material
        for material in bpy.data.materials
        if material.users and not material.grease_pencil and compat.uses_nodes(material)
    ]


def shaded_worlds() -> list[bpy.types.World]:
    """Return the worlds that are made of shader nodes."""
    return [world for world in bpy.data.worlds if world.users and compat.uses_nodes(world)]


def active_link(socket: bpy.types.NodeSocket) -> bpy.types.NodeLink | None:
    """Return the link that gives an input socket its value."""
    return next((link for link in socket.links if link.is_valid and not link.is_muted), None)


def output_target(scene: bpy.types.Scene) -> str:
    """Return what shader outputs call the engine that renders `scene`."""
    return "EEVEE" if scene.render.engine == compat.eevee_engine_id() else "CYCLES"


def output_link(tree: bpy.types.NodeTree, name: str, target: str = "CYCLES") -> bpy.types.NodeLink | None:
    """Return what is linked to an input, ``"Surface"`` or ``"Volume"``, of the output of an engine."""
    output = tree.get_output_node(target)
    return None if output is None else active_link(output.inputs[name])


def nodes_with_groups(tree: bpy.types.NodeTree) -> Iterator[bpy.types.Node]:
    """Yield the nodes of a tree and of the groups in it, but for muted ones."""
    for node in tree.nodes:
        if node.mute:
            continue
        if node.bl_idname == "ShaderNodeGroup":
            if node.node_tree is not None:
                yield from nodes_with_groups(node.node_tree)
        else:
            yield node
