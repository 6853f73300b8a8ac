# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels of the installed extension: what they draw, what they say, and presets of the user's own."""

from __future__ import annotations

import pytest

pytest.importorskip("bpy")

from tests.blender.extension_fixtures import installed_extension  # noqa: F401  (a fixture)
from tests.blender.stub_layout import STUB_LAYOUT

# Whatever a float property without a range has
FLOAT_LIMIT = 1e37


def test_every_panel_draws_what_there_is(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
make_scene()
space = SimpleNamespace(tree_type="CompositorNodeTree", type="NODE_EDITOR")
context = SimpleNamespace(scene=bpy.context.scene, space_data=space, engine="CYCLES")
result = {{name: draw(name, context) for name in our_panels()}}
"""
    drawn = extension.run(script, tmp_path)
    assert len(drawn) >= 11
    for name, what in drawn.items():
        assert what["properties"] or what["operators"], name
    operators = {operator for what in drawn.values() for operator in what["operators"]}
    assert operators >= {
        "ssgi.render",
        "ssgi.preview",
        "ssgi.add_layers",
        "ssgi.remove_layers",
        "ssgi.show_comparison",
    }


def test_each_setting_is_drawn_once_in_the_render_properties(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene()
context = SimpleNamespace(scene=scene, engine="CYCLES")
drawn = [name for panel in our_panels() if getattr(bpy.types, panel).bl_space_type == "PROPERTIES"
         for name in draw(panel, context)["properties"]]
groups = (scene.ssgi, scene.ssgi.diffuse, scene.ssgi.reflections)
named = [item.identifier for group in groups for item in group.bl_rna.properties
         if item.type != "POINTER" and not item.is_hidden and item.identifier != "name"]
result = [sorted(drawn), sorted(named)]
"""
    drawn, named = extension.run(script, tmp_path)
    shown_elsewhere = {"compare_view", "compare_split"}
    assert drawn == [name for name in named if name not in shown_elsewhere]


def test_every_number_has_a_range_and_every_choice_a_label(extension, tmp_path):
    script = """
numbers = []
def visit(group, path):
    for item in group.bl_rna.properties:
        if item.identifier in ("rna_type", "name"):
            continue
        if item.type == "POINTER":
            visit(getattr(group, item.identifier), f"{path}{item.identifier}.")
        elif item.type in ("INT", "FLOAT"):
            numbers.append([path + item.identifier, item.hard_min, item.soft_max])
        elif item.type == "ENUM":
            for choice in item.enum_items:
                texts = len(choice.name), len(choice.description)
                numbers.append([f"{path}{item.identifier}.{choice.identifier}", *texts])
visit(bpy.context.scene.ssgi, "")
result = numbers
"""
    for name, least, most in extension.run(script, tmp_path):
        assert least >= 0, name
        assert 0 < most < min(FLOAT_LIMIT, 2**31), name


def test_a_camera_that_cannot_be_traced_is_named_in_panel_and_poll(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene()
context = SimpleNamespace(scene=scene, engine="CYCLES")
def state():
    try:
        poll = ""
        bpy.ops.ssgi.preview(percentage=1) if not bpy.ops.ssgi.preview.poll() else None
    except RuntimeError as error:
        poll = str(error)
    return [poll, " ".join(draw("SSGI_PT_main", context)["labels"])]
result = {{"fine": state()}}
scene.camera.data.type = "PANO"
result["panoramic"] = state()
scene.camera.data.type = "PERSP"
scene.render.use_multiview = True
result["stereoscopic"] = state()
scene.render.use_multiview = False
scene.camera = None
result["no camera"] = state()
"""
    states = extension.run(script, tmp_path)
    assert states.pop("fine") == ["", ""]
    for words, (poll, label) in states.items():
        assert words in poll
        assert words in label


def test_engines_without_the_effect_in_renders_are_told_of(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene()
scene.ssgi.enabled = True
def labels(engine):
    scene.render.engine = engine
    return " ".join(draw("SSGI_PT_main", SimpleNamespace(scene=scene, engine=engine))["labels"])
eevee = "BLENDER_EEVEE" if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"
panel = bpy.types.SSGI_PT_main
polls = [panel.poll(SimpleNamespace(engine=engine)) for engine in ("CYCLES", eevee, "BLENDER_WORKBENCH")]
result = [labels("CYCLES"), labels(eevee), polls]
"""
    with_cycles, with_eevee, polls = extension.run(script, tmp_path)
    assert with_cycles == ""
    assert "Cycles" in with_eevee
    assert polls == [True, True, False]


def test_captures_say_their_cost_and_why_they_were_skipped(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene(160, 90)
context = SimpleNamespace(scene=scene, engine="CYCLES")
scene.ssgi.samples, scene.ssgi.fill, scene.ssgi.surround = 4, 16, 60
result = [draw("SSGI_PT_beyond", context)["labels"]]
scene.ssgi.fill = scene.ssgi.surround = 0
result.append(draw("SSGI_PT_beyond", context)["labels"])
(out / "room_0001.exr").write_text("")
(out / "report.json").write_text(json.dumps({{"frames": [
    {{"frame": 1, "skipped": [{{"what": "surround, overscan", "why": "only 1% need them"}}]}}]}}))
scene.ssgi.result = str(out / "room_0001.exr")
result.append(draw("SSGI_PT_beyond", context)["labels"])
scene.render.resolution_x = scene.render.resolution_y = 4
scene.render.resolution_percentage = 1
draw("SSGI_PT_beyond", context)  # of no pixels
"""
    costs, nothing, skipped = extension.run(script, tmp_path)
    # Beside the direct light's 4096 + 4 * 160 * 90: 4096 + 2 * 16 samples of a 16th of the pixels;
    # quick passes of 65536, and six views of 4096 + 60 * 60 pixels with 4 samples
    assert costs[:2] == ["+53%", "+286%"]
    assert "About +339%, more than the budget" in " ".join(costs[2:])
    assert nothing == []
    assert skipped == ["Last time skipped: only 1% need them"] * 2


def test_costs_are_those_that_the_captures_are_budgeted_by(extension, tmp_path):
    script = """
from types import SimpleNamespace
from bl_ext.user_default.ssgi.ssgi_addon.blender.capture_costs import cost_shares
off = dict(samples=8, fill=0, surround=0, overscan=1.0, stations=0, light_views=0, back_faces=False)
off["behind"] = False
def shares(**changes):
    return cost_shares(SimpleNamespace(**{**off, **changes}), 128 * 128, 4)
result = [shares(), shares(overscan=2.0), shares(stations=3, light_views=1), shares(back_faces=True),
          shares(behind=True), shares(back_faces=True, behind=True, stations=1)]
"""
    # In 4096: a frame's sample 4 and one more for the start, a view's 4 samples 17, a quick pass 16
    light = 8 * 4 + 1
    expected = [
        {},
        {"overscan": 16 + 17},
        {"stations": 16 + 3 * 17, "light_views": 16 + 17},
        {"back_faces": 16 + 5},
        {"behind": 16 + 5 + light},
        {"stations": 16 + 17, "back_faces": 16 + 2 * 5, "behind": light + 17},
    ]
    assert extension.run(script, tmp_path) == [
        {name: pytest.approx(cost / light) for name, cost in costs.items()} for costs in expected
    ]


def test_presets_lie_in_the_users_folder_and_bring_settings_back(extension, tmp_path):
    script = """
settings = bpy.context.scene.ssgi
settings.preset = "final"
settings.samples, settings.diffuse.rays, settings.thickness, settings.seed = 7, 11, 0.25, 5
settings.reflections.method, settings.engine, settings.surround = "linear", "eevee", 64
bpy.ops.ssgi.preset_add(name="My Look")
folder = Path(bpy.utils.user_resource("SCRIPTS", path="presets/ssgi"))
result = [sorted(path.name for path in folder.iterdir())]
settings.preset, settings.engine = "draft", "cycles"
settings.thickness, settings.seed, settings.reflections.method = 0.5, 6, "hierarchical"
bpy.ops.script.execute_preset(filepath=str(folder / "My_Look.py"), menu_idname="SSGI_PT_presets")
result.append([settings.preset, settings.engine, settings.samples, settings.diffuse.rays,
               round(settings.thickness, 6), settings.seed, settings.reflections.method, settings.surround])
import importlib
extension = Path(importlib.import_module("bl_ext.user_default.ssgi").__file__).parent
result.append([path.name for path in extension.rglob("My_Look*")])
bpy.ops.ssgi.preset_add(name="My_Look", remove_name=True)
result.append(sorted(path.name for path in folder.iterdir()))
"""
    assert extension.run(script, tmp_path) == [
        ["My_Look.py"],
        ["final", "eevee", 7, 11, 0.25, 6, "linear", 64],
        [],
        [],
    ]


def test_presets_hold_every_setting_of_a_way_to_render(extension, tmp_path):
    script = """
from bl_ext.user_default.ssgi.ssgi_addon.ui.presets import preset_values
from bl_ext.user_default.ssgi.ssgi_addon.core.settings import Settings
from dataclasses import fields
result = [preset_values(), [item.name for item in fields(Settings) if item.metadata]]
"""
    values, shared = extension.run(script, tmp_path)
    assert len(values) == len(set(values))
    assert values[:2] == ["ssgi.preset", "ssgi.engine"]
    missing = [name for name in shared if f"ssgi.{name}" not in values]
    assert missing == ["seed", "threads"]


def test_shared_compositor_is_left_alone_with_a_message(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene()
result = None
if bpy.app.version >= (5, 0, 0):
    tree = bpy.data.node_groups.new("Shared", "CompositorNodeTree")
    scene.compositing_node_group = bpy.data.scenes.new("Other").compositing_node_group = tree
    try:
        bpy.ops.ssgi.add_layers(filepath=str(out / "none.exr"))
    except RuntimeError as error:
        space = SimpleNamespace(tree_type="CompositorNodeTree")
        drawn = draw("SSGI_PT_compositor", SimpleNamespace(scene=scene, space_data=space))
        result = [str(error), " ".join(drawn["labels"]), len(tree.nodes)]
"""
    found = extension.run(script, tmp_path)
    if found is None:
        pytest.skip("before 5.0 a compositor belongs to one scene")
    error, label, nodes = found
    assert "single-user" in error
    assert "single-user" in label
    assert nodes == 0


def test_wiring_can_be_undone(extension, tmp_path):
    script = """
from bl_ext.user_default.ssgi.ssgi_addon.blender import compositor
scene = make_scene()
scene.ssgi.add_to_compositor = False
bpy.ops.ssgi.render()
path = scene.ssgi.result
def state(): return compositor.has_layers(bpy.context.scene)
bpy.ops.ed.undo_push(message="rendered")
result = [state()]
bpy.ops.ssgi.add_layers(filepath=path)
bpy.ops.ed.undo_push(message="added")
result.append(state())
bpy.ops.ssgi.remove_layers()
bpy.ops.ed.undo_push(message="removed")
result.append(state())
for _ in range(2):
    bpy.ops.ed.undo()
    result.append(state())
"""
    assert extension.run(script, tmp_path) == [False, True, False, True, False]


def test_sidebar_is_for_the_compositor_alone(extension, tmp_path):
    script = """
from types import SimpleNamespace
panel = bpy.types.SSGI_PT_compositor
result = [panel.poll(SimpleNamespace(space_data=SimpleNamespace(tree_type=kind)))
          for kind in ("CompositorNodeTree", "ShaderNodeTree", "GeometryNodeTree")]
"""
    assert extension.run(script, tmp_path) == [True, False, False]


def test_unlimited_numbers_say_so(extension, tmp_path):
    script = """
settings = bpy.context.scene.ssgi
result = [settings.bl_rna.properties[name].description for name in ("max_distance", "max_steps", "threads")]
"""
    for text in extension.run(script, tmp_path):
        assert "0 is without limit" in text or "0 takes as many" in text


def test_switch_of_renders_stands_in_its_own_panel(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene()
def drawn(engine):
    scene.render.engine = engine
    panels = {{name: draw(name, SimpleNamespace(scene=scene, engine=engine)) for name in our_panels()
              if getattr(bpy.types, name).bl_space_type == "PROPERTIES"}}
    return [[name for name, what in panels.items() if "enabled" in what[kind]]
            for kind in ("properties", "greyed")]
scene.ssgi.enabled = True
eevee = "BLENDER_EEVEE" if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"
result = [drawn("CYCLES"), drawn(eevee)]
"""
    passes = ["SSGI_PT_diffuse", "SSGI_PT_reflections"]
    (with_cycles, grey_with_cycles), (_, grey_with_eevee) = extension.run(script, tmp_path)
    assert with_cycles == sorted(["SSGI_PT_in_render", *passes])
    assert grey_with_cycles == []
    assert grey_with_eevee == ["SSGI_PT_in_render"]


def test_use_of_the_fill_follows_its_samples(extension, tmp_path):
    script = f"""{STUB_LAYOUT}
scene = make_scene()
def drawn():
    what = draw("SSGI_PT_beyond", SimpleNamespace(scene=scene, engine="CYCLES"))
    uses = ("fill", "fill_mode", "filled_roughness", "visibility")
    return [[name for name in what[kind] if name in uses] for kind in ("properties", "greyed")]
result = [drawn()]
scene.ssgi.fill_mode = "level"
result.append(drawn())
scene.ssgi.fill = 0
result.append(drawn())
"""
    names = ["fill", "fill_mode", "filled_roughness", "visibility"]
    replaced, level, nothing = extension.run(script, tmp_path)
    assert replaced == [names, []]
    assert level == [names, names[2:]]
    assert nothing == [names, names[1:]]
