# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison in the image editor, and the preview: images of the open file, drawn from arrays."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon import properties
from ssgi_addon.blender import compare_image
from ssgi_addon.blender.float_image import show_in_image
from ssgi_addon.compare_picture import compose, view_named
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import write_layers
from ssgi_addon.heatmap import error_map
from ssgi_addon.last_result import reference_path
from tests.blender.extension_fixtures import installed_extension  # noqa: F401  (a fixture)
from tests.blender.stub_layout import STUB_LAYOUT
from tests.blender.test_compositor import result_layers
from tests.tolerances import EIGHT_BIT_STEPS, SAME_RENDER

WIDTH, HEIGHT = 24, 16
METRICS = {"relmse": 0.5, "bias": -0.1, "ssim": 0.9, "flip": None}


@pytest.fixture
def scene(empty_file):
    properties.register()
    yield empty_file
    properties.unregister()


@pytest.fixture
def layers(scene, tmp_path):
    """A result of frame 1 with random layers, which the scene names as its last one."""
    path, layers = tmp_path / "room_0001.exr", result_layers(WIDTH, HEIGHT)
    write_layers(path, layers)
    scene.ssgi.result = str(path)
    return layers


@pytest.fixture
def reference(layers, tmp_path):
    picture = result_layers(WIDTH, HEIGHT, seed=1)["combined"]
    write_reference(tmp_path, picture)
    return picture


def write_reference(folder, picture):
    """Write what a comparison of frame 1 leaves: the reference, and metrics in the report."""
    write_layers(reference_path(folder / "room_0001.exr"), {"combined": picture})
    record = {"frame": 1, "metrics": {"combined": METRICS, "direct_only": METRICS}}
    (folder / "report.json").write_text(json.dumps({"frames": [record]}))


def pixels(image):
    """What an image holds, (H, W, 4), top row first."""
    width, height = image.size
    values = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(height, width, 4)[::-1]


def shown():
    return pixels(bpy.data.images[compare_image.IMAGE_NAME])[..., :3]


def test_image_holds_the_view_through_the_scenes_view_transform(scene, layers):
    scene.ssgi.compare_view = "SPLIT"
    image = compare_image.draw_comparison(scene)
    np.testing.assert_array_equal(shown(), compose(view_named("SPLIT"), layers, 0.5))
    assert (pixels(image)[..., 3] == 1.0).all()
    assert image.use_view_as_render
    assert image.is_float
    assert not image.is_dirty  # or Blender asks to save it


def test_a_property_redraws_the_same_image(scene, layers, reference):
    image = compare_image.draw_comparison(scene)
    count = len(bpy.data.images)
    scene.ssgi.compare_split = 0.25
    np.testing.assert_array_equal(shown(), compose(view_named("SPLIT"), layers, 0.25))
    for name, expected in (
        ("DIRECT", layers["direct"]),
        ("OURS", layers["combined"]),
        ("REFERENCE", reference),
    ):
        scene.ssgi.compare_view = name
        np.testing.assert_array_equal(shown(), expected)
    assert bpy.data.images[compare_image.IMAGE_NAME] == image
    assert len(bpy.data.images) == count


def test_nothing_is_drawn_before_it_is_asked_for(scene, layers):
    scene.ssgi.compare_view = "OURS"
    assert compare_image.IMAGE_NAME not in bpy.data.images


def test_error_and_known_are_shown_as_colours_not_as_light(scene, layers, reference):
    scene.ssgi.compare_view = "ERROR"
    image = compare_image.draw_comparison(scene)
    assert not image.use_view_as_render
    linear = shown()
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    expected = error_map(layers["combined"], reference)
    np.testing.assert_allclose(encoded * 255.0, expected, rtol=0, atol=EIGHT_BIT_STEPS)
    scene.ssgi.compare_view = "KNOWN"
    assert not image.use_view_as_render
    scene.ssgi.compare_view = "OURS"
    assert image.use_view_as_render


def test_a_view_without_its_reference_leaves_the_image_alone(scene, layers):
    compare_image.draw_comparison(scene)
    before = shown()
    scene.ssgi.compare_view = "ERROR"
    np.testing.assert_array_equal(shown(), before)
    with pytest.raises(SSGIError, match="not compared"):
        compare_image.draw_comparison(scene)


def test_a_result_that_was_written_again_is_read_again(scene, layers, tmp_path):
    compare_image.draw_comparison(scene)
    newer = result_layers(2 * WIDTH, HEIGHT, seed=2)
    write_layers(tmp_path / "room_0001.exr", newer)
    scene.ssgi.compare_view = "OURS"
    np.testing.assert_array_equal(shown(), newer["combined"])


def test_a_result_of_another_size_than_its_reference_is_refused(scene, layers, tmp_path):
    write_reference(tmp_path, result_layers(WIDTH, HEIGHT // 2)["combined"])
    compare_image.draw_comparison(scene)
    scene.ssgi.compare_view = "SPLIT_REFERENCE"
    with pytest.raises(SSGIError, match="one size"):
        compare_image.draw_comparison(scene)


def test_without_a_result_there_is_nothing_to_show(scene, tmp_path):
    with pytest.raises(SSGIError, match="render the indirect light first"):
        compare_image.draw_comparison(scene)
    scene.ssgi.result = str(tmp_path / "gone.exr")
    assert compare_image.result_path(scene) is None
    assert not compare_image.has_reference(scene)


def test_metrics_are_those_of_the_report(scene, layers, tmp_path):
    assert compare_image.metrics(scene) is None
    write_reference(tmp_path, layers["combined"])
    assert compare_image.metrics(scene)["combined"] == METRICS


def test_reference_of_an_earlier_result_does_not_count(scene, layers, reference, tmp_path):
    assert compare_image.has_reference(scene)
    (tmp_path / "report.json").write_text(json.dumps({"frames": [{"frame": 1, "metrics": None}]}))
    os.utime(tmp_path / "report.json", ns=(1, 1))  # clocks of file systems are coarse
    assert not compare_image.has_reference(scene)
    scene.ssgi.compare_view = "REFERENCE"
    with pytest.raises(SSGIError, match="not compared"):
        compare_image.draw_comparison(scene)


def test_a_new_result_is_shown_at_once(scene, layers, tmp_path):
    scene.ssgi.compare_view = "OURS"
    compare_image.draw_comparison(scene)
    newer = result_layers(WIDTH, HEIGHT, seed=3)
    write_layers(tmp_path / "room_0002.exr", newer)
    scene.ssgi.result = str(tmp_path / "room_0002.exr")
    np.testing.assert_array_equal(shown(), newer["combined"])


def test_image_survives_saving_and_loading(scene, layers, tmp_path):
    image = compare_image.draw_comparison(scene)
    image.use_fake_user = True
    before = shown()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    np.testing.assert_array_equal(shown(), before)


def test_image_takes_any_size(empty_file):
    random = np.random.default_rng(0)
    for width, height in ((7, 5), (3, 11), (3, 11)):
        colors = random.random((height, width, 3), np.float32)
        image = show_in_image("SSGI Test", colors)
        np.testing.assert_array_equal(pixels(image)[..., :3], colors)
    assert [image.name for image in bpy.data.images] == ["SSGI Test"]


def test_operator_compares_with_cycles(extension, tmp_path):
    script = """
scene = make_scene()
def refused():
    try:
        bpy.ops.ssgi.show_comparison()
    except RuntimeError as error:
        return str(error)
result = [refused()]
bpy.ops.ssgi.render()
result.append(sorted(bpy.ops.ssgi.show_comparison()))
scene.ssgi.compare_view = "REFERENCE"
result.append(refused())
scene.ssgi.compare, scene.ssgi.reference_samples = True, 1
bpy.ops.ssgi.render()
bpy.ops.ssgi.show_comparison()
image = bpy.data.images["SSGI Compare"]
from bl_ext.user_default.ssgi.ssgi_addon.blender import compare_image
result += [list(image.size), sorted(compare_image.metrics(scene))]
"""
    nothing, done, unreferenced, size, metrics = extension.run(script, tmp_path)
    assert "nothing to compare" in nothing
    assert done == ["FINISHED"]
    assert "not compared with Cycles" in unreferenced
    assert size == [16, 9]
    assert {"combined", "direct_only"} <= set(metrics)


def test_panel_shows_metrics_and_greys_out_what_needs_a_reference(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene()
result = [draw("SSGI_PT_comparison")]
(out / "room_0001.exr").write_text("")
scene.ssgi.result = str(out / "room_0001.exr")
result.append(draw("SSGI_PT_comparison"))
(out / "reference").mkdir()
(out / "reference" / "room_0001.exr").write_text("")
metrics = {json.dumps(METRICS).replace("null", "None")}
(out / "report.json").write_text(json.dumps(
    {{"frames": [{{"frame": 1, "metrics": {{"combined": metrics, "direct_only": metrics}}}}]}}))
scene.ssgi.compare_view = "KNOWN"
result.append(draw("SSGI_PT_comparison"))
"""
    nothing, rendered, compared = extension.run(script, tmp_path)
    assert {"SPLIT", "OURS", "ERROR"} <= set(nothing["greyed"])
    assert "Nothing to compare" in nothing["labels"][0]
    assert set(rendered["greyed"]) == {"SPLIT_REFERENCE", "REFERENCE", "ERROR"}
    assert "No reference" in rendered["labels"][0]
    assert compared["greyed"] == ["compare_split"]  # no split to move
    assert {"relMSE", "0.5000", "-0.1000", "—"} <= set(compared["labels"])


def test_preview_is_a_small_picture_with_indirect_light(extension, tmp_path):
    script = """
import numpy as np
scene = make_scene(64, 36)
def preview(**options):
    done = sorted(bpy.ops.ssgi.preview(**options))
    image = bpy.data.images["SSGI Preview"]
    values = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(values)
    return done, list(image.size), float(values.reshape(-1, 4)[:, :3].mean(dtype=np.float64))
def state():
    return [scene.render.resolution_x, scene.render.resolution_percentage, scene.cycles.samples,
            scene.render.engine, scene.ssgi.preset, scene.ssgi.result, len(bpy.data.scenes)]
before = state()
result = [preview(), preview(percentage=50)]
scene.ssgi.diffuse_strength = scene.ssgi.glossy_strength = 0.0
without = preview()[2]
scene.ssgi.diffuse_strength = scene.ssgi.glossy_strength = 2.0
result += [without, preview()[2], state() == before, bpy.data.images.keys()]
scene.ssgi.diffuse_strength = scene.ssgi.glossy_strength = 1.0
scene.ssgi.diffuse.enabled = scene.ssgi.reflections.enabled = False
result.append(preview()[2])
"""
    small, larger, direct, doubled, untouched, images, switched_off = extension.run(script, tmp_path)
    assert small[:2] == [["FINISHED"], [16, 9]]
    assert larger[1] == [32, 18]
    once = small[2] - direct
    assert once > 0.02 * direct
    assert doubled - direct == pytest.approx(2.0 * once, rel=SAME_RENDER)
    assert switched_off == pytest.approx(direct, rel=SAME_RENDER)
    assert untouched
    assert images == ["Render Result", "SSGI Preview"]
