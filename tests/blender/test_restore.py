# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture leaves the user's file exactly as it was, however it ends."""

from __future__ import annotations

import contextlib

import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import beyond, capture, compat, cycles_passes, hidden_surfaces, roughness, views
from ssgi_addon.blender.build import add_box, new_material, node_tree
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.cycles_passes import cycles_engine
from ssgi_addon.blender.reference import ReferenceOptions, render_reference
from ssgi_addon.blender.restore import Restorer
from ssgi_addon.errors import SSGIError
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.test_roughness import MATERIALS, add_tile, look_down, material_of

OPTIONS = CaptureOptions(
    samples=1,
    resolution=(16, 12),
    frame=3,
    overscan=1.5,
    surround=4,
    light_views=1,
    view_size=4,
    view_samples=1,
    back_faces=True,
    behind=True,
    fill=1,
)


@pytest.fixture(autouse=True)
def _everything_is_needed(monkeypatch):
    """All that is wanted beyond the frame is captured, whatever its rays lose."""
    monkeypatch.setattr(beyond, "LEAST_LOST", 0.0)


@pytest.fixture(params=["aov", "native"])
def scene(request, empty_file, monkeypatch):
    if request.param == "aov":
        for module in (capture, views, hidden_surfaces):
            monkeypatch.setattr(module, "borrow_roughness", roughness.borrow_aov_roughness)
    elif not compat.has_roughness_pass(empty_file.view_layers[0]):
        pytest.skip("this Blender has no roughness among its denoising passes")
    return build_rich_scene(empty_file)


def build_rich_scene(scene):
    """A file with much to lose: all kinds of materials, volumes, settings, and a compositor on its passes."""
    for index, name in enumerate(MATERIALS):
        add_tile(scene, index, material_of(name))
    look_down(scene, 4)
    _add_volumes(scene)
    _change_settings(scene)
    _build_compositor(scene)
    scene.camera.keyframe_insert("location", frame=1)
    scene.timeline_markers.new("Cut", frame=2).camera = scene.camera
    scene.frame_set(1)
    return scene


def _add_volumes(scene):
    fog = new_material("Fog", (1, 1, 1))
    fog.node_tree.nodes.clear()
    scene.world = bpy.data.worlds.new("World")
    for tree, kind in (
        (fog.node_tree, "ShaderNodeOutputMaterial"),
        (node_tree(scene.world), "ShaderNodeOutputWorld"),
    ):
        output = next((node for node in tree.nodes if node.bl_idname == kind), None) or tree.nodes.new(kind)
        scatter = tree.nodes.new("ShaderNodeVolumeScatter")
        tree.links.new(output.inputs["Volume"], scatter.outputs[0])
    add_box(scene, "Fog", fog, (0, -1, 1), (1, 0, 2))


def _change_settings(scene):
    scene.render.use_border = True
    scene.render.use_motion_blur = True
    scene.render.use_freestyle = True
    scene.render.resolution_percentage = 50
    scene.cycles.samples = 77
    scene.cycles.use_fast_gi = True
    scene.cycles.pixel_filter_type = "BOX"
    scene.camera.data.dof.use_dof = True
    scene.view_layers.new("Second").use_pass_uv = True
    layer = scene.view_layers[0]
    for name in ("User Value", "SSGI Roughness"):
        layer.aovs.add().name = name
    layer.active_aov_index = 0
    layer.use_pass_mist = True
    layer.cycles.denoising_store_passes = True


def _build_compositor(scene):
    """Link every pass, those of the denoiser too: their sockets vanish while denoising is off."""
    scene.render.engine = "CYCLES"
    tree, outputs = compat.new_compositor_tree(scene)
    source = tree.nodes.new("CompositorNodeRLayers")
    source.scene = scene
    source.layer = scene.view_layers[0].name
    tree.links.new(outputs[0], source.outputs["Image"])
    for name in ("Noisy Image", "Denoising Normal", "Mist", "User Value"):
        viewer = tree.nodes.new("CompositorNodeViewer")
        tree.links.new(viewer.inputs[0], source.outputs[name])


def assert_unchanged(before):
    assert changes(before, fingerprint()) == {}


def test_everything_is_restored_after_a_capture(scene):
    before = fingerprint()
    capture_frame(scene, OPTIONS)
    assert_unchanged(before)


def test_other_render_engine_is_restored(scene):
    scene.render.engine = "BLENDER_WORKBENCH"
    before = fingerprint()
    capture_frame(scene, OPTIONS)
    assert_unchanged(before)


def test_everything_is_restored_after_a_reference(scene):
    before = fingerprint()
    render_reference(scene, ReferenceOptions(samples=1, resolution=(16, 12), diffuse_bounces=1, seed=5))
    assert_unchanged(before)


@pytest.mark.parametrize("step", ["Geometry", "Direct light", "Surround", "Back faces", "Layer behind"])
def test_everything_is_restored_when_a_step_is_interrupted(scene, step):
    def interrupt(fraction, text):
        if text == step:
            raise KeyboardInterrupt

    before = fingerprint()
    with pytest.raises(KeyboardInterrupt):
        capture_frame(scene, OPTIONS, interrupt)
    assert_unchanged(before)


def test_everything_is_restored_when_the_render_is_cancelled(scene, monkeypatch):
    """Blender then ends the render before any layer is finished."""
    monkeypatch.setattr(cycles_passes, "_after_render", lambda engine_class, read: contextlib.nullcontext())
    before = fingerprint()
    with pytest.raises(SSGIError, match="cancelled"):
        capture_frame(scene, OPTIONS)
    assert_unchanged(before)


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_everything_is_restored_when_the_engine_fails(scene, monkeypatch, failure):
    def fail(engine, depsgraph):
        raise failure("in the middle of a render")

    monkeypatch.setattr(cycles_engine(), "render", fail)
    before = fingerprint()
    with pytest.raises(failure, match="in the middle of a render"):
        capture_frame(scene, OPTIONS)
    assert cycles_engine().render is fail
    assert_unchanged(before)


def test_everything_is_restored_after_a_refusal(scene):
    scene.camera.data.type = "PANO"
    before = fingerprint()
    with pytest.raises(SSGIError, match="panoramic"):
        capture_frame(scene, OPTIONS)
    assert_unchanged(before)


def test_engine_is_as_before_a_capture(scene):
    original = cycles_engine().render
    capture_frame(scene, OPTIONS)
    assert cycles_engine().render is original


def test_one_failing_undo_does_not_stop_the_others(empty_file):
    render = empty_file.render
    before = (render.resolution_x, render.resolution_y)
    with pytest.raises(ZeroDivisionError), Restorer() as restorer:
        restorer.change(render, resolution_x=10)
        restorer.callback(lambda: 1 // 0)
        restorer.change(render, resolution_y=10)
    assert (render.resolution_x, render.resolution_y) == before


def test_a_property_that_was_never_set_is_unset_again(empty_file):
    with Restorer() as restorer:
        restorer.change(empty_file.cycles, samples=3)
        assert empty_file.cycles.samples == 3
    assert not empty_file.cycles.is_property_set("samples")
