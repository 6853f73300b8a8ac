# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory grows with the pixels, by so many bytes each and no more, whatever the settings."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from benchmarks.inputs import analytic_room
from benchmarks.memory import bytes_per_pixel
from ssgi_addon.core import Settings, parallel
from ssgi_addon.memory import APPLY_BYTES
from tests.tolerances import BYTES_PER_PIXEL, BYTES_PER_PIXEL_WITH_VIEWS

# So many rays at work at a time that both sizes have more: what is left is what pixels take.
AT_WORK = {"balanced": 4096, "final": 32768}
SIZES = ((48, 36), (96, 72))


@pytest.fixture
def few_at_work(monkeypatch, preset):
    monkeypatch.setattr(parallel, "RAYS_AT_ONCE", AT_WORK[preset])
    monkeypatch.setattr(parallel, "RAYS_PER_TASK", AT_WORK[preset] // 4)


def frame_bytes() -> float:
    """Return how many bytes a pixel of a frame with all of its passes takes."""
    gbuffer = analytic_room(8, 6).gbuffer
    light = gbuffer.direct.nbytes
    held = sum(
        value.nbytes
        for item in fields(gbuffer)
        if isinstance(value := getattr(gbuffer, item.name), np.ndarray)
    )
    # source, glossy_source, reflectance and thickness, which the room lacks
    return (held + 3 * light + light / 3) / gbuffer.depth.size


@pytest.mark.parametrize("preset", BYTES_PER_PIXEL)
def test_each_pixel_takes_so_many_bytes(preset, few_at_work):
    found = bytes_per_pixel(SIZES, Settings.preset(preset), has_views=False)
    assert found <= BYTES_PER_PIXEL[preset]
    # What is refused before the work could not fit
    assert found + frame_bytes() >= APPLY_BYTES


@pytest.mark.parametrize("preset", BYTES_PER_PIXEL_WITH_VIEWS)
def test_each_pixel_takes_so_many_bytes_with_a_surround(preset, few_at_work):
    found = bytes_per_pixel(SIZES, Settings.preset(preset), has_views=True)
    assert found <= BYTES_PER_PIXEL_WITH_VIEWS[preset]
