# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of a shot needs nothing but itself, shows every frame, and stays small enough to be sent."""

from __future__ import annotations

import base64
import re

import numpy as np
import pytest

from ssgi_addon import png
from ssgi_addon.shot import page
from ssgi_addon.shot.manifests import read_shot
from ssgi_addon.shot.report import build_report
from tests.core.browser import open_page
from tests.core.shot_folders import failed, picture_of, write_frame, write_manifest

EVIL = "<script>alert(\"x\")</script> & 'y'"


def page_of(folder, expected=None):
    return page.page_of(build_report(read_shot(folder), expected, {}), folder)


def pictures_in(text):
    return [base64.b64decode(found) for found in re.findall(r'src="data:image/png;base64,([^"]+)"', text)]


@pytest.fixture
def shot(tmp_path):
    for frame in (1, 2, 3, 7):
        metrics = {"combined": {"relmse": 0.01 * frame}}
        write_frame(tmp_path, frame, record={"metrics": metrics, "notes": [EVIL]}, machine=EVIL)
    write_manifest(tmp_path, failed(5, EVIL))
    return tmp_path


def test_page_holds_the_pictures_as_they_are(shot, tmp_path):
    found = pictures_in(page_of(shot))
    assert len(found) == 4
    for frame, data in zip((1, 2, 3, 7), found):
        (tmp_path / "a.png").write_bytes(data)
        np.testing.assert_array_equal(png.read_png(tmp_path / "a.png"), picture_of(frame))


def test_names_are_text_whatever_they_hold(shot):
    text = page_of(shot, range(1, 9))
    assert "<script" not in text
    assert "&lt;script&gt;alert(&quot;x&quot;)&lt;/script&gt; &amp; &#x27;y&#x27;" in text


def test_every_frame_has_a_cell_and_missing_ones_share_one(shot):
    text = page_of(shot, range(1, 11))
    cells = re.findall(r'<figure class="cell (\w+)[^"]*">.*?<strong>([^<]*)</strong>', text)
    assert cells == [
        ("finished", "1"), ("finished", "2"), ("finished", "3"), ("missing", "4"), ("failed", "5"),
        ("missing", "6"), ("finished", "7"), ("missing", "8-10"),
    ]  # fmt: skip


def test_frame_without_a_picture_says_why(shot):
    (shot / "frames" / "room_0002.png").write_bytes(b"broken")
    (shot / "frames" / "room_0003.png").unlink()
    text = page_of(shot)
    assert len(pictures_in(text)) == 2
    assert text.count("no picture: cannot read") == 2


def test_charts_draw_each_frame_once_and_to_scale(shot):
    text = page_of(shot)
    (bars,) = re.findall(r'<path class="bar error" d="([^"]*)"', text)
    heights = [float(low) - float(high) for low, high in re.findall(r"M[\d.]+ ([\d.]+)V([\d.]+)h", bars)]
    np.testing.assert_allclose(np.array(heights) / heights[0], [1.0, 2.0, 3.0, 7.0], rtol=0.01)


def test_many_pictures_get_smaller_together(shot, monkeypatch):
    cells = 5
    monkeypatch.setattr(page, "_PICTURE_BYTES", picture_of(1).size * cells // 4)
    found = pictures_in(page_of(shot))
    sizes = {tuple(np.frombuffer(data[16:24], ">u4")) for data in found}
    assert sizes == {(48 // 2, 27 // 2)}


def test_page_opens_in_a_browser_without_complaint(shot, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(page_of(shot, range(1, 11)), encoding="utf-8")
    shown = open_page(path, tmp_path / "profile")
    assert shown.count('<figure class="cell') == 8
    assert "http" not in re.sub(r"https?://www\.w3\.org", "", shown)


def test_frames_that_all_failed_make_a_page_too(tmp_path):
    write_manifest(tmp_path, failed(1))
    text = page_of(tmp_path)
    assert "not enough memory" in text
    assert 'class="chart"' not in text
