# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators of the installed extension, reached as a user's script reaches them."""

from __future__ import annotations

import pytest

pytest.importorskip("bpy")

from tests.blender.extension_fixtures import installed_extension  # noqa: F401  (a fixture)
from tests.blender.stub_layout import STUB_LAYOUT
from tests.tolerances import COMPOSITED

ERROR_OF = """
def error_of(operator, **options):
    try:
        return sorted(operator(**options))
    except RuntimeError as error:
        return str(error)
"""


def test_render_works_with_defaults_in_a_file_that_was_never_saved(extension, tmp_path):
    script = """
scene = make_scene()
done = sorted(bpy.ops.ssgi.render())
path = Path(scene.ssgi.result)
result = [done, path.is_file(), path.is_relative_to(bpy.app.tempdir), path.suffix]
"""
    assert extension.run(script, tmp_path) == [["FINISHED"], True, True, ".exr"]


def test_results_lie_beside_a_saved_file(extension, tmp_path):
    script = """
scene = make_scene()
bpy.ops.wm.save_as_mainfile(filepath=str(out / "room.blend"))
bpy.ops.ssgi.render()
bpy.ops.ssgi.render()
result = sorted(path.name for path in (out / "ssgi").iterdir())
"""
    assert "room_0001.exr" in extension.run(script, tmp_path)


def test_composited_render_shows_the_result(extension, tmp_path):
    script = """
scene = make_scene()
scene.ssgi.denoiser = "none"
scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 0
scene.cycles.samples, scene.cycles.use_denoising = 1, False
bpy.ops.ssgi.render()
scene.render.filepath = str(out / "render.exr")
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
bpy.ops.render.render(write_still=True)
from bl_ext.user_default.ssgi.ssgi_addon.exr import read_layers
picture, layers = read_layers(out / "render.exr")["Combined"], read_layers(scene.ssgi.result)
result = [float(abs(picture - layers["combined"]).max()), float(abs(picture - layers["direct"]).max())]
"""
    error, added = extension.run(script, tmp_path)
    assert error <= COMPOSITED
    assert added > 10 * COMPOSITED


def test_layers_are_added_and_removed_on_request(extension, tmp_path):
    script = """
scene = make_scene()
scene.ssgi.add_to_compositor = False
bpy.ops.ssgi.render()
def has_group():
    tree = scene.compositing_node_group if bpy.app.version >= (5, 0, 0) else scene.node_tree
    return bool(tree) and any(node.bl_idname == "CompositorNodeGroup" for node in tree.nodes)
result = [has_group(), bpy.ops.ssgi.remove_layers.poll()]
bpy.ops.ssgi.add_layers(filepath=scene.ssgi.result)
result += [has_group(), bpy.ops.ssgi.remove_layers.poll()]
bpy.ops.ssgi.remove_layers()
result += [has_group(), bpy.ops.ssgi.remove_layers.poll()]
"""
    assert extension.run(script, tmp_path) == [False, False, True, True, False, False]


def test_what_is_missing_is_said_in_one_line(extension, tmp_path):
    script = (
        ERROR_OF
        + """
scene = make_scene()
result = {"no result": error_of(bpy.ops.ssgi.add_layers)}
result["no file"] = error_of(bpy.ops.ssgi.add_layers, filepath=str(out / "none.exr"))
result["not added"] = error_of(bpy.ops.ssgi.remove_layers)
(out / "file").write_text("")
scene.ssgi.output = str(out / "file" / "folder")
result["output"] = error_of(bpy.ops.ssgi.render)
scene.ssgi.output = str(out / "results")
scene.camera = None
result["camera"] = error_of(bpy.ops.ssgi.render)
"""
    )
    messages = extension.run(script, tmp_path)
    expected = {
        "no result": "render the indirect light first",
        "no file": "no such file",
        "not added": "holds no result",
        "output": "file",
        "camera": "camera",
    }
    assert messages.keys() == expected.keys()
    for key, words in expected.items():
        assert words in messages[key], key
        assert "Traceback" not in messages[key]
        assert len(messages[key].strip().splitlines()) == 1, messages[key]
    assert not (tmp_path / "results").exists() or not list((tmp_path / "results").iterdir())


def test_double_light_is_warned_of(extension, tmp_path):
    script = """
from bl_ext.user_default.ssgi.ssgi_addon.blender import compositor
scene = make_scene()
result = [len(compositor.warnings(scene))]
bpy.ops.ssgi.render()
result.append(len(compositor.warnings(scene)))
scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 0
result.append(len(compositor.warnings(scene)))
scene.render.use_compositing = False
result.append(len(compositor.warnings(scene)))
"""
    assert extension.run(script, tmp_path) == [0, 1, 0, 1]


def test_layers_beside_the_light_in_renders_are_warned_of(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
from bl_ext.user_default.ssgi.ssgi_addon.blender import compositor
scene = make_scene()
bpy.ops.ssgi.render()
def warnings(**changes):
    for name, value in changes.items():
        setattr(scene.ssgi, name, value)
    drawn = draw("SSGI_PT_in_render", SimpleNamespace(scene=scene, engine=scene.render.engine))["labels"]
    assert " ".join(drawn) == " ".join(compositor.warnings(scene)), drawn
    return " ".join(drawn)
result = [
    warnings(enabled=True),
    warnings(replace_combined=False),  # renders without bounces, and shows no light of ours
    warnings(replace_gi=False),
]
scene.ssgi.replace_combined, scene.render.engine = True, "BLENDER_WORKBENCH"
result.append(warnings())
"""
    replaced, direct, with_bounces, other_engine = extension.run(script, tmp_path)
    assert "In Renders is on" in replaced
    assert direct == ""
    assert "bounces to 0" in with_bounces
    assert other_engine == ""


def test_nothing_is_rendered_beside_a_render_of_blenders(extension, tmp_path):
    script = """
from bl_ext.user_default.ssgi.ssgi_addon.blender import render_settings
scene = make_scene()
render_settings._is_rendering = lambda: True  # no window here in which one could run meanwhile
result = []
for operator in (bpy.ops.ssgi.preview, bpy.ops.ssgi.render):
    try:
        operator()
    except RuntimeError as error:
        result.append(str(error))
render_settings._is_rendering = lambda: False
result.append(sorted(bpy.ops.ssgi.preview(percentage=100)))
"""
    preview, render, afterwards = extension.run(script, tmp_path)
    assert "Blender is rendering" in preview
    assert "Blender is rendering" in render
    assert afterwards == ["FINISHED"]
