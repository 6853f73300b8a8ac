# SPDX-License-Identifier: GPL-3.0-or-later
"""Render surfaces without the volumes between them and the camera."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from .restore import Restorer
from .shader_trees import output_link, output_target, shaded_materials, shaded_worlds


def has_volumes(view_layer: bpy.types.ViewLayer) -> bool:
    """Return whether anything that may be rendered has a volume."""
    return next(_volumes(view_layer), None) is not None


def borrow_clear_air(restorer: Restorer, view_layer: bpy.types.ViewLayer) -> None:
    """Switch all volumes off until `restorer` closes.

    A single sample may scatter in the air, and its pixel then has no surface.
    """
    target = output_target(view_layer.id_data)
    volumes = list(_volumes(view_layer))
    restorer.change(view_layer, use_volumes=False)
    for owner, volume in volumes:
        if isinstance(owner, bpy.types.World):
            _forget_kept_scene(view_layer.id_data)
            restorer.callback(_forget_kept_scene, view_layer.id_data)
        # What has neither surface nor volume is black and solid.
        if isinstance(owner, bpy.types.Material) and output_link(owner.node_tree, "Surface", target) is None:
            _make_transparent(restorer, owner.node_tree, target)
        restorer.change(volume, is_muted=True)


def _volumes(view_layer: bpy.types.ViewLayer) -> Iterator[tuple[bpy.types.ID, bpy.types.NodeLink]]:
    """Yield all materials and worlds with volumes, and the links that bring them."""
    target = output_target(view_layer.id_data)
    for owner in (*shaded_materials(), *shaded_worlds()):
        volume = output_link(owner.node_tree, "Volume", target)
        if volume is not None:
            yield owner, volume


def _make_transparent(restorer: Restorer, tree: bpy.types.NodeTree, target: str) -> None:
    output = tree.get_output_node(target)
    transparent = tree.nodes.new("ShaderNodeBsdfTransparent")
    restorer.callback(tree.nodes.remove, transparent)
    tree.links.new(output.inputs["Surface"], transparent.outputs[0])


def _forget_kept_scene(scene: bpy.types.Scene) -> None:
    """Free what persistent data keeps: Cycles would miss that a world's volume comes or goes."""
    is_kept = scene.render.use_persistent_data
    scene.render.use_persistent_data = False
    scene.render.use_persistent_data = is_kept
