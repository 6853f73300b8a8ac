# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group that computes the added light from the layers of a result file."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..errors import SSGIError
from . import compat

GROUP_NAME = "SSGI"

# Custom property on the node groups and nodes that this add-on made, so that a user's group
# that happens to be called "SSGI" stays the user's.
MARK = "ssgi"

COLOR_LAYERS = ("direct", "diffuse", "glossy", "combined", "albedo", "specular")
VALUE_LAYERS = ("visibility", "known")


def load_image(path: Path) -> bpy.types.Image:
    """Load a result file as an image data-block, or raise SSGIError with what is wrong with it."""
    if not path.is_file():
        raise SSGIError(f"{path}: there is no such file: render the indirect light first")
    image = bpy.data.images.load(_blender_path(path.resolve()))
    image.name = f"{GROUP_NAME} {path.stem}"
    compat.set_scene_linear(image)
    probe = bpy.data.node_groups.new(".ssgi probe", "CompositorNodeTree")
    found = {output.name for output in _add_image_node(probe, image).outputs}
    bpy.data.node_groups.remove(probe)
    missing = [name for name in (*COLOR_LAYERS, *VALUE_LAYERS) if name not in found]
    if missing:
        bpy.data.images.remove(image)
        raise SSGIError(
            f"{path}: not a result of this add-on, it lacks {', '.join(missing)}: render it again"
        )
    return image


def build_group(image: bpy.types.Image) -> bpy.types.NodeTree:
    """Make the group: Image, Strength and Tint in; the picture with the light added and each layer out."""
    group = bpy.data.node_groups.new(GROUP_NAME, "CompositorNodeTree")
    group[MARK] = True
    sockets = group.interface.new_socket
    sockets("Image", in_out="INPUT", socket_type="NodeSocketColor")
    strength = sockets("Strength", in_out="INPUT", socket_type="NodeSocketFloat")
    strength.default_value, strength.min_value, strength.max_value = 1.0, 0.0, 100.0
    strength.description = "Factor on the indirect light that is added to the image"
    tint = sockets("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    tint.default_value = (1.0, 1.0, 1.0, 1.0)
    tint.description = "Color that the indirect light is multiplied by"
    sockets("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    for name in COLOR_LAYERS:
        sockets(name.title(), in_out="OUTPUT", socket_type="NodeSocketColor")
    for name in VALUE_LAYERS:
        sockets(name.title(), in_out="OUTPUT", socket_type="NodeSocketFloat")
    _fill_group(group, image)
    return group


def replace_image(nodes: list[bpy.types.Node], image: bpy.types.Image) -> None:
    """Point the groups' Image nodes at `image`, and rebuild a group whose Image node is gone."""
    for group in {node.node_tree for node in nodes}:
        readers = [
            inner for inner in group.nodes if inner.bl_idname == "CompositorNodeImage" and inner.get(MARK)
        ]
        if not readers:
            _fill_group(group, image)
        for reader in readers:
            old = reader.image
            reader.image = image
            if old and not old.users:
                bpy.data.images.remove(old)


def discard_group(group: bpy.types.NodeTree) -> None:
    """Delete a group that no node uses any more, and the images that nothing but it used."""
    if group.users:
        return
    images = {node.image for node in group.nodes if node.bl_idname == "CompositorNodeImage" and node.image}
    bpy.data.node_groups.remove(group)
    for image in images:
        if not image.users:
            bpy.data.images.remove(image)


def _fill_group(group: bpy.types.NodeTree, image: bpy.types.Image) -> None:
    """Wire Image + Strength * Tint * (albedo * diffuse + specular * glossy)."""
    group.nodes.clear()
    entry = group.nodes.new("NodeGroupInput")
    exit_ = group.nodes.new("NodeGroupOutput")
    layers = _add_image_node(group, image)
    layers[MARK] = True

    diffuse = _mix(group, "MULTIPLY", layers.outputs["albedo"], layers.outputs["diffuse"])
    glossy = _mix(group, "MULTIPLY", layers.outputs["specular"], layers.outputs["glossy"])
    indirect = _mix(group, "ADD", diffuse, glossy)
    tinted = _mix(group, "MULTIPLY", indirect, entry.outputs["Tint"])
    # Exact where the sizes agree (measured), and in place where the render's percentage was changed.
    fitted = compat.add_fit_to_render_node(group)
    group.links.new(tinted, fitted.inputs["Image"])
    added = _mix(
        group, "ADD", entry.outputs["Image"], fitted.outputs["Image"], factor=entry.outputs["Strength"]
    )

    group.links.new(added, exit_.inputs["Image"])
    for name in (*COLOR_LAYERS, *VALUE_LAYERS):
        group.links.new(layers.outputs[name], exit_.inputs[name.title()])
    _arrange(
        [
            [entry, layers],
            [diffuse.node, glossy.node],
            [indirect.node],
            [tinted.node],
            [fitted],
            [added.node],
            [exit_],
        ]
    )


def _mix(
    tree: bpy.types.NodeTree,
    blend_type: str,
    a: bpy.types.NodeSocket,
    b: bpy.types.NodeSocket,
    factor: bpy.types.NodeSocket | None = None,
) -> bpy.types.NodeSocket:
    """Mix two colours; return the node's colour output."""
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type, node.blend_type, node.clamp_factor = "RGBA", blend_type, False
    # The node has inputs of the same name for every data type; only the identifiers are unique.
    inputs = {socket.identifier: socket for socket in node.inputs}
    inputs["Factor_Float"].default_value = 1.0
    tree.links.new(a, inputs["A_Color"])
    tree.links.new(b, inputs["B_Color"])
    if factor:
        tree.links.new(factor, inputs["Factor_Float"])
    return next(socket for socket in node.outputs if socket.identifier == "Result_Color")


def _add_image_node(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bpy.types.Node:
    node = tree.nodes.new("CompositorNodeImage")
    node.image = image
    return node


def _arrange(columns: list[list[bpy.types.Node]]) -> None:
    for x, column in enumerate(columns):
        for y, node in enumerate(column):
            node.location = (220.0 * x, -260.0 * y)


def _blender_path(path: Path) -> str:
    """Name a file relative to the blend file where it lies below its folder, so that both can move."""
    if bpy.data.filepath:
        folder = Path(bpy.data.filepath).resolve().parent
        if path.is_relative_to(folder):
            return "//" + path.relative_to(folder).as_posix()
    return str(path)
