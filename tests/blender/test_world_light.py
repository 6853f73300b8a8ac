# SPDX-License-Identifier: GPL-3.0-or-later
"""The world's light as an image: what each direction brings, and the sun that is taken out of it."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.build import new_world, node_tree
from ssgi_addon.blender.world_light import split_sun, world_radiance
from ssgi_addon.core import Environment
from tests.blender.fingerprint import changes, fingerprint
from tests.tolerances import PANORAMA_LIGHT, SUN_DIRECTION, SUN_IRRADIANCE


def directions_of(height):
    """World directions of a panorama's pixel centres and their solid angles, by Cycles' mapping."""
    row, column = np.mgrid[:height, : 2 * height] + 0.5
    polar, turn = row / height * np.pi, (0.5 - column / (2 * height)) * 2.0 * np.pi
    directions = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
    )
    return directions, np.sin(polar) * (np.pi / height) ** 2


@pytest.fixture
def directions_as_colors(empty_file):
    """A world that shows each direction d as the colour (d + 1) / 2."""
    world = new_world("Directions", (1, 1, 1), 1.0)
    tree = node_tree(world)
    place = tree.nodes.new("ShaderNodeTexCoord")
    color = tree.nodes.new("ShaderNodeVectorMath")
    color.operation = "MULTIPLY_ADD"
    color.inputs[1].default_value = color.inputs[2].default_value = (0.5, 0.5, 0.5)
    tree.links.new(color.inputs[0], place.outputs["Generated"])
    tree.links.new(tree.nodes["Background"].inputs["Color"], color.outputs[0])
    return world


def test_panorama_has_the_mapping_of_the_environment(empty_file, directions_as_colors, rng):
    image = world_radiance(empty_file, directions_as_colors)
    environment = Environment.equirectangular(image, np.eye(3))
    directions = rng.normal(size=(1000, 3)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    found = environment.radiance(*directions.T)
    assert np.abs(found - (0.5 * directions + 0.5)).max() < PANORAMA_LIGHT


def test_making_a_panorama_leaves_nothing_behind(empty_file, directions_as_colors):
    before = fingerprint()
    world_radiance(empty_file, directions_as_colors)
    assert changes(before, fingerprint()) == {}


@pytest.mark.parametrize("strength", [0.0, 0.5, 40.0])
def test_world_of_one_color_is_one_pixel(empty_file, strength):
    image = world_radiance(empty_file, new_world("Even", (0.5, 1.0, 0.25), strength))
    assert image.shape == (1, 1, 3)
    assert np.array_equal(image[0, 0], np.float32((0.5, 1.0, 0.25)) * np.float32(strength))


def test_no_world_is_black(empty_file):
    assert not world_radiance(empty_file, None).any()


def test_world_without_a_surface_is_black(empty_file):
    world = new_world("Cut", (1, 1, 1), 1.0)
    tree = node_tree(world)
    tree.links.clear()
    assert not world_radiance(empty_file, world).any()


def test_what_only_the_camera_sees_lights_nothing(empty_file):
    """A dark backdrop before the camera, in a world that lights surfaces with 0.25."""
    world = new_world("Trick", (1, 1, 1), 0.25)
    tree = node_tree(world)
    mix, backdrop = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBackground")
    backdrop.inputs["Color"].default_value = (9.0, 0.0, 0.0, 1.0)
    camera_ray = tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"]
    for socket, source in zip(
        mix.inputs, (camera_ray, tree.nodes["Background"].outputs[0], backdrop.outputs[0]), strict=True
    ):
        tree.links.new(socket, source)
    tree.links.new(tree.nodes["World Output"].inputs["Surface"], mix.outputs[0])
    assert np.abs(world_radiance(empty_file, world) - 0.25).max() < PANORAMA_LIGHT


def test_volume_of_a_world_does_not_swallow_its_light(empty_file, directions_as_colors):
    tree = directions_as_colors.node_tree
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    clear = world_radiance(empty_file, directions_as_colors)
    tree.links.new(tree.nodes["World Output"].inputs["Volume"], scatter.outputs[0])
    assert np.array_equal(world_radiance(empty_file, directions_as_colors), clear)


def panorama_with_disc(toward, angle, radiance, height=128):
    directions, solid_angles = directions_of(height)
    is_disc = directions @ (toward / np.linalg.norm(toward)) > np.cos(0.5 * angle)
    image = np.full((height, 2 * height, 3), 0.5, np.float32)
    image[is_disc] = radiance
    return image, solid_angles[is_disc].sum()


def test_sun_is_taken_out_with_its_light_and_direction():
    toward = np.array([1.0, -2.0, 1.5])
    image, solid_angle = panorama_with_disc(toward, 0.2, (100.0, 80.0, 40.0))
    rest, sun = split_sun(image, 10.0)
    assert rest.max() <= 10.0
    kept = np.array([10.0, 8.0, 4.0])
    assert np.allclose(sun.irradiance, solid_angle * (np.array([100, 80, 40]) - kept), rtol=SUN_IRRADIANCE)
    assert np.arccos(sun.direction @ toward / np.linalg.norm(toward)) < SUN_DIRECTION


@pytest.mark.parametrize("threshold", [0.0, 200.0])
def test_what_is_below_the_threshold_stays(threshold):
    image, _ = panorama_with_disc(np.array([1.0, 0.0, 1.0]), 0.2, (100.0, 80.0, 40.0))
    rest, sun = split_sun(image, threshold)
    assert sun is None
    assert np.array_equal(rest, image)


def test_lamps_all_around_are_no_sun():
    image, _ = panorama_with_disc(np.array([1.0, 0.0, 1.0]), 0.2, (100.0, 80.0, 40.0))
    image = np.maximum(image, np.roll(image, 128, axis=1))
    rest, sun = split_sun(image, 10.0)
    assert sun is None
    assert np.array_equal(rest, image)
