# SPDX-License-Identifier: GPL-3.0-or-later
"""The world's light as an image, and worlds that show in the background but light nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from . import compat
from .cycles_passes import render_passes
from .restore import Restorer
from .shader_trees import active_link

FloatArray = NDArray[np.float32]

# The panorama: fine enough for diffuse light and for what rough surfaces reflect. Many samples, since a sun
# is smaller than a pixel of it; an empty scene renders them in a second or two.
_HEIGHT = 128
_SAMPLES = 256
# How much of what is above the threshold must come from one direction to be a sun: length of the mean
# direction. Half of it from the opposite side would leave 0.
_LEAST_CONCENTRATION = 0.95


@dataclass(frozen=True)
class Sun:
    """The part of a world's light that is too bright and too small to be found by rays.

    Attributes
    ----------
    direction : (3,)
        Toward it, world space, unit length.
    irradiance : (3,)
        On a surface that faces it, W/m².
    """

    direction: NDArray[np.float64]
    irradiance: NDArray[np.float64]


def world_radiance(scene: bpy.types.Scene, world: bpy.types.World | None) -> FloatArray:
    """Return what surfaces receive from each direction of a world, in Cycles' equirectangular mapping.

    Parameters
    ----------
    scene
        Tells the frame; the file is exactly as before afterwards.
    world
        None is black.

    Returns
    -------
    numpy.ndarray
        (H, W, 3) radiance; (1, 1, 3) where every direction brings the same. What the world shows to diffuse
        rays where it looks different to the camera ("Is Camera Ray").

    Raises
    ------
    SSGIError
        If the world is more than a colour and Cycles, which renders its panorama, is not there.
    """
    if world is None:
        return np.zeros((1, 1, 3), np.float32)
    color = _even_color(world)
    if color is not None:
        return np.asarray(color, np.float32).reshape(1, 1, 3)
    with Restorer() as restorer:
        copy = _copy_world(restorer, world)
        _answer_as_diffuse_ray(copy.node_tree)
        return _panorama(restorer, scene, copy)


def borrow_backdrop(restorer: Restorer, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Let the world be seen by the camera, but light nothing, until `restorer` closes."""
    world = compat.world_of(view_layer)
    if world is None:
        return
    copy = _copy_world(restorer, world)
    tree = copy.node_tree
    output = _only_output(tree)
    link = active_link(output.inputs["Surface"])
    if link is not None:
        camera_ray = tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"]
        mix = tree.nodes.new("ShaderNodeMixShader")  # with nothing, which is black
        tree.links.new(mix.inputs[2], link.from_socket)
        tree.links.new(mix.inputs[0], camera_ray)
        tree.links.new(output.inputs["Surface"], mix.outputs[0])
    compat.borrow_world(restorer, view_layer, copy)


def split_sun(radiance: FloatArray, threshold: float) -> tuple[FloatArray, Sun | None]:
    """Take a sun out of a world's light, as EEVEE does: what is brighter than a threshold.

    Parameters
    ----------
    radiance : (H, W, 3)
        From `world_radiance`.
    threshold
        Of the largest channel; 0 leaves everything as it is.

    Returns
    -------
    radiance : (H, W, 3)
        The rest.
    sun
        None where nothing is brighter, or where that comes from several directions: one lamp would put
        it into the wrong place.
    """
    brightest = radiance.max(axis=-1, keepdims=True)
    if threshold <= 0.0 or radiance.shape[:2] == (1, 1) or brightest.max() <= threshold:
        return radiance, None
    rest = radiance * np.minimum(threshold / np.maximum(brightest, threshold), 1.0)
    directions, solid_angles = _directions(*radiance.shape[:2])
    light = (radiance - rest).astype(np.float64) * solid_angles[..., None]
    irradiance = light.sum(axis=(0, 1))
    mean_direction = (directions * light.mean(axis=-1, keepdims=True)).sum(axis=(0, 1)) / irradiance.mean()
    concentration = float(np.linalg.norm(mean_direction))
    if concentration < _LEAST_CONCENTRATION:
        return radiance, None
    return rest.astype(np.float32), Sun(mean_direction / concentration, irradiance)


def borrow_sun(restorer: Restorer, scene: bpy.types.Scene, sun: Sun, angle: float) -> None:
    """Put a lamp into `scene` that shines as `sun` does, with shadows; `angle` is its width, radians."""
    light = bpy.data.lights.new("SSGI World Sun", "SUN")
    restorer.callback(bpy.data.lights.remove, light)
    strength = float(sun.irradiance.max())
    light.energy, light.color, light.angle = strength, sun.irradiance / strength, angle
    lamp = bpy.data.objects.new(light.name, light)
    restorer.callback(bpy.data.objects.remove, lamp)
    lamp.rotation_euler = Vector(sun.direction).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(lamp)


def _even_color(world: bpy.types.World) -> tuple[float, ...] | None:
    """Return the radiance of a world that is one colour; None where it may be more."""
    if not compat.uses_nodes(world):
        return tuple(world.color)
    output = world.node_tree.get_output_node("EEVEE")
    link = None if output is None else active_link(output.inputs["Surface"])
    if link is None:
        return (0.0, 0.0, 0.0)
    color, strength = (link.from_node.inputs.get(name) for name in ("Color", "Strength"))
    is_plain = link.from_node.bl_idname == "ShaderNodeBackground" and not link.from_node.mute
    if not is_plain or active_link(color) is not None or active_link(strength) is not None:
        return None
    return tuple(max(channel * strength.default_value, 0.0) for channel in color.default_value[:3])


def _copy_world(restorer: Restorer, world: bpy.types.World) -> bpy.types.World:
    """Return a copy that is made of nodes and that nobody uses yet."""
    copy = world.copy()
    restorer.callback(bpy.data.worlds.remove, copy)
    if not compat.uses_nodes(copy):
        tree = compat.switch_nodes_on(copy)
        tree.nodes.clear()
        background = tree.nodes.new("ShaderNodeBackground")
        background.inputs["Color"].default_value = (*copy.color, 1.0)
        output = tree.nodes.new("ShaderNodeOutputWorld")
        tree.links.new(output.inputs["Surface"], background.outputs[0])
    return copy


def _answer_as_diffuse_ray(tree: bpy.types.NodeTree) -> None:
    """Put into each Light Path node's place what it says of the rays that light surfaces."""
    for node in [node for node in tree.nodes if node.bl_idname == "ShaderNodeLightPath"]:
        for name, value in (("Is Camera Ray", 0.0), ("Is Diffuse Ray", 1.0)):
            constant = tree.nodes.new("ShaderNodeValue")
            constant.outputs[0].default_value = value
            for socket in [link.to_socket for link in node.outputs[name].links]:
                tree.links.new(socket, constant.outputs[0])


def _only_output(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """Return the output that EEVEE renders, made the one that every engine renders."""
    output = tree.get_output_node("EEVEE") or tree.nodes.new("ShaderNodeOutputWorld")
    for node in [node for node in tree.nodes if node.bl_idname == output.bl_idname and node != output]:
        tree.nodes.remove(node)
    output.target = "ALL"
    return output


def _panorama(restorer: Restorer, scene: bpy.types.Scene, world: bpy.types.World) -> FloatArray:
    """Render a world through Cycles, alone in a scene of its own."""
    volume = active_link(_only_output(world.node_tree).inputs["Volume"])
    if volume is not None:
        world.node_tree.links.remove(volume)  # it would swallow the light
    studio = bpy.data.scenes.new("SSGI World")
    restorer.callback(bpy.data.scenes.remove, studio)
    studio.world = world
    studio.frame_set(scene.frame_current, subframe=scene.frame_subframe)
    data = bpy.data.cameras.new(studio.name)
    restorer.callback(bpy.data.cameras.remove, data)
    data.type = "PANO"
    compat.set_equirectangular(data)
    camera = bpy.data.objects.new(studio.name, data)
    restorer.callback(bpy.data.objects.remove, camera)
    camera.rotation_euler = (math.pi / 2.0, 0.0, -math.pi / 2.0)  # the image's middle is +X
    studio.collection.objects.link(camera)
    studio.camera = camera
    render = studio.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 2 * _HEIGHT, _HEIGHT, 100
    render.use_compositing = render.use_sequencer = False
    cycles = studio.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = _SAMPLES, False, False
    cycles.pixel_filter_type = "BOX"
    return render_passes(studio, studio.view_layers[0], ("Combined",)).layers["Combined"]


def _directions(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World-space direction (H, W, 3) and solid angle (H, W) of each pixel of a panorama."""
    polar = (np.arange(height) + 0.5) / height * np.pi
    turn = (0.5 - (np.arange(width) + 0.5) / width) * 2.0 * np.pi
    polar, turn = np.meshgrid(polar, turn, indexing="ij")
    directions = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
    )
    return directions, np.sin(polar) * (np.pi / height) * (2.0 * np.pi / width)
