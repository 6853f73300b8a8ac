# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures for people: the view transform equals Blender's own, and the contact sheet shows its panels."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.display import to_display, write_display_png
from ssgi_addon.blender.sheet import write_contact_sheet
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers
from tests.blender.shown import find_picture, read_png
from tests.scenes import build_ball_over_plane

SIZE = (37, 64)


@pytest.fixture
def scene():
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.dither_intensity = 0.0
    return scene


def save_render(scene, folder):
    """Render `scene`; return its radiance and the PNG that Blender saves of it."""
    scene.render.dither_intensity = 0.0
    scene.cycles.samples = 1
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    bpy.ops.render.render(scene=scene.name)
    result = bpy.data.images["Render Result"]
    result.save_render(str(folder / "render.exr"), scene=scene)
    settings.file_format, settings.color_depth = "PNG", "8"
    result.save_render(str(folder / "render.png"), scene=scene)
    return read_layers(folder / "render.exr")["Combined"], read_png(folder / "render.png")


def set_plain(view):
    view.view_transform = "Standard"


def set_agx(view):
    view.view_transform = "AgX"
    view.look = "AgX - Punchy"
    view.exposure, view.gamma = 0.7, 1.2


def set_filmic_with_curves(view):
    view.view_transform = "Filmic"
    view.use_curve_mapping = True
    view.curve_mapping.curves[3].points.new(0.3, 0.6)
    view.curve_mapping.update()


def set_white_balance(view):
    view.view_transform = "AgX"
    view.use_white_balance = True
    view.white_balance_temperature = 4000


@pytest.mark.parametrize("setup", [set_plain, set_agx, set_filmic_with_curves, set_white_balance])
def test_display_equals_what_blender_saves(setup, tmp_path):
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = build_ball_over_plane()
    setup(scene.view_settings)
    radiance, saved = save_render(scene, tmp_path)
    assert saved.max() > 100  # something to compare
    np.testing.assert_array_equal(to_display(scene, radiance), saved)


def snapshot(scene):
    settings = scene.render.image_settings
    names = [p.identifier for p in settings.bl_rna.properties if p.type not in {"POINTER", "COLLECTION"}]
    values = {name: getattr(settings, name) for name in names}
    values["override"] = settings.view_settings.view_transform
    counts = {
        p.identifier: len(getattr(bpy.data, p.identifier))
        for p in bpy.data.bl_rna.properties
        if p.type == "COLLECTION"
    }
    return values, counts


@pytest.mark.parametrize("output", ["PNG", "OPEN_EXR", "OPEN_EXR_MULTILAYER", "JPEG"])
def test_output_settings_and_datablocks_are_as_before(scene, output):
    settings = scene.render.image_settings
    if output == "OPEN_EXR_MULTILAYER" and hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = output
    if "EXR" in output:
        settings.color_depth = "32"
    settings.color_management = "OVERRIDE"
    settings.view_settings.view_transform = "Raw"
    before = snapshot(scene)
    to_display(scene, np.ones((*SIZE, 3), np.float32))
    assert snapshot(scene) == before


def test_overriding_color_management_of_the_output_counts(scene):
    scene.view_settings.view_transform = "AgX"
    settings = scene.render.image_settings
    settings.file_format = "PNG"
    settings.color_management = "OVERRIDE"
    settings.view_settings.view_transform = "Raw"
    assert (to_display(scene, np.full((*SIZE, 3), 0.2, np.float32)) == 51).all()


def test_top_row_stays_on_top(scene):
    scene.view_settings.view_transform = "Raw"
    radiance = np.zeros((*SIZE, 3), np.float32)
    radiance[0] = (1.0, 0.0, 0.0)
    radiance[:, -1] = (0.0, 0.0, 1.0)
    shown = to_display(scene, radiance)
    assert tuple(shown[0, 0]) == (255, 0, 0)
    assert tuple(shown[-1, 0]) == (0, 0, 0)
    assert tuple(shown[-1, -1]) == (0, 0, 255)


@pytest.mark.parametrize("transform", ["Standard", "AgX", "Filmic", "Raw"])
def test_bad_and_extreme_radiance_stays_local(scene, transform):
    scene.view_settings.view_transform = transform
    radiance = np.full((1, 4, 3), 0.18, np.float32)
    radiance[0, 1] = np.nan
    radiance[0, 2] = np.inf
    shown = to_display(scene, radiance)
    assert (shown[0, 1] == 0).all()
    assert (shown[0, 2] == 255).all()
    np.testing.assert_array_equal(shown[0, 0], shown[0, 3])
    assert 0 < shown[0, 0, 0] < 255


@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 4), (0, 5, 3)])
def test_wrong_shapes_are_refused(scene, shape):
    with pytest.raises(ValueError, match="image"):
        to_display(scene, np.zeros(shape, np.float32))


def test_display_png_holds_the_displayed_picture(scene, tmp_path):
    radiance = np.random.default_rng(2).random((*SIZE, 3)).astype(np.float32)
    write_display_png(scene, radiance, tmp_path / "shown.png")
    np.testing.assert_array_equal(read_png(tmp_path / "shown.png"), to_display(scene, radiance))
    assert [path.name for path in tmp_path.iterdir()] == ["shown.png"]


def noise_panels(count, size=(90, 320)):
    random = np.random.default_rng(3)
    return [(f"Panel {i}", random.integers(0, 256, (*size, 3), np.uint8)) for i in range(count)]


def lit_rows(sheet, background):
    return np.flatnonzero((sheet != background).any(axis=(1, 2)))


def test_panels_stand_unchanged_side_by_side(tmp_path):
    panels = noise_panels(4)
    write_contact_sheet(tmp_path / "sheet.png", panels, ["one\ttwo\tthree\tfour", "a line"])
    sheet = read_png(tmp_path / "sheet.png")
    places = [find_picture(sheet, picture) for _, picture in panels]
    assert None not in places
    assert len({row for row, _ in places}) == 1
    columns = [column for _, column in places]
    assert len(set(np.diff(columns))) == 1
    left, right = columns[0], sheet.shape[1] - columns[-1] - 320
    assert left == right


def test_titles_and_captions_are_drawn(tmp_path):
    panels = noise_panels(2)
    write_contact_sheet(tmp_path / "bare.png", [("", picture) for _, picture in panels], legend=False)
    write_contact_sheet(tmp_path / "full.png", panels, ["left\tright", "below both"], legend=False)
    bare, full = read_png(tmp_path / "bare.png"), read_png(tmp_path / "full.png")
    background = bare[0, 0]
    assert lit_rows(bare, background).size == 90
    row, column = find_picture(full, panels[0][1])
    assert lit_rows(full[:row], background).size > 10
    below = full[row + 90 :]
    assert lit_rows(below[:, column : column + 320], background).size > 20
    second = find_picture(full, panels[1][1])[1]
    assert lit_rows(below[:, second:], background).size > 10


def test_long_captions_wrap_inside_the_margins(tmp_path):
    write_contact_sheet(tmp_path / "sheet.png", noise_panels(1), ["many words " * 40], legend=False)
    sheet = read_png(tmp_path / "sheet.png")
    assert (sheet[:, :24] == sheet[0, 0]).all()
    assert (sheet[:, -24:] == sheet[0, 0]).all()
    assert (sheet[-8:] == sheet[0, 0]).all()


def test_large_panels_are_reduced_and_small_ones_enlarged(tmp_path):
    gray = np.full((270, 1300, 3), 90, np.uint8)
    write_contact_sheet(tmp_path / "large.png", [("", gray)], legend=False)
    write_contact_sheet(tmp_path / "small.png", [("", gray[:9, :16])], legend=False)
    sheets = [read_png(tmp_path / name) for name in ("large.png", "small.png")]
    assert [(sheet == 90).all(axis=-1).sum(axis=1).max() for sheet in sheets] == [1300 // 3, 16 * 20]


def test_pictures_of_different_sizes_are_refused(tmp_path):
    panels = [("a", np.zeros((4, 4, 3), np.uint8)), ("b", np.zeros((4, 5, 3), np.uint8))]
    with pytest.raises(ValueError, match="'b'"):
        write_contact_sheet(tmp_path / "sheet.png", panels)
    with pytest.raises(ValueError, match="uint8"):
        write_contact_sheet(tmp_path / "sheet.png", [("a", np.zeros((4, 4, 3)))])
    with pytest.raises(ValueError, match="at least one"):
        write_contact_sheet(tmp_path / "sheet.png", [])
    assert not list(tmp_path.iterdir())


def test_a_sheet_that_cannot_be_written_ends_in_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SSGIError, match="cannot write"):
        write_contact_sheet(tmp_path / "file" / "sheet.png", noise_panels(1))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
