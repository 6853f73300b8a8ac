# SPDX-License-Identifier: GPL-3.0-or-later
"""The contact sheet of a shot as a picture: each frame in its place, and what is wrong with the shot."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon import cli
from ssgi_addon.blender import shot_picture
from ssgi_addon.blender.sheet_canvas import BACKGROUND, TextStyle, shortened, text_width
from ssgi_addon.pictures import shrunk
from ssgi_addon.shot import command
from ssgi_addon.shot.manifests import read_shot
from ssgi_addon.shot.report import build_report
from tests.blender.shown import find_picture, read_png
from tests.core.shot_folders import STEPS, failed, picture_of, write_frame, write_manifest

STYLE = TextStyle(12, 16, (1.0, 1.0, 1.0, 1.0))
GROWN = 2  # pictures of 48 pixels in cells of 128


def draw(folder, expected=None):
    report = build_report(read_shot(folder), expected, {})
    shot_picture.write_shot_picture(folder / "sheet.png", report, folder)
    return read_png(folder / "sheet.png")


def shown(frame):
    return picture_of(frame).repeat(GROWN, axis=0).repeat(GROWN, axis=1)


def test_frames_stand_unchanged_in_their_order(tmp_path):
    for frame in range(1, 8):
        write_frame(tmp_path, frame)
    sheet = draw(tmp_path)
    places = [find_picture(sheet, shown(frame)) for frame in range(1, 8)]
    assert None not in places
    assert places == sorted(places)
    assert len({row for row, _ in places}) > 1
    margins = sheet[:, :20], sheet[:, -20:], sheet[-12:]
    assert all((margin == BACKGROUND).all() for margin in margins)


def test_worst_frame_has_a_frame_and_the_longest_bar(tmp_path):
    for frame in range(1, 5):
        write_frame(tmp_path, frame, record={"seconds": STEPS | {"total": 8.0 if frame == 3 else 2.0}})
    sheet = draw(tmp_path)
    is_bar = (sheet == shot_picture._BAR_COLORS["seconds"]).all(axis=-1)
    widths, outlined = [], []
    for frame in range(1, 5):
        row, column = find_picture(sheet, shown(frame))
        left = column + (shown(frame).shape[1] - shot_picture._LEAST_CELL_WIDTH) // 2
        below = row + shown(frame).shape[0]
        widths.append(is_bar[below : below + 6, left : left + 128].any(axis=0).sum())
        outlined.append(bool((sheet[row - 1, column] == shot_picture._BAD_COLOR).all()))
    assert widths == [32, 32, 128, 32]
    assert outlined == [False, False, True, False]


def test_failed_and_missing_frames_are_empty_cells(tmp_path):
    for frame in (1, 2, 5):
        write_frame(tmp_path, frame)
    write_manifest(tmp_path, failed(3, "a reason without an end " * 50))
    (tmp_path / "frames" / "room_0002.png").write_bytes(b"broken")
    sheet = draw(tmp_path, range(1, 9))
    for color in shot_picture._EMPTY_COLORS.values():
        assert (sheet == color).all(axis=-1).sum() > 1000
    assert find_picture(sheet, shown(2)) is None
    assert find_picture(sheet, shown(5)) is not None


def test_long_shot_is_a_choice_and_small(tmp_path):
    for frame in range(1, 301):
        write_frame(tmp_path, frame)
    sheet = draw(tmp_path)
    assert sheet.shape[0] < 2000
    assert sheet.shape[1] < 2500
    for frame in (2, 299):
        small = shrunk(picture_of(frame), 2).repeat(5, axis=0).repeat(5, axis=1)
        assert find_picture(sheet, small) is not None


def test_text_is_cut_to_its_place():
    assert shortened("short", STYLE, 100) == "short"
    cut = shortened("/a/very/long/path/without/spaces" * 5, STYLE, 100)
    assert cut.startswith("/a/very")
    assert cut.endswith("…")
    assert text_width(cut, STYLE) <= 100


def test_merge_draws_where_blender_is(tmp_path, capsys):
    for frame in range(1, 4):
        write_frame(tmp_path, frame, lambda points: np.ones((len(points), 3)))
    assert cli.main(["merge", str(tmp_path)]) == cli.DONE
    assert f"picture: {tmp_path / command.PICTURE}" in capsys.readouterr().out
    assert find_picture(read_png(tmp_path / command.PICTURE), shown(2)) is not None
