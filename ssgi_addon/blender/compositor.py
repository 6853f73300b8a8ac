# SPDX-License-Identifier: GPL-3.0-or-later
"""The return to the compositor: a node group that adds the indirect light of a result file.

The group sits between whatever feeds the compositor's output and the output; nothing else of the
user's node tree is touched, and `remove_layers` puts the link back as it was.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..errors import SSGIError
from . import compat

GROUP_NAME = "SSGI"

# Custom property on the node groups and nodes that this module made, so that a user's group
# that happens to be called "SSGI" stays the user's.
MARK = "ssgi"
CREATED = "ssgi_created"

COLOR_LAYERS = ("direct", "diffuse", "glossy", "combined", "albedo", "specular")
VALUE_LAYERS = ("visibility", "known")


def publish_layers(
    scene: bpy.types.Scene,
    exr_path: str | Path,
    *,
    strength: float | None = None,
    tint: tuple[float, float, float] | None = None,
) -> list[bpy.types.Node]:
    """Add the indirect light of a result file to what the compositor of `scene` puts out.

    The group computes ``Image + Strength * Tint * (albedo * diffuse + specular * glossy)`` and
    hands on every layer of the file. Where the scene has it already, it gets the new file and
    keeps its place and its values.

    Parameters
    ----------
    scene
        The scene whose compositor tree receives the group; it gets a tree if it has none.
    exr_path
        Multilayer EXR as `job.render_frame` writes it. Another size than the render's is stretched
        over the whole frame.
    strength
        Factor on the added light; None keeps the group's (1 in a new one).
    tint
        Scene-linear colour that the added light is multiplied by; None keeps the group's (white).

    Returns
    -------
    list of bpy.types.Node
        The group nodes in the scene's tree.

    Raises
    ------
    SSGIError
        If the file is missing or lacks a layer, or if the tree must not be edited (linked, shared
        with another scene, switched off, without an output). Nothing is changed then.
    """
    tree = compat.compositor_tree(scene)
    _check_editable(scene, tree)
    nodes = _group_nodes(tree)
    outputs = compat.compositor_outputs(tree) if tree else []
    if tree and compat.is_compositor_in_use(scene) and not nodes and not outputs:
        raise SSGIError(f"The compositor of scene '{scene.name}' has no output node: add one, then try again")

    image = _load_image(Path(exr_path))
    if nodes:
        _replace_image(nodes, image)
    else:
        if not outputs:
            tree, outputs = compat.new_compositor_tree(scene)
            tree[CREATED] = True
        group = _build_group(image)
        nodes = [_insert(tree, scene, output, group) for output in outputs]
    for node in nodes:
        if strength is not None:
            node.inputs["Strength"].default_value = strength
        if tint is not None:
            node.inputs["Tint"].default_value = (*tint, 1.0)
    return nodes


def remove_layers(scene: bpy.types.Scene) -> bool:
    """Take the group out of the compositor of `scene` and reconnect what it stood between.

    Returns
    -------
    bool
        False if the scene has no such group.

    Raises
    ------
    SSGIError
        If the tree must not be edited. Nothing is changed then.
    """
    tree = compat.compositor_tree(scene)
    nodes = _group_nodes(tree)
    if not nodes:
        return False
    _check_editable(scene, tree)
    groups = {node.node_tree for node in nodes}
    for node in nodes:
        _bypass(tree, node)
    if tree.get(CREATED) and _is_as_created(tree):
        del tree[CREATED]
        compat.discard_compositor_tree(scene)
    for group in groups:
        _discard_group(group)
    return True


def has_layers(scene: bpy.types.Scene) -> bool:
    """Whether the compositor of `scene` holds the group."""
    return bool(_group_nodes(compat.compositor_tree(scene)))


def warnings(scene: bpy.types.Scene) -> list[str]:
    """Say why a render of `scene`, whose compositor holds the group, would not show what it should."""
    if not has_layers(scene):
        return []
    found = []
    if not scene.render.use_compositing:
        found.append("Compositing is off in Post Processing: the render does not show the added light")
    if scene.render.engine == "CYCLES" and (scene.cycles.diffuse_bounces or scene.cycles.glossy_bounces):
        found.append(
            "Cycles renders indirect light too: set Diffuse and Glossy bounces to 0, or it counts twice"
        )
    return found


def _check_editable(scene: bpy.types.Scene, tree: bpy.types.NodeTree | None) -> None:
    """Raise SSGIError where an edit would be lost, or would change more than this scene."""
    for owner in (scene, tree):
        if owner and (owner.library or owner.override_library):
            raise SSGIError(
                f"The compositor of scene '{scene.name}' comes from a library: make it local, "
                "or add the layers in the library's own file"
            )
    if tree is None:
        return
    sharing = [
        other.name for other in bpy.data.scenes if other != scene and compat.compositor_tree(other) == tree
    ]
    if sharing:
        raise SSGIError(
            f"Scene '{scene.name}' shares its compositor nodes with '{sharing[0]}': "
            "make them single-user first"
        )
    if tree.nodes and not compat.is_compositor_in_use(scene):
        raise SSGIError(
            f"The compositor of scene '{scene.name}' has nodes but is switched off: "
            "turn on Use Nodes, or delete the nodes"
        )


def _group_nodes(tree: bpy.types.NodeTree | None) -> list[bpy.types.Node]:
    if tree is None:
        return []
    return [
        node
        for node in tree.nodes
        if node.bl_idname == "CompositorNodeGroup" and node.node_tree and node.node_tree.get(MARK)
    ]


def _load_image(path: Path) -> bpy.types.Image:
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


def _blender_path(path: Path) -> str:
    """Name a file relative to the blend file where it lies below its folder, so that both can move."""
    if bpy.data.filepath:
        folder = Path(bpy.data.filepath).resolve().parent
        if path.is_relative_to(folder):
            return "//" + path.relative_to(folder).as_posix()
    return str(path)


def _add_image_node(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bpy.types.Node:
    node = tree.nodes.new("CompositorNodeImage")
    node.image = image
    return node


def _replace_image(nodes: list[bpy.types.Node], image: bpy.types.Image) -> None:
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


def _build_group(image: bpy.types.Image) -> bpy.types.NodeTree:
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


def _arrange(columns: list[list[bpy.types.Node]]) -> None:
    for x, column in enumerate(columns):
        for y, node in enumerate(column):
            node.location = (220.0 * x, -260.0 * y)


def _insert(
    tree: bpy.types.NodeTree,
    scene: bpy.types.Scene,
    output: bpy.types.NodeSocket,
    group: bpy.types.NodeTree,
) -> bpy.types.Node:
    """Put `group` between an output and what feeds it: the render itself where nothing does."""
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = group
    node.name = node.label = GROUP_NAME
    x, y = output.node.location_absolute
    node.location = (x - node.width - 40.0, y - 140.0)
    if output.is_linked:
        source = output.links[0].from_socket
    else:
        render = tree.nodes.new("CompositorNodeRLayers")
        render[MARK] = True
        render.scene = scene
        render.location = (node.location.x - render.width - 40.0, y)
        source = render.outputs["Image"]
    tree.links.new(source, node.inputs["Image"])
    tree.links.new(node.outputs["Image"], output)
    return node


def _bypass(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Remove a group node; what it fed is fed by its input again."""
    source = node.inputs["Image"].links[0].from_socket if node.inputs["Image"].is_linked else None
    targets = [link.to_socket for link in node.outputs["Image"].links]
    # The output that nothing fed is unlinked again, unless the user has put nodes in between since then.
    was_unfed = (
        source is not None
        and source.node.get(MARK)
        and len(source.links) == 1
        and set(targets) <= set(compat.compositor_outputs(tree))
    )
    if source and not was_unfed:
        for target in targets:
            tree.links.new(source, target)
    tree.nodes.remove(node)
    if was_unfed:
        tree.nodes.remove(source.node)


def _is_as_created(tree: bpy.types.NodeTree) -> bool:
    """Whether a tree that `publish_layers` made holds nothing that the user added."""
    outputs = {socket.node for socket in compat.compositor_outputs(tree)}
    return all(node in outputs for node in tree.nodes)


def _discard_group(group: bpy.types.NodeTree) -> None:
    if group.users:
        return
    images = {node.image for node in group.nodes if node.bl_idname == "CompositorNodeImage" and node.image}
    bpy.data.node_groups.remove(group)
    for image in images:
        if not image.users:
            bpy.data.images.remove(image)
