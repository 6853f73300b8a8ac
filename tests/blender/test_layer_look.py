# SPDX-License-Identifier: GPL-3.0-or-later
"""Strength and tint of each kind of light: scene settings that the compositor follows."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon import properties
from ssgi_addon.blender import compat, compositor, layer_group
from ssgi_addon.exr import write_layers
from tests.blender.test_compositor import added_light, render_pixels, result, result_layers, scene  # noqa: F401
from tests.tolerances import COMPOSITED

DIFFUSE_TINT, GLOSSY_TINT = np.float32([1.0, 0.5, 0.25]), np.float32([0.0, 0.75, 1.0])


@pytest.fixture
def settings(scene):  # noqa: F811
    """The scene's settings, as the extension registers them."""
    properties.register()
    yield scene.ssgi
    properties.unregister()


def scaled_light(layers, diffuse, glossy):
    return diffuse * layers["albedo"] * layers["diffuse"] + glossy * layers["specular"] * layers["glossy"]


def assert_added(picture, direct, light):
    np.testing.assert_allclose(picture, direct + light, rtol=0, atol=COMPOSITED)


def test_settings_scale_each_kind_of_light(scene, settings, result, tmp_path):  # noqa: F811
    path, layers = result
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    assert_added(render_pixels(scene, tmp_path), direct, added_light(layers))
    settings.diffuse_strength, settings.glossy_strength = 1.5, 0.5
    settings.diffuse_tint, settings.glossy_tint = DIFFUSE_TINT, GLOSSY_TINT
    light = scaled_light(layers, 1.5 * DIFFUSE_TINT, 0.5 * GLOSSY_TINT)
    assert_added(render_pixels(scene, tmp_path), direct, light)


def test_settings_from_before_the_group_count(scene, settings, result, tmp_path):  # noqa: F811
    path, layers = result
    direct = render_pixels(scene, tmp_path)
    settings.diffuse_strength = 0.0
    compositor.publish_layers(scene, path, strength=2.0)
    assert_added(render_pixels(scene, tmp_path), direct, 2.0 * scaled_light(layers, 0.0, 1.0))


def test_inputs_show_a_change_at_once(scene, settings, result):  # noqa: F811
    (node,) = compositor.publish_layers(scene, result[0])
    settings.glossy_strength, settings.diffuse_tint = 0.25, DIFFUSE_TINT
    assert node.inputs["Glossy Strength"].default_value == 0.25
    assert tuple(node.inputs["Diffuse Tint"].default_value) == (*DIFFUSE_TINT, 1.0)


def test_strength_can_be_animated(scene, settings, result, tmp_path):  # noqa: F811
    path, layers = result
    direct = render_pixels(scene, tmp_path)
    compositor.publish_layers(scene, path)
    for frame, strength in ((1, 0.0), (3, 2.0)):
        settings.diffuse_strength = strength
        settings.keyframe_insert("diffuse_strength", frame=frame)
    for frame, strength in ((1, 0.0), (2, 1.0), (3, 2.0)):
        scene.frame_set(frame)
        assert_added(render_pixels(scene, tmp_path), direct, scaled_light(layers, strength, 1.0))


def test_group_of_an_earlier_version_gets_the_new_inputs(scene, settings, result, tmp_path):  # noqa: F811
    path, layers = result
    direct = render_pixels(scene, tmp_path)
    (node,) = compositor.publish_layers(scene, path, strength=0.5)
    compositor.layer_look.stop_following(node)
    interface = node.node_tree.interface
    for item in list(interface.items_tree):
        if item.name in layer_group.LIGHT_INPUTS:
            interface.remove(item)
    settings.diffuse_strength = 3.0  # nothing to set yet
    compositor.publish_layers(scene, path)
    assert_added(render_pixels(scene, tmp_path), direct, 0.5 * scaled_light(layers, 3.0, 1.0))


def test_removal_takes_the_drivers_along(scene, settings, result, tmp_path):  # noqa: F811
    path, _ = result
    tree, (output,) = compat.new_compositor_tree(scene)
    render = tree.nodes.new("CompositorNodeRLayers")
    tree.links.new(render.outputs["Image"], output)
    compositor.publish_layers(scene, path)
    assert len(tree.animation_data.drivers) == 8
    compositor.remove_layers(scene)
    assert tree.animation_data is None


def test_scenes_keep_their_own_look(scene, settings, result):  # noqa: F811
    other = bpy.data.scenes.new("Other")
    (node,), (other_node,) = (compositor.publish_layers(owner, result[0]) for owner in (scene, other))
    settings.diffuse_strength = 0.5
    assert node.inputs["Diffuse Strength"].default_value == 0.5
    assert other_node.inputs["Diffuse Strength"].default_value == 1.0


def test_without_the_extension_the_inputs_are_the_users(scene, tmp_path):  # noqa: F811
    path, layers = tmp_path / "result.exr", result_layers()
    write_layers(path, layers)
    direct = render_pixels(scene, tmp_path)
    (node,) = compositor.publish_layers(scene, path)
    node.inputs["Diffuse Strength"].default_value = 0.0
    node.inputs["Glossy Tint"].default_value = (*GLOSSY_TINT, 1.0)
    compositor.publish_layers(scene, path)
    assert_added(render_pixels(scene, tmp_path), direct, scaled_light(layers, 0.0, GLOSSY_TINT))
