# SPDX-License-Identifier: GPL-3.0-or-later
from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.arguments import frame_list, frame_text
from tests.budget import examples


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        ([], ""),
        ([5], "5"),
        ([1, 2], "1-2"),
        ([3, 1, 2, 2], "1-3"),
        ([1, 2, 3, 4, 7, 9, 11, 30], "1-4,7-11:2,30"),
        ([1, 5, 6, 7], "1,5-7"),
        ([-3, -2, -1, 0], "-3-0"),
        ([10, 20], "10,20"),
    ],
)
def test_frames_are_told_shortly(frames, text):
    assert frame_text(frames) == text


@given(st.sets(st.integers(-50, 50), max_size=40))
@examples(200)
def test_any_frames_read_back(frames):
    text = frame_text(frames)
    assert (frame_list(text) if text else ()) == tuple(sorted(frames))


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("1 - 4, 7", (1, 2, 3, 4, 7)),
        ("10-1:-3", (1, 4, 7, 10)),
        ("1-9:4,2,5", (1, 2, 5, 9)),
        ("-3--1", (-3, -2, -1)),
    ],
)
def test_lists_are_read_as_queues_write_them(text, frames):
    """Open Job Description's range expressions have spaces and steps down, too."""
    assert frame_list(text) == frames
