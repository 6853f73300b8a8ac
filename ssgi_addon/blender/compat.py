# SPDX-License-Identifier: GPL-3.0-or-later
"""Every difference between Blender versions, one function each."""

from __future__ import annotations

import bpy

from .restore import Restorer


def compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """Return the compositor's node tree of `scene`, None where it has none."""
    if bpy.app.version >= (5, 0, 0):
        return scene.compositing_node_group
    return scene.node_tree


def is_compositor_in_use(scene: bpy.types.Scene) -> bool:
    """Whether a render of `scene` goes through its compositor tree, post processing being on."""
    if bpy.app.version >= (5, 0, 0):
        return scene.compositing_node_group is not None
    return scene.use_nodes and scene.node_tree is not None


def compositor_outputs(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    """Return the input sockets whose image becomes the picture of the render."""
    if bpy.app.version >= (5, 0, 0):
        ends = [node for node in tree.nodes if node.bl_idname == "NodeGroupOutput" and node.is_active_output]
        # The first colour of the group's interface is the picture; others are further outputs.
        images = [
            [socket for socket in node.inputs if socket.bl_idname == "NodeSocketColor"] for node in ends
        ]
        return [sockets[0] for sockets in images if sockets]
    return [node.inputs["Image"] for node in tree.nodes if node.bl_idname == "CompositorNodeComposite"]


def new_compositor_tree(scene: bpy.types.Scene) -> tuple[bpy.types.NodeTree, list[bpy.types.NodeSocket]]:
    """Give `scene` a compositor tree that holds one output node; return both tree and output."""
    if bpy.app.version >= (5, 0, 0):
        tree = bpy.data.node_groups.new("Compositor Nodes", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        tree.nodes.new("NodeGroupOutput")
        scene.compositing_node_group = tree
    else:
        images = set(bpy.data.images)
        scene.use_nodes = True
        tree = scene.node_tree
        # Blender fills a new tree by itself, with a viewer that brings an image along.
        tree.nodes.clear()
        for image in set(bpy.data.images) - images:
            bpy.data.images.remove(image)
        tree.nodes.new("CompositorNodeComposite")
    return tree, compositor_outputs(tree)


def discard_compositor_tree(scene: bpy.types.Scene) -> None:
    """Undo `new_compositor_tree`."""
    if bpy.app.version >= (5, 0, 0):
        tree = scene.compositing_node_group
        scene.compositing_node_group = None
        bpy.data.node_groups.remove(tree)
    else:
        scene.node_tree.nodes.clear()
        scene.use_nodes = False


def add_fit_to_render_node(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """Add a Scale node that stretches its image over the whole render."""
    node = tree.nodes.new("CompositorNodeScale")
    if bpy.app.version >= (5, 0, 0):
        node.inputs["Type"].default_value = "Render Size"
        node.inputs["Frame Type"].default_value = "Stretch"
    else:
        node.space = "RENDER_SIZE"
        node.frame_method = "STRETCH"
    return node


def set_scene_linear(image: bpy.types.Image) -> None:
    """Mark a float image file as holding values of the working space, so that they are read unchanged."""
    # Before 5.0 a file has no working space of its own, and float files default to scene linear.
    if bpy.app.version >= (5, 0, 0):
        image.colorspace_settings.name = bpy.data.colorspace.working_space


def uses_nodes(owner: bpy.types.Material | bpy.types.World) -> bool:
    """Whether its nodes make the look of a material or a world; before 5.0 they could be switched off."""
    if bpy.app.version >= (5, 0, 0):
        return owner.node_tree is not None
    return owner.use_nodes and owner.node_tree is not None


def has_roughness_pass(view_layer: bpy.types.ViewLayer) -> bool:
    """Whether Cycles can write an unweighted Denoising Roughness of the first hit (since 5.2)."""
    return "denoising_pass_follow_reflections" in view_layer.cycles.bl_rna.properties


def has_denoiser(scene: bpy.types.Scene) -> bool:
    """Whether this build of Blender can denoise; some Linux distributions' builds cannot."""
    import _cycles  # exists once Cycles is enabled, and only inside Blender

    return _cycles.with_openimagedenoise or scene.cycles.denoiser != ""


def denoises_files() -> bool:
    """Whether Cycles' module denoises EXR files; not a documented interface, but there since 2.81."""
    import _cycles

    return hasattr(_cycles, "denoise")


def interface_selection(
    interface: bpy.types.NodeTreeInterface,
) -> list[tuple[bpy.types.NodeTreeInterfaceItem, bool]]:
    """Return the items of a node group's interface with whether each is selected, where they can be."""
    return [(item, item.select) for item in interface.items_tree if "select" in item.bl_rna.properties]


def eevee_engine_id() -> str:
    """Return what ``scene.render.engine`` calls EEVEE; before 5.0 it had another name."""
    return "BLENDER_EEVEE" if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"


def multilayer_exr_format() -> dict[str, str]:
    """Return the image settings of a multilayer EXR file, in the order in which to set them."""
    kind = {"media_type": "MULTI_LAYER_IMAGE"} if bpy.app.version >= (5, 0, 0) else {}
    return {**kind, "file_format": "OPEN_EXR_MULTILAYER", "color_depth": "32"}


def set_equirectangular(camera: bpy.types.Camera) -> None:
    """Make a panoramic camera show every direction; before 5.0 the setting was one of Cycles' own."""
    owner = camera if "panorama_type" in camera.bl_rna.properties else camera.cycles
    owner.panorama_type = "EQUIRECTANGULAR"


def switch_nodes_on(world: bpy.types.World) -> bpy.types.NodeTree:
    """Let nodes make the look of a world, and return them; since 5.0 every new world has some."""
    if bpy.app.version < (5, 0, 0) or world.node_tree is None:
        world.use_nodes = True
    return world.node_tree


def world_of(view_layer: bpy.types.ViewLayer) -> bpy.types.World | None:
    """Return the world that a view layer renders; some versions let it have one of its own."""
    return getattr(view_layer, "world_override", None) or view_layer.id_data.world


def borrow_world(restorer: Restorer, view_layer: bpy.types.ViewLayer, world: bpy.types.World) -> None:
    """Let a view layer render `world` until `restorer` closes."""
    if getattr(view_layer, "world_override", None) is not None:
        restorer.change(view_layer, world_override=world)
    else:
        restorer.change(view_layer.id_data, world=world)


def writes_oblong_pixels() -> bool:
    """Whether multilayer EXR files can hold pixels that are not square; 5.0 and 5.1 fail without a reason."""
    return not (5, 0, 0) <= bpy.app.version < (5, 2, 0)


def update_render_layers_nodes(view_layer: bpy.types.ViewLayer) -> None:
    """Make the compositor show the passes of undone settings; its links would stay marked invalid.

    Before 5.2 only the choice of an engine does that, and it frees the scene that Cycles keeps.
    """
    if bpy.app.version >= (5, 2, 0):
        view_layer.update_render_passes()
    else:
        render = view_layer.id_data.render
        render.engine = render.engine
