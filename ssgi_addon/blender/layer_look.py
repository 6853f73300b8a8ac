# SPDX-License-Identifier: GPL-3.0-or-later
"""Strength and tint of each kind of light: what a scene says drives the inputs of its group nodes."""

from __future__ import annotations

import bpy

# Inputs of the node group, and the properties of `scene.ssgi` that they follow.
LOOK = {
    "Diffuse Strength": "diffuse_strength",
    "Diffuse Tint": "diffuse_tint",
    "Glossy Strength": "glossy_strength",
    "Glossy Tint": "glossy_tint",
}


def follow_scene(node: bpy.types.Node, scene: bpy.types.Scene) -> None:
    """Let the inputs of a group node follow `scene.ssgi`, in animations too.

    Without the extension a scene has no such settings, and the inputs stay the user's.
    """
    if not hasattr(scene, "ssgi"):
        return
    for name, attribute in LOOK.items():
        socket = node.inputs[name]
        components = (0, 1, 2) if socket.type == "RGBA" else (-1,)
        for index in components:
            socket.driver_remove("default_value", index)
            driver = socket.driver_add("default_value", index).driver
            # A sum of one variable is no Python expression: it runs where scripts may not.
            driver.type = "SUM"
            target = driver.variables.new().targets[0]
            target.id_type, target.id = "SCENE", scene
            target.data_path = f"ssgi.{attribute}" + (f"[{index}]" if index >= 0 else "")
    apply_look(node, scene)


def stop_following(node: bpy.types.Node) -> None:
    """Remove what `follow_scene` added."""
    for name in LOOK:
        if name in node.inputs:
            node.inputs[name].driver_remove("default_value", -1)
    tree = node.id_data
    kept = tree.animation_data
    if kept and not (kept.action or kept.nla_tracks or kept.drivers):
        tree.animation_data_clear()


def apply_look(node: bpy.types.Node, scene: bpy.types.Scene) -> None:
    """Set the inputs at once: Blender composites anew for a changed input, not for a changed driver."""
    for name, attribute in LOOK.items():
        if name not in node.inputs:  # until its file is added again, a group of an earlier version
            continue
        value = getattr(scene.ssgi, attribute)
        node.inputs[name].default_value = (*value, 1.0) if name.endswith("Tint") else value
