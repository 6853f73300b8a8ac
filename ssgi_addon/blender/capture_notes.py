# SPDX-License-Identifier: GPL-3.0-or-later
"""What a direct-light capture of a scene cannot hold, told to the user."""

from __future__ import annotations

from collections.abc import Collection

import bpy

from .shader_trees import nodes_with_groups, output_link, output_target, shaded_materials, shaded_worlds

_MOST_NAMES = 3
# The input of each glossy node that stretches its highlights along a tangent.
_ANISOTROPY = {
    "ShaderNodeBsdfPrincipled": "Anisotropic",
    "ShaderNodeBsdfAnisotropic": "Anisotropy",  # Glossy BSDF
    "ShaderNodeBsdfMetallic": "Anisotropy",
}


def capture_notes(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Say, a sentence each, which light or effect is missing from a capture of `scene`."""
    notes = []
    target = output_target(scene)
    is_cycles = target == "CYCLES"
    refracting = [material.name for material in shaded_materials() if _refracts(material.node_tree)]
    if refracting:
        reason = (
            "Cycles counts both as indirect" if is_cycles else "EEVEE needs ray tracing or probes for both"
        )
        notes.append(
            "Light that comes through refraction is missing, and so are its inner reflections, since "
            f"{reason}: {_counted(refracting)}."
        )
    blended = [material.name for material in shaded_materials() if _is_blended(material)]
    if blended and not is_cycles:
        notes.append(
            "Blended materials have no depth in EEVEE, so rays pass through them "
            f"(set Render Method to Dithered): {_counted(blended)}."
        )
    brushed = [material.name for material in shaded_materials() if _is_anisotropic(material.node_tree)]
    if brushed:
        notes.append(
            "Anisotropic reflections count as isotropic ones of the same roughness in the indirect light: "
            f"{_counted(brushed)}."
        )
    volumes = [
        owner.name
        for owner in (*shaded_materials(), *shaded_worlds())
        if output_link(owner.node_tree, "Volume", target) is not None
    ]
    if volumes:
        notes.append(f"Volumes are in the direct light but do not dim the indirect: {_counted(volumes)}.")
    if scene.camera.data.dof.use_dof:
        notes.append("Depth of field blurs the direct light but not the indirect light.")
    if scene.render.use_motion_blur:
        notes.append("Motion blur is in the direct light but not in the indirect light.")
    return tuple(notes)


def _refracts(tree: bpy.types.NodeTree) -> bool:
    return any(
        node.bl_idname in {"ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction"}
        or (
            node.bl_idname == "ShaderNodeBsdfPrincipled"
            and _is_above_zero(node.inputs["Transmission Weight"])
        )
        for node in nodes_with_groups(tree)
    )


def _is_blended(material: bpy.types.Material) -> bool:
    return material.surface_render_method == "BLENDED"


def _is_anisotropic(tree: bpy.types.NodeTree) -> bool:
    sockets = (
        node.inputs[_ANISOTROPY[node.bl_idname]]
        for node in nodes_with_groups(tree)
        if node.bl_idname in _ANISOTROPY
    )
    return any(socket.is_linked or socket.default_value != 0.0 for socket in sockets)


def _is_above_zero(socket: bpy.types.NodeSocket) -> bool:
    return socket.is_linked or socket.default_value > 0.0


def _counted(names: Collection[str]) -> str:
    """Name the first few."""
    shown = ", ".join(f"'{name}'" for name in sorted(names)[:_MOST_NAMES])
    return f"{shown} and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else shown
