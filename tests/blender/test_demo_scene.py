# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene and the tiny test scenes: they build in every Blender and show what they are for."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.demo_scene import build_demo_scene
from ssgi_addon.exr import read_layers
from tests import scenes
from tests.tolerances import DEMO_MOSTLY_BOUNCED

BUILDERS = [
    scenes.build_closed_room,
    scenes.build_emissive_room,
    scenes.build_open_field,
    scenes.build_mirror_floor,
    scenes.build_ball_over_plane,
]


@pytest.fixture(autouse=True)
def _empty_file():
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def render_pixels(scene, folder, *, indirect, samples=8):
    """Render a thumbnail; (H, W, 3) scene-linear, top row first."""
    render, cycles = scene.render, scene.cycles
    render.resolution_x, render.resolution_y = 48, 27
    cycles.samples = samples
    cycles.use_denoising = False
    if not indirect:
        cycles.diffuse_bounces = cycles.glossy_bounces = 0
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth = "32"
    path = folder / "render.exr"
    render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    return read_layers(path)["Combined"]


def test_most_of_the_demo_scene_is_lit_mostly_by_bounces(tmp_path):
    scene = build_demo_scene()
    with_bounces = render_pixels(scene, tmp_path, indirect=True, samples=64).mean(axis=-1)
    without = render_pixels(scene, tmp_path, indirect=False, samples=64).mean(axis=-1)
    assert np.mean(without < with_bounces / 2) > DEMO_MOSTLY_BOUNCED


def test_demo_scene_renders_with_cycles_at_its_published_size():
    scene = build_demo_scene()
    render = scene.render
    assert (render.engine, render.resolution_x, render.resolution_y) == ("CYCLES", 960, 540)
    assert render.resolution_percentage == 100
    assert scene.camera is not None


def test_demo_scene_holds_what_breaks_screen_space_methods():
    scene = build_demo_scene()
    roughness = {}
    for thing in scene.objects:
        if thing.type == "MESH":
            inputs = thing.data.materials[0].node_tree.nodes["Principled BSDF"].inputs
            roughness[thing.name] = (inputs["Roughness"].default_value, inputs["Metallic"].default_value)
    assert roughness["Mirror Ball"] == (0.0, 1.0)
    assert roughness["Brass Vase"][0] > 0.2
    assert roughness["Brass Vase"][1] == 1.0
    assert 0.0 < roughness["Floor"][0] < 0.3
    legs = [thing for thing in scene.objects if thing.name.startswith("Table Leg")]
    assert len(legs) == 3
    assert all(min(leg.dimensions) < 0.03 for leg in legs)


def test_demo_scene_leaves_other_scenes_alone():
    before = {scene.name: len(scene.objects) for scene in bpy.data.scenes}
    build_demo_scene()
    second = build_demo_scene()
    assert {name: len(bpy.data.scenes[name].objects) for name in before} == before
    # Shared names get numbers; each scene still holds a whole demo
    first = next(scene for scene in bpy.data.scenes if scene.name == "SSGI Demo")
    assert len(first.objects) == len(second.objects)
    assert not set(first.objects) & set(second.objects)


@pytest.mark.parametrize("build", BUILDERS, ids=lambda build: build.__name__)
def test_test_scenes_show_direct_light_and_gain_by_bounces(build, tmp_path):
    scene = build()
    assert bpy.context.scene == scene
    with_bounces = render_pixels(scene, tmp_path, indirect=True)
    without = render_pixels(scene, tmp_path, indirect=False)
    assert without.mean() > 0.0
    assert with_bounces.mean() > without.mean()


def test_closed_room_lets_no_world_light_in(tmp_path):
    scene = scenes.build_closed_room()
    dark = render_pixels(scene, tmp_path, indirect=True)
    scene.world = scenes.new_world("Bright", (1.0, 1.0, 1.0), 1000.0)
    np.testing.assert_array_equal(render_pixels(scene, tmp_path, indirect=True), dark)
