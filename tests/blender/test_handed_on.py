# SPDX-License-Identifier: GPL-3.0-or-later
"""What a captured surface hands on to others does not depend on the angle at which the camera sees it."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.build import add_box, add_camera, add_lamp, new_material
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.reference import ReferenceOptions, render_reference
from ssgi_addon.core import DiffuseSettings, ReflectionSettings, Settings, render_indirect
from tests.scenes import LAMPLIGHT, build_closed_room, new_scene
from tests.tolerances import GLOSSY_ROOM_LIGHT, WHOLE_COLOR

COLOR = 0.5
FAR = 10.0  # pixels farther away mix floor and sky
SIZE = (96, 54)


def capture_floor(material):
    """Capture a floor from low above it, under a lamp behind the camera."""
    scene = new_scene("Floor")
    add_box(scene, "Floor", material, (-20.0, -5.0, -0.2), (20.0, 20.0, 0.0))
    add_lamp(scene, "Lamp", "POINT", (0.0, -3.0, 3.0), (0.0, 0.0, 0.0), energy=500.0, color=LAMPLIGHT)
    add_camera(scene, (0.0, -2.0, 0.5), (0.0, 2.0, 0.0), lens=24.0)
    return capture_frame(scene, CaptureOptions(samples=16, denoiser="none"))


def plastic(name, roughness):
    return new_material(name, (COLOR,) * 3, roughness=roughness, specular=0.5)


def metal(roughness):
    return new_material("Metal", (0.9, 0.6, 0.3), roughness=roughness, metallic=1.0)


def test_gloss_at_grazing_angles_takes_no_light_from_what_is_handed_on(empty_file):
    frame = capture_floor(plastic("Plastic", 0.2))
    gbuffer = frame.gbuffer
    is_lit = (gbuffer.depth < FAR) & (frame.layers["Diffuse Direct"].min(axis=-1) > 0.0)
    assert gbuffer.albedo[is_lit].min() < 0.5 * COLOR
    handed_on = gbuffer.source[is_lit] / frame.layers["Diffuse Direct"][is_lit]
    np.testing.assert_allclose(handed_on, COLOR, rtol=WHOLE_COLOR)
    # A mirror shows what the camera would see
    seen = frame.layers["Diffuse Direct"] * gbuffer.albedo + frame.layers["Glossy Direct"] * gbuffer.specular
    np.testing.assert_array_equal(gbuffer.glossy_source, seen)


def test_matte_surfaces_hand_on_their_diffuse_light(empty_file):
    frame = capture_frame(build_closed_room(), CaptureOptions(samples=4, denoiser="none"))
    expected = frame.layers["Diffuse Direct"] * frame.layers["Diffuse Color"]
    np.testing.assert_array_equal(frame.gbuffer.source, expected)


def test_rough_metal_hands_on_the_light_that_it_shows(empty_file):
    gbuffer = capture_floor(metal(0.5)).gbuffer
    assert gbuffer.source.mean() > 0.0
    np.testing.assert_array_equal(gbuffer.source, gbuffer.glossy_source)


def test_mirrors_hand_nothing_on(empty_file):
    gbuffer = capture_floor(metal(0.1)).gbuffer
    assert gbuffer.glossy_source.max() > 0.0
    assert gbuffer.source[gbuffer.depth < FAR].max() == 0.0


def test_room_of_gloss_has_the_diffuse_light_of_cycles(empty_file):
    scene = build_closed_room()
    for material in bpy.data.materials:
        inputs = material.node_tree.nodes["Principled BSDF"].inputs
        inputs["Roughness"].default_value, inputs["Specular IOR Level"].default_value = 0.6, 0.5
    captured = CaptureOptions(samples=32, resolution=SIZE, surround=64, view_samples=16)
    frame = capture_frame(scene, captured)
    truth = render_reference(
        scene,
        ReferenceOptions(
            samples=64, denoiser="none", resolution=SIZE, diffuse_bounces=1, glossy_bounces=1, max_bounces=1
        ),
    ).diffuse_indirect
    settings = Settings(
        reflections=ReflectionSettings(enabled=False),
        diffuse=DiffuseSettings(method="hemisphere", rays=32, bounces=1, filter=False),
    )
    light = render_indirect(frame.gbuffer, frame.camera, settings, None, frame.views)
    is_known = light.known_diffuse >= 0.9
    bias = light.diffuse[is_known].mean(dtype=float) / truth[is_known].mean(dtype=float) - 1.0
    assert bias == pytest.approx(0.0, abs=GLOSSY_ROOM_LIGHT)
