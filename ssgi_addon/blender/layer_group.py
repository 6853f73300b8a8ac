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

# Inputs that scale one kind of light, beside Strength and Tint, which scale both.
LIGHT_INPUTS = ("Diffuse Strength", "Diffuse Tint", "Glossy Strength", "Glossy Tint")

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
    """Make the group: Image, strengths and tints in; the picture with the light added and each layer out."""
    group = bpy.data.node_groups.new(GROUP_NAME, "CompositorNodeTree")
    group[MARK] = True
    sockets = group.interface.new_socket
    sockets("Image", in_out="INPUT", socket_type="NodeSocketColor")
    _add_inputs(group)
    sockets("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    for name in COLOR_LAYERS:
        sockets(name.title(), in_out="OUTPUT", socket_type="NodeSocketColor")
    for name in VALUE_LAYERS:
        sockets(name.title(), in_out="OUTPUT", socket_type="NodeSocketFloat")
    _fill_group(group, image)
    return group


def replace_image(nodes: list[bpy.types.Node], image: bpy.types.Image) -> None:
    """Point the groups' Image nodes at `image`; rebuild a group that lacks one, or an input."""
    for group in {node.node_tree for node in nodes}:
        readers = [
            inner for inner in group.nodes if inner.bl_idname == "CompositorNodeImage" and inner.get(MARK)
        ]
        replaced = {reader.image for reader in readers if reader.image}
        inputs = {item.name for item in group.interface.items_tree if item.in_out == "INPUT"}
        if readers and inputs.issuperset(LIGHT_INPUTS):
            for reader in readers:
                reader.image = image
        else:
            _add_inputs(group)
            _fill_group(group, image)
        for old in replaced:
            if not old.users:
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


def _add_inputs(group: bpy.types.NodeTree) -> None:
    """Add the strengths and tints that the group does not have yet."""
    there = {item.name for item in group.interface.items_tree if item.in_out == "INPUT"}
    for name in ("Strength", "Tint", *LIGHT_INPUTS):
        if name in there:
            continue
        if name.endswith("Tint"):
            socket = group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketColor")
            socket.default_value = (1.0, 1.0, 1.0, 1.0)
            socket.description = f"Color that the {_light(name)} is multiplied by"
        else:
            socket = group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat")
            socket.default_value, socket.min_value, socket.max_value = 1.0, 0.0, 100.0
            socket.description = f"Factor on the {_light(name)} that is added to the image"


def _light(input_name: str) -> str:
    """Name the light that an input scales."""
    kind, _, rest = input_name.partition(" ")
    return f"{kind.lower()} indirect light" if rest else "indirect light"


def _fill_group(group: bpy.types.NodeTree, image: bpy.types.Image) -> None:
    """Wire Image + Strength * Tint * (Ds * Dt * albedo * diffuse + Gs * Gt * specular * glossy)."""
    group.nodes.clear()
    entry = group.nodes.new("NodeGroupInput")
    exit_ = group.nodes.new("NodeGroupOutput")
    layers = _add_image_node(group, image)
    layers[MARK] = True

    inputs = entry.outputs
    diffuse = _mix(group, "MULTIPLY", layers.outputs["albedo"], layers.outputs["diffuse"])
    glossy = _mix(group, "MULTIPLY", layers.outputs["specular"], layers.outputs["glossy"])
    tinted_diffuse = _mix(group, "MULTIPLY", diffuse, inputs["Diffuse Tint"])
    tinted_glossy = _mix(group, "MULTIPLY", glossy, inputs["Glossy Tint"])
    scaled = _mix(group, "ADD", None, tinted_diffuse, factor=inputs["Diffuse Strength"])
    indirect = _mix(group, "ADD", scaled, tinted_glossy, factor=inputs["Glossy Strength"])
    tinted = _mix(group, "MULTIPLY", indirect, inputs["Tint"])
    # Exact where the sizes agree (measured), and in place where the render's percentage was changed.
    fitted = compat.add_fit_to_render_node(group)
    group.links.new(tinted, fitted.inputs["Image"])
    added = _mix(group, "ADD", inputs["Image"], fitted.outputs["Image"], factor=inputs["Strength"])

    group.links.new(added, exit_.inputs["Image"])
    for name in (*COLOR_LAYERS, *VALUE_LAYERS):
        group.links.new(layers.outputs[name], exit_.inputs[name.title()])
    _arrange(
        [
            [entry, layers],
            [diffuse.node, glossy.node],
            [tinted_diffuse.node, tinted_glossy.node],
            [scaled.node],
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
    a: bpy.types.NodeSocket | None,
    b: bpy.types.NodeSocket,
    factor: bpy.types.NodeSocket | None = None,
) -> bpy.types.NodeSocket:
    """Mix two colours, the first one black for None; return the node's colour output."""
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type, node.blend_type, node.clamp_factor = "RGBA", blend_type, False
    # The node has inputs of the same name for every data type; only the identifiers are unique.
    inputs = {socket.identifier: socket for socket in node.inputs}
    inputs["Factor_Float"].default_value = 1.0
    if a:
        tree.links.new(a, inputs["A_Color"])
    else:
        inputs["A_Color"].default_value = (0.0, 0.0, 0.0, 1.0)
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
