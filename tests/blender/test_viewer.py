# SPDX-License-Identifier: GPL-3.0-or-later
"""Which image editor shows a result; editors are stand-ins, for a Blender without a window opens none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.viewer import show_result
from ssgi_addon.png import write_png


@pytest.fixture
def result(tmp_path, empty_file):
    write_png(tmp_path / "room_0001.png", np.full((9, 16, 3), 128, np.uint8))
    return tmp_path / "room_0001.exr"


def editor(image=None, mode="VIEW", is_pinned=False):
    return SimpleNamespace(image=image, mode=mode, use_image_pin=is_pinned)


def windows(*editors, kind="IMAGE_EDITOR"):
    areas = [SimpleNamespace(ui_type=kind, spaces=SimpleNamespace(active=space)) for space in editors]
    return SimpleNamespace(windows=[SimpleNamespace(screen=SimpleNamespace(areas=areas))])


def test_result_is_shown_where_no_image_of_the_user_is(result):
    busy, free = editor(bpy.data.images.new("reference", 2, 2)), editor()
    image = show_result(windows(busy, free), result)
    assert free.image == image
    assert busy.image != image
    assert tuple(image.size) == (16, 9)


def test_next_result_replaces_the_last_and_is_read_anew(result):
    busy, free = editor(bpy.data.images.new("reference", 2, 2)), editor()
    first = show_result(windows(busy, free), result)
    write_png(result.with_suffix(".png"), np.full((3, 5, 3), 128, np.uint8))
    assert show_result(windows(busy, free), result) == first
    assert free.image == first
    assert tuple(first.size) == (5, 3)


def test_the_only_editor_shows_the_result(result):
    busy = editor(bpy.data.images.new("reference", 2, 2))
    assert show_result(windows(busy), result) == busy.image


@pytest.mark.parametrize("taken", [editor(mode="PAINT"), editor(is_pinned=True)])
def test_editors_that_paint_or_are_pinned_are_left_alone(result, taken):
    assert show_result(windows(taken), result) is None
    assert taken.image is None
    assert len(bpy.data.images) == 0


def test_without_an_image_editor_nothing_is_loaded(result):
    assert show_result(windows(editor(), kind="VIEW_3D"), result) is None
    assert len(bpy.data.images) == 0
