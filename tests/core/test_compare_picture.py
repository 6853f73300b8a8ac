# SPDX-License-Identifier: GPL-3.0-or-later
"""What the comparison shows, as arrays; and what lies beside a result file."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from ssgi_addon.compare_picture import VIEWS, compose, view_named
from ssgi_addon.heatmap import error_map
from ssgi_addon.last_result import frame_record, reasons_skipped, reference_path

HEIGHT, WIDTH = 6, 10


@pytest.fixture
def layers():
    random = np.random.default_rng(0)
    names = ("direct", "combined", "reference")
    pictures = {name: random.random((HEIGHT, WIDTH, 3), np.float32) for name in names}
    return pictures | {"known": random.random((HEIGHT, WIDTH), np.float32)}


@pytest.mark.parametrize(("split", "border"), [(0.0, 0), (0.5, 5), (0.74, 7), (0.76, 8), (1.0, WIDTH)])
def test_split_shows_the_first_picture_left_of_the_border(layers, split, border):
    for name, left, right in (("SPLIT", "direct", "combined"), ("SPLIT_REFERENCE", "combined", "reference")):
        picture = compose(view_named(name), layers, split)
        np.testing.assert_array_equal(picture[:, :border], layers[left][:, :border])
        np.testing.assert_array_equal(picture[:, border:], layers[right][:, border:])


@pytest.mark.parametrize(
    ("name", "layer"), [("DIRECT", "direct"), ("OURS", "combined"), ("REFERENCE", "reference")]
)
def test_single_pictures_are_shown_as_they_are(layers, name, layer):
    np.testing.assert_array_equal(compose(view_named(name), layers), layers[layer])


def test_error_view_is_the_error_map(layers):
    picture = compose(view_named("ERROR"), layers)
    expected = error_map(layers["combined"], layers["reference"])
    np.testing.assert_array_equal(np.rint(picture * 255.0).astype(np.uint8), expected)


def test_known_is_grey(layers):
    picture = compose(view_named("KNOWN"), layers)
    for channel in range(3):
        np.testing.assert_array_equal(picture[..., channel], layers["known"])


def test_views_without_a_reference_need_none(layers):
    del layers["reference"]
    for view in VIEWS:
        if view.needs_reference:
            with pytest.raises(KeyError):
                compose(view, layers)
        else:
            compose(view, layers)


def test_pictures_of_two_sizes_are_refused(layers):
    layers["combined"] = layers["combined"][:-1]
    with pytest.raises(ValueError, match="one size"):
        compose(view_named("SPLIT"), layers)


def test_reference_lies_in_a_folder_of_its_own(tmp_path):
    path = reference_path(tmp_path / "room_0007.exr")
    assert path == tmp_path / "reference" / "room_0007.exr"


def write_report(folder, *records):
    (folder / "report.json").write_text(json.dumps({"frames": records}))


def test_record_is_that_of_the_results_frame(tmp_path):
    write_report(tmp_path, {"frame": 1, "known": 0.1}, {"frame": 12, "known": 0.2})
    assert frame_record(tmp_path / "room_0012.exr")["known"] == 0.2
    assert frame_record(tmp_path / "room_0002.exr") is None
    assert frame_record(tmp_path / "room.exr") is None


def test_report_that_was_written_again_is_read_again(tmp_path):
    write_report(tmp_path, {"frame": 1, "known": 0.1})
    assert frame_record(tmp_path / "room_0001.exr")["known"] == 0.1
    write_report(tmp_path, {"frame": 1, "known": 0.2})
    os.utime(tmp_path / "report.json", ns=(1, 1))  # clocks of file systems are coarse
    assert frame_record(tmp_path / "room_0001.exr")["known"] == 0.2


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"frames": 3}', '{"frames": [3]}'])
def test_what_is_no_report_holds_no_record(tmp_path, text):
    (tmp_path / "report.json").write_text(text)
    assert frame_record(tmp_path / "room_0001.exr") is None


def test_no_report_no_record(tmp_path):
    assert frame_record(tmp_path / "none" / "room_0001.exr") is None


def test_reasons_are_found_by_switch():
    record = {
        "skipped": [
            {"what": "surround, overscan", "why": "few rays leave"},
            {"what": "3 of 8 stations", "why": "too dear"},
            {"what": "lights", "why": "none"},
            {"what": "back faces", "why": "no stations"},
        ]
    }
    assert reasons_skipped(record, "surround") == ["few rays leave"]
    assert reasons_skipped(record, "overscan") == ["few rays leave"]
    assert reasons_skipped(record, "stations") == ["too dear"]
    assert reasons_skipped(record, "light_views") == ["none"]
    assert reasons_skipped(record, "back_faces") == ["no stations"]
    assert reasons_skipped(record, "behind") == []
    assert reasons_skipped(None, "fill") == []
