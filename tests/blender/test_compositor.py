# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group in the compositor: what it computes, and that it leaves no other trace."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import compat, compositor, layer_group
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers, write_layers
from tests.tolerances import COMPOSITED

WIDTH, HEIGHT = 24, 16
HAS_GROUP_TREES = bpy.app.version >= (5, 0, 0)


@pytest.fixture
def scene():
    """A lit plane before a camera, rendered by one Cycles sample without bounces."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=4, location=(0, 0, 0))
    bpy.ops.object.light_add(type="SUN", rotation=(0.3, 0.2, 0))
    bpy.context.object.data.energy = 2.0
    bpy.ops.object.camera_add(location=(0, 0, 3))
    scene.camera = bpy.context.object
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.compositor_device = "CPU"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 0
    return scene


def result_layers(width=WIDTH, height=HEIGHT, seed=0):
    random = np.random.default_rng(seed)
    layers = {name: random.random((height, width, 3), np.float32) for name in layer_group.COLOR_LAYERS}
    layers |= {name: random.random((height, width), np.float32) for name in layer_group.VALUE_LAYERS}
    return layers


@pytest.fixture
def result(tmp_path):
    """A result file with random layers, and the layers."""
    path, layers = tmp_path / "result.exr", result_layers()
    write_layers(path, layers)
    return path, layers


def added_light(layers):
    return layers["albedo"] * layers["diffuse"] + layers["specular"] * layers["glossy"]


def render_pixels(scene, folder):
    """Render and return what comes out of the compositor, (H, W, 3), top row first."""
    path = folder / "render.exr"
    scene.render.filepath = str(path)
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.color_depth = "32"
    bpy.ops.render.render(write_still=True, scene=scene.name)
    return read_layers(path)["Combined"]


def users_tree(scene):
    """A compositor as a user might have it: render, exposure node, output."""
    tree, (output,) = compat.new_compositor_tree(scene)
    render = tree.nodes.new("CompositorNodeRLayers")
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs["Factor"].default_value = 1.0
    mix.inputs[7].default_value = (0.5, 0.25, 1.0, 1.0)
    tree.links.new(render.outputs["Image"], mix.inputs[6])
    tree.links.new(mix.outputs[2], output)
    return tree


def fingerprint(scene):
    """Everything of the compositor and the data-blocks that an edit could leave changed."""
    tree = compat.compositor_tree(scene) if compat.is_compositor_in_use(scene) else None
    nodes = [(n.name, n.bl_idname, tuple(n.location), n.mute) for n in tree.nodes] if tree else None
    links = (
        sorted((k.from_socket.path_from_id(), k.to_socket.path_from_id()) for k in tree.links)
        if tree
        else None
    )
    return nodes, links, sorted(bpy.data.node_groups.keys()), sorted(bpy.data.images.keys())


def test_composited_render_equals_direct_plus_indirect(scene, result, tmp_path):
    path, layers = result
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    picture = render_pixels(scene, tmp_path)
    assert direct.max() > 0.1
    np.testing.assert_allclose(picture, direct + added_light(layers), rtol=0, atol=COMPOSITED)


def test_light_is_added_to_what_the_users_nodes_make(scene, result, tmp_path):
    path, layers = result
    users_tree(scene)
    graded = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    picture = render_pixels(scene, tmp_path)
    np.testing.assert_allclose(picture, graded + added_light(layers), rtol=0, atol=COMPOSITED)


def test_strength_and_tint_scale_the_added_light_only(scene, result, tmp_path):
    path, layers = result
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path, strength=2.5, tint=(1.0, 0.5, 0.0))
    picture = render_pixels(scene, tmp_path)
    expected = direct + 2.5 * np.array([1.0, 0.5, 0.0]) * added_light(layers)
    np.testing.assert_allclose(picture, expected, rtol=0, atol=COMPOSITED)


def test_every_layer_is_an_output(scene, result, tmp_path):
    path, layers = result
    (node,) = compositor.publish_layers(scene, path)
    tree = compat.compositor_tree(scene)
    (output,) = compat.compositor_outputs(tree)
    for name in ("glossy", "visibility"):
        tree.links.new(node.outputs[name.title()], output)
        picture = render_pixels(scene, tmp_path)
        expected = np.broadcast_to(layers[name].reshape(HEIGHT, WIDTH, -1), picture.shape)
        np.testing.assert_allclose(picture, expected, rtol=0, atol=COMPOSITED)


def test_result_of_another_size_covers_the_whole_frame(scene, tmp_path):
    path = tmp_path / "half.exr"
    layers = {
        name: np.full_like(values, 0.5) for name, values in result_layers(WIDTH // 2, HEIGHT // 2).items()
    }
    write_layers(path, layers)
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    picture = render_pixels(scene, tmp_path)
    np.testing.assert_allclose(picture[2:-2, 2:-2], direct[2:-2, 2:-2] + 0.5, rtol=0, atol=COMPOSITED)
    assert ((picture - direct) > 0.1).all()


def test_publishing_again_updates_the_group_and_keeps_its_values(scene, result, tmp_path):
    path, _ = result
    direct = render_pixels(scene, tmp_path)
    (node,) = compositor.publish_layers(scene, path)
    node.inputs["Strength"].default_value = 0.5
    counts = len(compat.compositor_tree(scene).nodes), len(bpy.data.node_groups), len(bpy.data.images)

    newer = result_layers(seed=1)
    write_layers(tmp_path / "newer.exr", newer)
    assert compositor.publish_layers(scene, tmp_path / "newer.exr") == [node]
    assert counts == (
        len(compat.compositor_tree(scene).nodes),
        len(bpy.data.node_groups),
        len(bpy.data.images),
    )
    picture = render_pixels(scene, tmp_path)
    np.testing.assert_allclose(picture, direct + 0.5 * added_light(newer), rtol=0, atol=COMPOSITED)


def test_file_that_was_written_again_is_read_again(scene, result, tmp_path):
    path, _ = result
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    render_pixels(scene, tmp_path)
    newer = result_layers(seed=1)
    write_layers(path, newer)
    compositor.publish_layers(scene, path)
    picture = render_pixels(scene, tmp_path)
    np.testing.assert_allclose(picture, direct + added_light(newer), rtol=0, atol=COMPOSITED)


@pytest.mark.parametrize("has_tree", [False, True])
def test_removal_leaves_the_compositor_as_it_was(scene, result, has_tree):
    if has_tree:
        users_tree(scene)
    before = fingerprint(scene)
    compositor.publish_layers(scene, result[0])
    assert compositor.has_layers(scene)
    assert fingerprint(scene) != before
    assert compositor.remove_layers(scene)
    assert fingerprint(scene) == before
    assert not compositor.has_layers(scene)
    assert not compositor.remove_layers(scene)


def test_nodes_that_the_user_added_after_publishing_survive_removal(scene, result):
    (node,) = compositor.publish_layers(scene, result[0])
    tree = compat.compositor_tree(scene)
    (output,) = compat.compositor_outputs(tree)
    later = tree.nodes.new("ShaderNodeMix")
    later.data_type = "RGBA"
    tree.links.new(node.outputs["Image"], later.inputs[6])
    tree.links.new(later.outputs[2], output)
    compositor.publish_layers(scene, result[0])
    assert len([n for n in tree.nodes if n.bl_idname == "CompositorNodeGroup"]) == 1
    compositor.remove_layers(scene)
    assert output.links[0].from_node == later
    assert later.inputs[6].links[0].from_node.bl_idname == "CompositorNodeRLayers"


def test_a_users_group_of_the_same_name_is_not_touched(scene, result):
    tree = users_tree(scene)
    theirs = bpy.data.node_groups.new(layer_group.GROUP_NAME, "CompositorNodeTree")
    their_node = tree.nodes.new("CompositorNodeGroup")
    their_node.node_tree = theirs
    (node,) = compositor.publish_layers(scene, result[0])
    assert node.node_tree != theirs
    compositor.remove_layers(scene)
    assert their_node.node_tree == theirs


def test_group_survives_saving_and_loading(scene, result, tmp_path):
    path, layers = result
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    loaded = bpy.context.scene
    picture = render_pixels(loaded, tmp_path)
    np.testing.assert_allclose(picture, direct + added_light(layers), rtol=0, atol=COMPOSITED)
    assert len(compositor.publish_layers(loaded, path)) == 1


def test_project_folder_can_be_moved(scene, tmp_path):
    project, layers = tmp_path / "project", result_layers()
    write_layers(project / "ssgi" / "result.exr", layers)
    bpy.ops.wm.save_as_mainfile(filepath=str(project / "scene.blend"))
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, project / "ssgi" / "result.exr")
    bpy.ops.wm.save_mainfile()
    moved = project.rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(moved / "scene.blend"))
    picture = render_pixels(bpy.context.scene, tmp_path)
    np.testing.assert_allclose(picture, direct + added_light(layers), rtol=0, atol=COMPOSITED)


def test_missing_file_is_refused_without_a_trace(scene, tmp_path):
    before = fingerprint(scene)
    with pytest.raises(SSGIError, match="no such file"):
        compositor.publish_layers(scene, tmp_path / "none.exr")
    assert fingerprint(scene) == before


@pytest.mark.parametrize("is_broken", [False, True])
def test_file_without_our_layers_is_refused_without_a_trace(scene, tmp_path, is_broken):
    path = tmp_path / "other.exr"
    if is_broken:
        path.write_bytes(b"not an image")
    else:
        write_layers(path, {"diffuse": np.zeros((HEIGHT, WIDTH, 3), np.float32)})
    before = fingerprint(scene)
    with pytest.raises(SSGIError, match=r"lacks .*glossy"):
        compositor.publish_layers(scene, path)
    assert fingerprint(scene) == before


def test_linked_scene_is_refused(scene, result, tmp_path):
    users_tree(scene)
    library = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.scenes = ["Scene"]
    linked = wanted.scenes[0]
    with pytest.raises(SSGIError, match="library"):
        compositor.publish_layers(linked, result[0])
    assert not compositor.has_layers(linked)


@pytest.mark.skipif(not HAS_GROUP_TREES, reason="before 5.0 a compositor belongs to one scene")
def test_tree_that_two_scenes_share_is_refused(scene, result):
    tree = users_tree(scene)
    bpy.data.scenes.new("Other").compositing_node_group = tree
    with pytest.raises(SSGIError, match="shares"):
        compositor.publish_layers(scene, result[0])


@pytest.mark.skipif(HAS_GROUP_TREES, reason="since 5.0 a tree cannot be switched off")
def test_tree_that_is_switched_off_is_refused(scene, result):
    users_tree(scene)
    scene.use_nodes = False
    with pytest.raises(SSGIError, match="switched off"):
        compositor.publish_layers(scene, result[0])


def test_tree_without_an_output_is_refused(scene, result):
    tree = users_tree(scene)
    tree.nodes.remove(compat.compositor_outputs(tree)[0].node)
    before = fingerprint(scene)
    with pytest.raises(SSGIError, match="no output"):
        compositor.publish_layers(scene, result[0])
    assert fingerprint(scene) == before


@pytest.mark.skipif(not HAS_GROUP_TREES, reason="before 5.0 a file has no working space")
def test_values_are_read_unchanged_in_another_working_space(scene, result, tmp_path):
    path, layers = result
    bpy.ops.wm.set_working_color_space(working_space="Linear Rec.2020", convert_colors=False)
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    picture = render_pixels(scene, tmp_path)
    np.testing.assert_allclose(picture, direct + added_light(layers), rtol=0, atol=COMPOSITED)
