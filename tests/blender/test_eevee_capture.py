# SPDX-License-Identifier: GPL-3.0-or-later
"""What a capture through EEVEE holds: Cycles' geometry, the light of lamps, and the rest as sources."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import compat, eevee_passes
from ssgi_addon.blender.build import (
    add_ball,
    add_box,
    add_camera,
    add_lamp,
    new_material,
    new_world,
    node_tree,
)
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.job import render_frame
from ssgi_addon.core import Settings
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers
from ssgi_addon.job_options import JobOptions
from ssgi_addon.results import apply_passes
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.opengl import needs_opengl
from tests.blender.test_capture import (
    set_pixel_aspect,
    set_scaled_parent,
    set_shift,
    set_shifted_orthographic_border,
)
from tests.blender.test_restore import build_rich_scene
from tests.scenes import WHITE, new_scene
from tests.tolerances import (
    EEVEE_DEPTH,
    EEVEE_HALF,
    EEVEE_LAMP_LIGHT,
    EEVEE_NORMAL,
    EEVEE_SILHOUETTE,
    ROUGHNESS_AOV_HALF,
    SUN_IRRADIANCE,
)

SKY, GLOW = (0.5, 0.6, 0.7), (2.0, 1.0, 0.5)
ROOT = Path(__file__).parents[2]


def options(engine, **more):
    return CaptureOptions(engine=engine, samples=4, denoiser="none", **more)


def build_yard():
    """A lamp above boxes, a rough and a shining ball, and a glowing block, under an even sky."""
    scene = new_scene("Yard")
    scene.world = new_world("Sky", SKY, 1.0)
    scene.render.resolution_x, scene.render.resolution_y = 64, 40
    clay = new_material("Clay", WHITE, roughness=1.0, specular=0.0)
    glazed = new_material("Glazed", (0.2, 0.4, 0.7), roughness=0.3)
    add_box(scene, "Ground", clay, (-3.0, -3.0, -0.2), (3.0, 3.0, 0.0))
    add_box(scene, "Block", clay, (-1.6, 0.2, 0.0), (-0.6, 1.4, 1.2))
    add_box(scene, "Glow", new_material("Glow", GLOW, emission=1.0), (0.9, 0.5, 0.0), (1.7, 1.3, 0.8))
    add_ball(scene, "Ball", glazed, (0.1, -0.6, 0.5), 0.5)
    lamp = add_lamp(scene, "Lamp", "POINT", (0.0, -1.0, 2.5), (0, 0, 0), energy=100.0, color=(1, 1, 1))
    lamp.data.shadow_soft_size = 0.2
    add_camera(scene, (0.6, -5.0, 2.6), (0.0, 0.3, 0.5), lens=32.0)
    set_shift(scene)
    return scene


@pytest.fixture(scope="module", name="frames")
def captured_by_both():
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = build_yard()
    return {engine: capture_frame(scene, options(engine)) for engine in ("cycles", "eevee")}


@pytest.fixture
def box(empty_file):
    """As little as can be rendered."""
    add_box(empty_file, "Box", new_material("Clay", WHITE), (-1, 2, -1), (1, 3, 0))
    add_camera(empty_file, (0, 0, 0), (0, 2, 0), lens=50.0)
    empty_file.render.resolution_x, empty_file.render.resolution_y = 16, 12
    empty_file.render.image_settings.file_format = "JPEG"
    return empty_file


# --- Geometry ---------------------------------------------------------------------------------------------


@needs_opengl
def test_geometry_is_that_of_cycles(frames):
    ours, cycles = frames["eevee"].gbuffer, frames["cycles"].gbuffer
    is_same_surface = np.isclose(ours.depth, cycles.depth, rtol=EEVEE_DEPTH)
    is_same_surface |= ours.is_background & cycles.is_background
    assert (~is_same_surface).mean() < EEVEE_SILHOUETTE
    difference = np.abs(ours.normal - cycles.normal).max(axis=-1)
    assert (difference[is_same_surface] > EEVEE_NORMAL).mean() < EEVEE_SILHOUETTE
    assert ours.is_background.any()


@needs_opengl
def test_camera_and_positions_are_those_of_cycles(frames):
    ours, cycles = frames["eevee"].camera, frames["cycles"].camera
    assert (ours.fx, ours.fy, ours.cx, ours.cy) == (cycles.fx, cycles.fy, cycles.cx, cycles.cy)
    assert np.array_equal(ours.world_from_view, cycles.world_from_view)
    apart = np.linalg.norm(frames["eevee"].layers["Position"] - frames["cycles"].layers["Position"], axis=-1)
    is_off = apart > EEVEE_DEPTH * frames["cycles"].layers["Depth"]
    assert is_off.mean() < EEVEE_SILHOUETTE
    assert not frames["eevee"].layers["Position"][frames["eevee"].gbuffer.is_background].any()


@needs_opengl
def test_sky_is_background_and_shows_the_world(frames):
    gbuffer = frames["eevee"].gbuffer
    is_sky = gbuffer.is_background
    assert np.isposinf(gbuffer.depth[0]).all()
    assert not gbuffer.normal[is_sky].any()
    assert np.allclose(np.median(gbuffer.direct[is_sky], axis=0), SKY, rtol=EEVEE_HALF)


@needs_opengl
def test_roughness_comes_from_temporary_nodes(frames):
    ours, cycles = frames["eevee"].gbuffer, frames["cycles"].gbuffer
    is_ball = np.abs(cycles.roughness - 0.3) < 0.02
    assert is_ball.sum() > 50
    is_off = np.abs(ours.roughness[is_ball] - 0.3) > ROUGHNESS_AOV_HALF
    assert is_off.mean() < EEVEE_SILHOUETTE


def make_another_scene_current(scene):
    bpy.context.window.scene = bpy.data.scenes.new("Other")


@needs_opengl
@pytest.mark.parametrize(
    "change", [set_shifted_orthographic_border, set_scaled_parent, make_another_scene_current]
)
def test_framing_is_that_of_cycles(box, change):
    change(box)
    ours, cycles = (capture_frame(box, options(engine)) for engine in ("eevee", "cycles"))
    assert ours.gbuffer.shape == (ours.camera.height, ours.camera.width)
    assert np.array_equal(ours.camera.world_from_view, cycles.camera.world_from_view)
    assert not ours.gbuffer.is_background.all()
    is_same = np.isclose(ours.gbuffer.depth, cycles.gbuffer.depth, rtol=EEVEE_DEPTH)
    assert (~is_same).mean() < EEVEE_SILHOUETTE


# --- Who counts which light -------------------------------------------------------------------------------


@needs_opengl
def test_frame_states_what_its_direct_light_lacks(frames):
    frame = frames["eevee"]
    assert frame.engine == "eevee"
    assert not frame.emission_in_direct
    assert not frame.world_in_direct
    assert frame.environment.is_constant
    assert np.allclose(frame.environment.image[0, 0], SKY)


@needs_opengl
def test_lamps_light_surfaces_as_in_cycles(frames):
    """The world and the glowing block are in Cycles' direct passes, so it renders the lamp alone here."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = build_yard()
    scene.world = None
    bpy.data.materials["Glow"].node_tree.nodes["Principled BSDF"].inputs[
        "Emission Strength"
    ].default_value = 0
    cycles = capture_frame(scene, CaptureOptions(samples=64, denoiser="none")).gbuffer
    ours = frames["eevee"].gbuffer
    layers = frames["eevee"].layers
    reflected = ours.direct - layers["Emission"] - layers["Environment"]
    assert reflected.mean() == pytest.approx(cycles.direct.mean(), rel=EEVEE_LAMP_LIGHT)


@needs_opengl
def test_sources_hold_emission_but_not_the_world(frames):
    frame = frames["eevee"]
    is_glow = np.isclose(frame.layers["Emission"], GLOW, rtol=EEVEE_HALF).all(axis=-1)
    is_sky = np.isclose(frame.layers["Environment"], SKY, rtol=EEVEE_HALF).all(axis=-1)
    assert is_glow.any()
    assert is_sky.any()
    for source in (frame.gbuffer.source, frame.gbuffer.glossy_source):
        assert (source[is_glow] >= frame.layers["Emission"][is_glow]).all()
        assert not source[is_sky].any()


@needs_opengl
def test_probes_and_ray_tracing_add_no_light(box):
    box.world = new_world("Sky", SKY, 1.0)
    box.eevee.use_raytracing = box.eevee.use_fast_gi = True
    probe = bpy.data.objects.new("Probe", bpy.data.lightprobes.new("Probe", "SPHERE"))
    probe.location = (0.0, 1.0, 0.0)
    box.collection.objects.link(probe)
    gbuffer = capture_frame(box, options("eevee")).gbuffer
    assert not gbuffer.source[~gbuffer.is_background].any()


def new_sun_world(toward):
    """A black world with a bright disc of 11 degrees around a direction."""
    world = new_world("Sun", (1, 1, 1), 0.0)
    tree = node_tree(world)
    place = tree.nodes.new("ShaderNodeTexCoord")
    cosine = tree.nodes.new("ShaderNodeVectorMath")
    cosine.operation = "DOT_PRODUCT"
    cosine.inputs[1].default_value = toward
    disc, bright = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("ShaderNodeMath")
    disc.operation, bright.operation = "GREATER_THAN", "MULTIPLY"
    disc.inputs[1].default_value, bright.inputs[1].default_value = 0.995, 100.0
    for socket, source in (
        (cosine.inputs[0], place.outputs["Generated"]),
        (disc.inputs[0], cosine.outputs["Value"]),
        (bright.inputs[0], disc.outputs[0]),
        (tree.nodes["Background"].inputs["Strength"], bright.outputs[0]),
    ):
        tree.links.new(socket, source)
    return world


@needs_opengl
def test_sun_of_a_world_is_a_lamp_and_not_in_the_environment(empty_file):
    """A white floor under a sun of known size and brightness, of which the threshold leaves a tenth."""
    toward = np.array([0.48, 0.6, 0.64])
    empty_file.world = new_sun_world(toward)
    floor = new_material("Floor", WHITE, roughness=1.0, specular=0.0)
    add_box(empty_file, "Floor", floor, (-50, -50, -1), (50, 50, 0))
    add_camera(empty_file, (0, 0, 2), (0, 0.01, 0), lens=50.0)
    empty_file.render.resolution_x, empty_file.render.resolution_y = 8, 8
    frame = capture_frame(empty_file, options("eevee"))
    irradiance = 2.0 * np.pi * (1.0 - 0.995) * (100.0 - empty_file.world.sun_threshold) * toward[2]
    expected = WHITE[0] / np.pi * irradiance
    assert frame.gbuffer.direct.mean() == pytest.approx(expected, rel=EEVEE_LAMP_LIGHT)
    rest = frame.environment.image.max()
    assert rest == pytest.approx(empty_file.world.sun_threshold, rel=SUN_IRRADIANCE)
    assert not bpy.data.lights


# --- Scene and files are as before ------------------------------------------------------------------------


@needs_opengl
@pytest.mark.parametrize("surround", [0, 4])
def test_everything_is_restored(empty_file, surround):
    scene = build_rich_scene(empty_file)
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.linear_colorspace_settings.name = "ACEScg"
    before = fingerprint()
    capture_frame(scene, options("eevee", resolution=(16, 12), frame=3, surround=surround))
    assert changes(before, fingerprint()) == {}


@needs_opengl
@pytest.mark.parametrize("step", ["Geometry", "Direct light"])
def test_everything_is_restored_when_a_step_is_interrupted(box, step):
    def interrupt(fraction, text):
        if text == step:
            raise KeyboardInterrupt

    before = fingerprint()
    with pytest.raises(KeyboardInterrupt):
        capture_frame(box, options("eevee"), interrupt)
    assert changes(before, fingerprint()) == {}


@needs_opengl
@pytest.mark.parametrize("is_damaged", [False, True])
def test_temporary_files_are_gone_afterwards(box, tmp_path, monkeypatch, is_damaged):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = fingerprint()
    if is_damaged:
        monkeypatch.setattr(eevee_passes, "read_layers", lambda path: {})
        with pytest.raises(SSGIError, match="wrote no pass Depth, Normal, .*use the engine cycles"):
            capture_frame(box, options("eevee"))
    else:
        capture_frame(box, options("eevee"))
    assert not list(tmp_path.iterdir())
    assert changes(before, fingerprint()) == {}
    assert not [handler for handler in bpy.app.handlers.frame_change_post if "ssgi" in handler.__module__]


# --- The job ----------------------------------------------------------------------------------------------


@needs_opengl
def test_saved_passes_give_the_same_picture_again(box, tmp_path):
    box.world = new_world("Sky", SKY, 1.0)
    result = render_frame(
        box,
        JobOptions(
            output=tmp_path,
            settings=Settings.preset("draft"),
            engine="eevee",
            samples=1,
            surround=8,
            save_passes=True,
        ),
    )
    assert json.loads((tmp_path / "report.json").read_text())["settings"]["engine"] == "eevee"
    again = tmp_path / "again" / "again.exr"
    apply_passes(tmp_path / "passes" / result.exr_path.name, again, None, Settings.preset("draft"))
    expected, found = read_layers(result.exr_path), read_layers(again)
    assert found["diffuse"].max() > 0.0  # the sky: there is no other light
    for name in ("combined", "diffuse", "glossy", "visibility"):
        assert np.array_equal(found[name], expected[name]), name


# --- Refusals ---------------------------------------------------------------------------------------------


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="OpenGL is part of other systems")
def test_missing_opengl_is_one_clear_line_and_no_crash(empty_file, tmp_path):
    add_camera(empty_file, (0, 0, 0), (0, 2, 0), lens=50.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), copy=True)
    command = [sys.executable, "-m", "ssgi_addon", "render", str(tmp_path / "a.blend")]
    command += ["--engine", "eevee", "--output", str(tmp_path / "out")]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path), "DISPLAY": "", "WAYLAND_DISPLAY": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert "EEVEE cannot render here" in done.stderr
    assert "use the engine cycles" in done.stderr


@needs_opengl
def test_oblong_pixels_are_captured_or_refused(box):
    set_pixel_aspect(box)
    if compat.writes_oblong_pixels():
        assert not capture_frame(box, options("eevee")).gbuffer.is_background.all()
    else:
        with pytest.raises(SSGIError, match="not square: use the engine cycles"):
            capture_frame(box, options("eevee"))


@needs_opengl
def test_refusals_are_those_of_cycles(box):
    box.camera.data.type = "PANO"
    before = fingerprint()
    with pytest.raises(SSGIError, match="panoramic"):
        capture_frame(box, options("eevee"))
    assert changes(before, fingerprint()) == {}
