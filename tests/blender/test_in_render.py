# SPDX-License-Identifier: GPL-3.0-or-later
"""Ordinary renders with the light switched on: the picture, its passes, and a scene that stays as it was."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import addon_utils

from ssgi_addon import properties
from ssgi_addon.blender import compat, in_render
from ssgi_addon.blender.build import add_box, new_material, node_tree
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.cycles_passes import cycles_engine, write_result
from ssgi_addon.blender.declared_passes import DIFFUSE, GLOSSY, OUTPUTS, PICTURE, VISIBILITY
from ssgi_addon.exr import LONG_NAMES, read_layers
from ssgi_addon.results import compute_picture
from tests.blender.fingerprint import changes, fingerprint
from tests.scenes import build_closed_room, build_mirror_floor
from tests.tolerances import COMPOSITED, PASS_SUM_RELATIVE


@pytest.fixture(scope="module", autouse=True)
def _registered():
    """What registering the extension brings for these renders, without its operators and panels."""
    properties.register()
    in_render.register()
    yield
    in_render.unregister()
    properties.unregister()


@pytest.fixture
def room(empty_file):
    """A small closed room with a box of glossy metal in it, the light not yet switched on."""
    scene = build_closed_room()
    chrome = new_material("Chrome", (0.9, 0.8, 0.7), roughness=0.3, metallic=1.0)
    add_box(scene, "Chrome", chrome, (0.4, 0.2, 0.0), (1.2, 0.9, 0.9))
    scene.render.resolution_x, scene.render.resolution_y = 32, 18
    scene.cycles.samples = 2
    scene.ssgi.preset = "draft"
    scene.ssgi.diffuse.resolution = scene.ssgi.reflections.resolution = "full"
    scene.ssgi.enabled = False  # so that switching it off again changes nothing
    return scene


@pytest.fixture
def seen(monkeypatch):
    """Passes of each layer, of its last render, as Cycles left them and as they are afterwards."""
    found = {}

    def spy(engine, layer_name, images):
        before = raw_passes(engine, layer_name)
        write_result(engine, layer_name, images)
        found[layer_name] = SimpleNamespace(before=before, after=raw_passes(engine, layer_name))

    monkeypatch.setattr(in_render, "write_result", spy)
    return found


def raw_passes(engine, layer_name):
    result = engine.get_result()
    found = {}
    for one in result.layers[layer_name].passes:
        pixels = np.empty(result.resolution_x * result.resolution_y * one.channels, dtype=np.float32)
        one.rect.foreach_get(pixels)
        name = LONG_NAMES.get(one.name, one.name)
        found[name] = pixels.reshape(result.resolution_y, result.resolution_x, one.channels)[::-1]
    return found


def render(scene, **options):
    bpy.ops.render.render(scene=scene.name, **options)


def render_file(scene, path):
    """Render to a multilayer EXR file and return its layers."""
    for name, value in compat.multilayer_exr_format().items():
        setattr(scene.render.image_settings, name, value)
    scene.render.filepath = str(path)
    render(scene, write_still=True)
    return read_layers(path)


def added(passes):
    """The light that the outputs hold, as it enters the picture."""
    return (
        passes["Diffuse Color"][..., :3] * passes[DIFFUSE][..., :3]
        + passes["Glossy Color"][..., :3] * passes[GLOSSY][..., :3]
    )


# --- The picture ------------------------------------------------------------------------------------------


def test_picture_is_that_of_a_capture_with_as_many_samples(room, seen):
    room.ssgi.enabled = True
    render(room)
    options = CaptureOptions(samples=2, denoiser="none", own_geometry=False, keep_passes=False)
    picture = compute_picture(capture_frame(room, options), properties.core_settings(room.ssgi))
    (layer,) = seen.values()
    assert np.array_equal(layer.after["Combined"][..., :3], picture.combined)
    assert np.array_equal(layer.after[VISIBILITY][..., 0], picture.light.visibility)


def test_outputs_add_up_to_the_picture(room, seen):
    room.ssgi.enabled = True
    render(room)
    (layer,) = seen.values()
    expected = layer.before["Combined"][..., :3] + added(layer.after)
    assert np.abs(layer.after[PICTURE][..., :3] - expected).max() <= PASS_SUM_RELATIVE * expected.max()
    assert np.array_equal(layer.after["Combined"][..., :3], layer.after[PICTURE][..., :3])
    assert added(layer.after).mean() > 0.1 * layer.before["Combined"][..., :3].mean()
    assert (layer.after[DIFFUSE][..., 3] == 1.0).all()


def test_combined_and_all_other_passes_stay_on_request(room, seen):
    room.view_layers[0].use_pass_mist = True
    room.view_layers[0].aovs.add().name = "User Value"
    room.view_layers[0].use_pass_cryptomatte_object = True
    room.ssgi.enabled = True
    room.ssgi.replace_combined = False
    render(room)
    (layer,) = seen.values()
    changed = {name for name, image in layer.before.items() if not np.array_equal(image, layer.after[name])}
    assert changed == set(OUTPUTS)
    assert {"Mist", "User Value", "CryptoObject00"} <= layer.before.keys()


def test_alpha_stays_and_outputs_take_it(room, seen):
    room.objects["Back"].hide_render = True
    room.render.film_transparent = True
    room.ssgi.enabled = True
    render(room)
    (layer,) = seen.values()
    alpha = layer.before["Combined"][..., 3]
    assert alpha.min() == 0.0
    assert alpha.max() == 1.0
    assert np.array_equal(layer.after["Combined"][..., 3], alpha)
    assert np.array_equal(layer.after[PICTURE][..., 3], alpha)
    assert not layer.after["Combined"][alpha == 0.0].any()


def test_cycles_bounces_are_taken_out_where_they_are_kept(room, seen):
    """With Replace GI off the render has both, and our picture holds the same direct light as without."""
    room.ssgi.enabled = True
    render(room)
    (direct,) = seen.values()
    room.ssgi.replace_gi = False
    render(room)
    (both,) = seen.values()
    bounced = both.before["Combined"] - direct.before["Combined"]
    assert bounced.mean() > 0.1 * direct.before["Combined"].mean()
    difference = np.abs(both.after[PICTURE] - direct.after[PICTURE]).max()
    assert difference <= COMPOSITED * both.before["Combined"].max()


def test_settings_of_the_scene_count(room, seen):
    room.ssgi.reflections.enabled = False
    room.ssgi.enabled = True
    render(room)
    (layer,) = seen.values()
    assert not layer.after[GLOSSY][..., :3].any()
    assert layer.after[DIFFUSE][..., :3].any()


def test_background_gets_no_light(empty_file, seen):
    scene = build_mirror_floor()
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 32, 18, 1
    scene.ssgi.enabled = True
    render(scene)
    (layer,) = seen.values()
    is_sky = layer.before["Depth"][..., 0] > 1e9
    assert is_sky.any()
    assert np.array_equal(layer.after["Combined"][is_sky], layer.before["Combined"][is_sky])


# --- Every kind of render ---------------------------------------------------------------------------------


def test_compositor_and_file_get_the_outputs(room, tmp_path):
    room.ssgi.enabled = True
    plain = render_file(room, tmp_path / "plain.exr")
    tree, outputs = compat.new_compositor_tree(room)
    source = tree.nodes.new("CompositorNodeRLayers")
    assert set(OUTPUTS) <= {socket.name for socket in source.outputs if socket.enabled}
    invert = tree.nodes.new("CompositorNodeInvert")
    tree.links.new(invert.inputs["Color"], source.outputs[PICTURE])
    tree.links.new(outputs[0], invert.outputs[0])
    if bpy.app.version >= (5, 0, 0):
        room.render.compositor_device = "CPU"
    composited = render_file(room, tmp_path / "composited.exr")
    assert set(OUTPUTS) <= plain.keys()
    assert np.abs(composited["Composite.Combined"] - (1.0 - plain[PICTURE])).max() <= COMPOSITED


def test_each_frame_of_an_animation_gets_its_light(room, seen, tmp_path, monkeypatch):
    frames = []
    spy = in_render.write_result
    monkeypatch.setattr(
        in_render, "write_result", lambda *args: (spy(*args), frames.append(next(iter(seen.values()))))
    )
    lamp = room.objects["Lamp"].data
    lamp.energy = 20.0
    lamp.keyframe_insert("energy", frame=1)
    lamp.energy = 60.0
    lamp.keyframe_insert("energy", frame=2)
    room.frame_start, room.frame_end = 1, 2
    room.render.filepath = str(tmp_path / "frame_")
    room.ssgi.enabled = True
    render(room, animation=True)
    first, second = (added(frame.after).mean() for frame in frames)
    assert second > 2.0 * first > 0.0
    assert len(list(tmp_path.iterdir())) == 2


def test_each_view_layer_gets_its_own_light(room, seen):
    room.ssgi.enabled = True
    second = room.view_layers.new("Second")
    second.material_override = new_material("Dark", (0.05, 0.05, 0.05))
    render(room)  # declares what the new layer lacks
    assert seen.keys() == {room.view_layers[0].name, "Second"}
    first, dark = (added(layer.after).mean() for layer in seen.values())
    assert 0.0 < dark < 0.2 * first


def test_only_scenes_that_have_it_on_get_the_light(room, seen):
    other = bpy.data.scenes.new("Other")
    other.ssgi.enabled = True
    room.ssgi.enabled = False
    render(room)
    assert not seen


@pytest.mark.parametrize("crops", [False, True])
def test_border_holds_its_part_of_the_whole(room, seen, crops):
    room.ssgi.enabled = True
    render(room)
    (whole,) = seen.values()
    edit = room.render
    edit.use_border, edit.use_crop_to_border = True, crops
    edit.border_min_x, edit.border_max_x, edit.border_min_y, edit.border_max_y = 0.25, 0.75, 0.0, 0.5
    render(room)
    (part,) = seen.values()
    rows, columns = slice(9, 18), slice(8, 24)
    assert part.after["Combined"].shape[:2] == (9, 16)
    assert np.allclose(part.before["Depth"], whole.before["Depth"][rows, columns], rtol=0.02)
    assert added(part.after).mean() > 0.0


def test_percentage_counts(room, seen):
    room.render.resolution_percentage = 50
    room.ssgi.enabled = True
    render(room)
    (layer,) = seen.values()
    assert layer.after["Combined"].shape == (9, 16, 4)
    assert added(layer.after).any()


@pytest.mark.parametrize("kind", ["orthographic", "shift", "vertical fit", "pixel aspect"])
def test_each_camera_is_the_one_of_a_capture(room, seen, kind, monkeypatch):
    data = room.camera.data
    if kind == "orthographic":
        data.type, data.ortho_scale = "ORTHO", 3.0
    elif kind == "shift":
        data.shift_x, data.shift_y = 0.1, -0.05
    elif kind == "vertical fit":
        data.sensor_fit = "VERTICAL"
    else:
        room.render.pixel_aspect_x = 1.5
    cameras = []
    monkeypatch.setattr(
        in_render, "compute_picture", lambda frame, *rest: (cameras.append(frame.camera), 1 / 0)
    )
    room.ssgi.enabled = True
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        render(room)
    expected = capture_frame(room, CaptureOptions(samples=1, denoiser="none")).camera
    assert repr(cameras[0]) == repr(expected)


@pytest.mark.parametrize("size", [(2304, 8), (192, 160)])
def test_a_frame_of_several_tiles_is_rendered_in_one(room, seen, size):
    room.render.resolution_x, room.render.resolution_y = size
    room.cycles.samples, room.cycles.tile_size = 1, min(room.cycles.tile_size, max(size) // 2)
    room.ssgi.diffuse.rays = room.ssgi.reflections.rays = 1
    room.ssgi.enabled = True
    before = fingerprint()
    render(room)
    (layer,) = seen.values()
    assert layer.before["Combined"][..., :3].any()
    assert added(layer.after).any()
    assert changes(before, fingerprint()) == {}


def test_kept_scene_renders_each_setting_right(room, seen):
    def picture():
        seen.clear()
        render(room)
        return next(iter(seen.values())) if seen else None

    room.ssgi.enabled = True
    once = picture()
    room.render.use_persistent_data = True
    for _ in range(2):
        assert np.array_equal(picture().after["Combined"], once.after["Combined"])
    room.ssgi.replace_gi = False
    assert picture().before["Combined"].mean() > once.before["Combined"].mean()
    room.ssgi.replace_gi = True
    assert np.array_equal(picture().after["Combined"], once.after["Combined"])


# --- What cannot be rendered ------------------------------------------------------------------------------


def make_panoramic(scene):
    scene.camera.data.type = "PANO"
    compat.set_equirectangular(scene.camera.data)


def make_huge(scene):
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 8200, 4, 1


@pytest.mark.parametrize(("change", "words"), [(make_panoramic, "panoramic"), (make_huge, "at most 8192")])
def test_what_has_no_light_gets_the_plain_render(room, tmp_path, capfd, change, words):
    change(room)
    plain = render_file(room, tmp_path / "plain.exr")
    room.ssgi.enabled = True
    assert words not in capfd.readouterr().out
    refused = render_file(room, tmp_path / "refused.exr")
    assert np.array_equal(refused["Combined"], plain["Combined"])
    assert words in capfd.readouterr().out


def test_stereo_gets_the_plain_render(room, capfd, seen):
    room.render.use_multiview = True
    room.ssgi.enabled = True
    render(room)
    assert not seen
    assert "stereoscopic" in capfd.readouterr().out


@pytest.mark.parametrize("error", [ValueError, RuntimeError, MemoryError])
def test_failing_passes_leave_the_picture_of_the_render(room, monkeypatch, error):
    """Seen from a hook that stands around ours, which finds the picture that Cycles rendered."""
    pictures = []

    def fail(*_args, **_options):
        raise error("in the middle of it")

    def spy(original, engine, depsgraph, roughness):
        layer_name = depsgraph.view_layer.name
        add_light(original, engine, depsgraph, roughness)
        pictures.append(raw_passes(engine, layer_name)["Combined"])

    add_light = in_render._render
    monkeypatch.setattr(in_render, "_render", spy)
    room.cycles.diffuse_bounces = room.cycles.glossy_bounces = 0
    room.ssgi.enabled = True
    room.ssgi.replace_combined = False
    render(room)
    room.ssgi.replace_combined = True
    monkeypatch.setattr("ssgi_addon.results.render_indirect", fail)
    before = fingerprint()
    with pytest.raises(RuntimeError, match="memory" if error is MemoryError else "in the middle of it"):
        render(room)
    assert np.array_equal(*pictures)
    assert changes(before, fingerprint()) == {}
    assert cycles_engine().render.__module__ == cycles_engine().__module__


def test_output_of_a_user_with_the_same_name_is_not_filled(room):
    output = room.view_layers[0].aovs.add()
    output.name, output.type = DIFFUSE, "VALUE"
    room.ssgi.enabled = True
    with pytest.raises(RuntimeError, match="no color output 'SSGI Diffuse'"):
        render(room)
    room.ssgi.enabled = False
    assert [aov.name for aov in room.view_layers[0].aovs] == [DIFFUSE]


def test_stopped_render_ends_without_a_message(room, seen, monkeypatch):
    """Escape in the middle of our passes: no output is filled, and no thread goes on."""
    moments, progress_of = [], in_render._progress

    def stopped(engine):
        progress = progress_of(engine)

        def report(fraction, text):
            progress(fraction, text)
            if fraction > 0.2:
                moments.append(fraction)
                raise in_render._StoppedError

        return report

    monkeypatch.setattr(in_render, "_progress", stopped)
    room.ssgi.enabled = True
    before = fingerprint()
    render(room)
    assert moments
    assert not seen
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("ssgi")]
    assert changes(before, fingerprint()) == {}


# --- What stays behind ------------------------------------------------------------------------------------


def test_switching_off_takes_back_what_was_added_and_nothing_else(room):
    layer = room.view_layers[0]
    layer.use_pass_normal = True
    layer.aovs.add().name = "Own"
    tree, outputs = compat.new_compositor_tree(room)
    source = tree.nodes.new("CompositorNodeRLayers")
    tree.links.new(outputs[0], source.outputs["Normal"])
    before = fingerprint()
    room.ssgi.enabled = True
    assert set(OUTPUTS) <= {aov.name for aov in layer.aovs}
    room.ssgi.enabled = False
    assert changes(before, fingerprint()) == {}
    assert outputs[0].links[0].is_valid


def test_render_changes_nothing(room):
    room.ssgi.enabled = True
    before = fingerprint()
    render(room)
    assert changes(before, fingerprint()) == {}
    assert cycles_engine().render.__module__ == cycles_engine().__module__


def test_render_with_the_switch_off_is_the_plain_one(room, seen, monkeypatch):
    monkeypatch.setattr(in_render._HOOK, "install", lambda scenes: 1 / 0)
    before = fingerprint()
    render(room)
    assert changes(before, fingerprint()) == {}
    assert not seen


def test_links_and_outputs_survive_that_the_extension_is_switched_off_and_on(room, seen):
    room.ssgi.enabled = True
    tree, outputs = compat.new_compositor_tree(room)
    source = tree.nodes.new("CompositorNodeRLayers")
    tree.links.new(outputs[0], source.outputs[PICTURE])
    in_render.unregister()
    properties.unregister()
    render(room)
    properties.register()
    in_render.register()
    assert not seen
    render(room)
    assert seen
    assert outputs[0].links[0].from_socket.name == PICTURE


def test_unregistering_in_the_middle_of_a_render_puts_cycles_back(room):
    original = cycles_engine().render
    room.ssgi.enabled = True
    in_render._before_frame(room)
    assert cycles_engine().render is not original
    in_render.unregister()
    assert cycles_engine().render is original
    in_render.register()


def test_file_that_is_saved_during_a_render_holds_the_scene_alone(room, seen, tmp_path):
    """As a script may save it, after each frame."""

    def save(*_):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"), copy=True)

    room.ssgi.enabled = True
    bpy.app.handlers.render_post.append(save)
    try:
        room.frame_start, room.frame_end = 1, 2
        room.render.filepath = str(tmp_path / "frame_")
        render(room, animation=True)
    finally:
        bpy.app.handlers.render_post.remove(save)
    assert seen
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    (scene,) = (scene for scene in bpy.data.scenes if scene.ssgi.enabled)
    assert {aov.name for aov in scene.view_layers[0].aovs} == set(OUTPUTS)
    kinds = {node.bl_idname for material in bpy.data.materials for node in node_tree(material).nodes}
    assert "ShaderNodeBsdfPrincipled" in kinds
    assert "ShaderNodeOutputAOV" not in kinds


def test_cycles_that_was_switched_off_and_on_renders_with_the_light(room, seen):
    room.ssgi.enabled = True
    addon_utils.disable("cycles")
    addon_utils.enable("cycles")
    room.render.engine = "CYCLES"
    render(room)
    assert seen


def test_captures_take_direct_light_alone(room):
    room.ssgi.enabled = True
    on = capture_frame(room, CaptureOptions(samples=1, denoiser="none")).gbuffer.direct
    room.ssgi.enabled = False
    off = capture_frame(room, CaptureOptions(samples=1, denoiser="none")).gbuffer.direct
    assert np.array_equal(on, off)
