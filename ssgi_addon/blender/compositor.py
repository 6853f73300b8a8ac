# SPDX-License-Identifier: GPL-3.0-or-later
"""The return to the compositor: a node group that adds the indirect light of a result file.

The group sits between whatever feeds the compositor's output and the output; nothing else of the
user's node tree is touched, and `remove_layers` puts the link back as it was.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..errors import SSGIError
from . import compat, layer_group, layer_look
from .layer_group import GROUP_NAME, MARK

# Custom property on a tree that `publish_layers` made where the scene had none.
CREATED = "ssgi_created"
# Of the group node, so that the names of its inputs can be read
_NODE_WIDTH = 220.0


def publish_layers(
    scene: bpy.types.Scene,
    exr_path: str | Path,
    *,
    strength: float | None = None,
    tint: tuple[float, float, float] | None = None,
) -> list[bpy.types.Node]:
    """Add the indirect light of a result file to what the compositor of `scene` puts out.

    The group computes ``Image + Strength * Tint * (Ds * Dt * albedo * diffuse + Gs * Gt * specular *
    glossy)`` and hands on every layer of the file. Ds and Dt, Gs and Gt, strength and tint of each kind of
    light, follow the scene's settings where the extension is there, and are 1 and white elsewhere. Where
    the scene has the group already, it gets the new file and keeps its place and its values.

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
    check_editable(scene)
    nodes = _group_nodes(tree)
    outputs = compat.compositor_outputs(tree) if tree else []
    image = layer_group.load_image(Path(exr_path))
    if nodes:
        layer_group.replace_image(nodes, image)
    else:
        if not outputs:
            tree, outputs = compat.new_compositor_tree(scene)
            tree[CREATED] = True
        group = layer_group.build_group(image)
        nodes = [_insert(tree, scene, output, group) for output in outputs]
    for node in nodes:
        layer_look.follow_scene(node, scene)
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
    check_editable(scene)
    groups = {node.node_tree for node in nodes}
    for node in nodes:
        _bypass(tree, node)
    if tree.get(CREATED) and _is_as_created(tree):
        del tree[CREATED]
        compat.discard_compositor_tree(scene)
    for group in groups:
        layer_group.discard_group(group)
    return True


def has_layers(scene: bpy.types.Scene) -> bool:
    """Whether the compositor of `scene` holds the group."""
    return bool(_group_nodes(compat.compositor_tree(scene)))


def check_editable(scene: bpy.types.Scene) -> None:
    """Refuse a compositor in which an edit would be lost or would change more than `scene`, or has no place.

    Raises
    ------
    SSGIError
        With the reason, and what to do about it.
    """
    tree = compat.compositor_tree(scene)
    for owner in (scene, tree, *(node.node_tree for node in _group_nodes(tree))):
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
    if compat.is_compositor_in_use(scene) and not compat.compositor_outputs(tree) and not _group_nodes(tree):
        raise SSGIError(f"The compositor of scene '{scene.name}' has no output node: add one, then try again")


def edit_obstacle(scene: bpy.types.Scene) -> str | None:
    """Return why the compositor of `scene` must not be edited, and what to do about it; None if it may."""
    try:
        check_editable(scene)
    except SSGIError as error:
        return str(error)
    return None


def apply_look(scene: bpy.types.Scene) -> None:
    """Set strength and tint of the group in the compositor of `scene`, if it has one, to its settings."""
    tree = compat.compositor_tree(scene)
    if tree is None or tree.library:
        return
    for node in _group_nodes(tree):
        layer_look.apply_look(node, scene)


def warnings(scene: bpy.types.Scene) -> list[str]:
    """Say why a render of `scene`, whose compositor holds the group, would not show what it should."""
    if not has_layers(scene):
        return []
    if not scene.render.use_compositing:
        return ["Compositing is off in Post Processing: the render does not show the added light"]
    double = double_light(scene)
    return [double] if double else []


def double_light(scene: bpy.types.Scene) -> str | None:
    """Say why a render would show the light of the group twice, and what to do; None if it would not."""
    if scene.render.engine != "CYCLES" or not (scene.render.use_compositing and has_layers(scene)):
        return None
    settings = getattr(scene, "ssgi", None)
    if settings is not None and settings.enabled:
        if settings.replace_combined:
            return (
                "In Renders is on, and the render shows the light: "
                "take the layers out of the compositor, or it counts twice"
            )
        if settings.replace_gi:
            return None
    if scene.cycles.diffuse_bounces or scene.cycles.glossy_bounces:
        return "Cycles renders indirect light too: set Diffuse and Glossy bounces to 0, or it counts twice"
    return None


def _group_nodes(tree: bpy.types.NodeTree | None) -> list[bpy.types.Node]:
    if tree is None:
        return []
    return [
        node
        for node in tree.nodes
        if node.bl_idname == "CompositorNodeGroup" and node.node_tree and node.node_tree.get(MARK)
    ]


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
    node.width = _NODE_WIDTH
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
    layer_look.stop_following(node)
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
