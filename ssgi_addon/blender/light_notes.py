# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the materials whose light a direct-light render loses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import bpy

from . import compat

_MOST_NAMES = 3


def lost_light_notes(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Say in a sentence each which light is missing from a render without diffuse and glossy bounces."""
    materials = [
        material
        for material in bpy.data.materials
        if material.users and not material.grease_pencil and compat.uses_nodes(material)
    ]
    refracting = [material.name for material in materials if _refracts(material.node_tree)]
    volumes = [material.name for material in materials if _has_volume(material.node_tree)]
    notes = []
    if refracting:
        notes.append(
            f"{_counted(refracting)} refract light: Cycles counts light that comes through them as indirect, "
            "and their inner reflections as glossy bounces, so both are missing from the direct light."
        )
    if volumes:
        notes.append(f"{_counted(volumes)} hold a volume: it is in the direct light but not in the depth.")
    world = scene.world
    if world is not None and world.node_tree is not None and _has_volume(world.node_tree):
        notes.append("The world holds a volume: it is in the direct light but not in the depth.")
    return tuple(notes)


def _refracts(tree: bpy.types.NodeTree) -> bool:
    return any(
        node.bl_idname in {"ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction"}
        or (node.bl_idname == "ShaderNodeBsdfPrincipled" and _is_above_zero(node.inputs["Transmission Weight"]))
        for node in _active_nodes(tree)
    )


def _has_volume(tree: bpy.types.NodeTree) -> bool:
    output = tree.get_output_node("CYCLES")
    return output is not None and output.inputs["Volume"].is_linked


def _active_nodes(tree: bpy.types.NodeTree) -> Iterator[bpy.types.Node]:
    """Walk the nodes of a tree and of the groups in it, without muted ones."""
    for node in tree.nodes:
        if node.mute:
            continue
        if node.bl_idname == "ShaderNodeGroup":
            if node.node_tree is not None:
                yield from _active_nodes(node.node_tree)
        else:
            yield node


def _is_above_zero(socket: bpy.types.NodeSocket) -> bool:
    return socket.is_linked or socket.default_value > 0.0


def _counted(names: Iterable[str]) -> str:
    names = sorted(names)
    shown = ", ".join(f"'{name}'" for name in names[:_MOST_NAMES])
    more = ", ..." if len(names) > _MOST_NAMES else ""
    return f"{len(names)} material{'s' if len(names) > 1 else ''} ({shown}{more})"
