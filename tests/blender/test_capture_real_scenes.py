# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures of scenes that artists made: the passes add up and the camera fits."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import capture, compat, roughness
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from tests.blender.test_capture import direct_sum, reprojection_error
from tests.tolerances import PASS_SUM_RELATIVE, REPROJECTED_PX, ROUGHNESS_DENOISING

SCENES = Path(os.environ.get("SSGI_SCENES", Path(__file__).parents[3] / "shared" / "scenes"))
OPTIONS = CaptureOptions(samples=2, denoiser="none", resolution=(96, 54))


@pytest.fixture(params=["cornell_box", "spaceship", "hotel_room"])
def scene(request):
    path = SCENES / f"{request.param}.blend"
    if not path.exists():
        pytest.skip(f"no {path.name} in {SCENES}; name the folder in SSGI_SCENES")
    if bpy.app.version < (5, 0, 0):
        pytest.skip("the scenes were saved by Blender 5.0")
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def test_passes_add_up_and_points_project_to_their_pixels(scene):
    frame = capture_frame(scene, OPTIONS)
    error = np.abs(direct_sum(frame.layers) - frame.gbuffer.direct).max()
    assert error < PASS_SUM_RELATIVE * frame.gbuffer.direct.max()
    # Cycles' own hit points are off by more than this on triangles seen edge on
    assert np.quantile(reprojection_error(frame), 0.99) < REPROJECTED_PX


def test_both_sources_of_roughness_agree(scene, monkeypatch):
    if not compat.has_roughness_pass(scene.view_layers[0]):
        pytest.skip("this Blender has no roughness among its denoising passes")
    native = capture_frame(scene, OPTIONS).gbuffer
    monkeypatch.setattr(capture, "borrow_roughness", roughness.borrow_aov_roughness)
    written = capture_frame(scene, OPTIONS).gbuffer
    assert np.array_equal(native.depth, written.depth)
    assert np.quantile(np.abs(native.roughness - written.roughness), 0.99) < ROUGHNESS_DENOISING
