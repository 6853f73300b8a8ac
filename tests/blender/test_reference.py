# SPDX-License-Identifier: GPL-3.0-or-later
"""The reference is Cycles' light with all its bounces, and nothing that biases it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.cycles_passes import render_passes
from ssgi_addon.blender.reference import ReferenceOptions, render_reference
from ssgi_addon.blender.render_settings import borrow_scene
from ssgi_addon.blender.restore import Restorer
from ssgi_addon.errors import SSGIError
from tests.blender.test_capture import direct_sum
from tests.scenes import build_closed_room
from tests.tolerances import PASS_SUM_RELATIVE

FEW = ReferenceOptions(samples=4, denoiser="none")


@pytest.fixture
def room(empty_file):
    return build_closed_room()


def test_reference_is_direct_light_and_its_indirect_passes(room):
    reference = render_reference(room, FEW)
    layers = reference.layers
    total = (
        direct_sum(layers)
        + layers["Diffuse Color"] * reference.diffuse_indirect
        + layers["Glossy Color"] * reference.glossy_indirect
    )
    error = np.abs(total - reference.combined).max()
    assert reference.diffuse_indirect.max() > 0.0
    assert error < PASS_SUM_RELATIVE * reference.combined.max()


def test_without_bounces_reference_and_capture_agree(room):
    """With the same light threshold both take the same samples."""
    room.cycles.light_sampling_threshold = 0.0
    reference = render_reference(room, replace(FEW, diffuse_bounces=0, glossy_bounces=0))
    captured = capture_frame(room, CaptureOptions(samples=4, denoiser="none"))
    assert np.array_equal(reference.combined, captured.gbuffer.direct)
    assert not reference.diffuse_indirect.any()


def test_given_bounces_replace_those_of_the_scene(room):
    room.cycles.diffuse_bounces = 1
    one = render_reference(room, FEW)
    two = render_reference(room, replace(FEW, diffuse_bounces=2))
    assert two.diffuse_indirect.mean() > 1.1 * one.diffuse_indirect.mean()


def test_bounces_that_are_off_in_the_scenes_own_renders_are_on_in_the_reference(room):
    with_light = render_reference(room, FEW)
    room.cycles.diffuse_bounces = room.cycles.glossy_bounces = 0
    again = render_reference(room, FEW)
    assert with_light.diffuse_indirect.max() > 0.0
    np.testing.assert_array_equal(again.combined, with_light.combined)


def test_seed_alone_decides_the_noise(room):
    room.cycles.seed = 7
    room.cycles.use_animated_seed = True
    first = render_reference(room, FEW)
    again = render_reference(room, FEW)
    other = render_reference(room, replace(FEW, seed=1))
    assert np.array_equal(first.combined, again.combined)
    assert not np.array_equal(first.combined, other.combined)


def test_clamping_and_fast_gi_of_the_scene_do_not_count(room):
    expected = render_reference(room, FEW)
    room.cycles.sample_clamp_direct = room.cycles.sample_clamp_indirect = 0.01
    room.cycles.use_fast_gi = True
    room.cycles.light_sampling_threshold = 0.5
    found = render_reference(room, FEW)
    assert np.array_equal(found.combined, expected.combined)


def test_denoising_smooths_the_combined_picture_alone(room):
    noisy = render_reference(room, FEW)
    denoised = render_reference(room, replace(FEW, denoiser="accurate"))
    if np.array_equal(noisy.combined, denoised.combined):
        pytest.skip("this Blender has no denoiser")
    assert np.array_equal(noisy.diffuse_indirect, denoised.diffuse_indirect)
    assert np.abs(np.diff(denoised.combined, axis=1)).mean() < np.abs(np.diff(noisy.combined, axis=1)).mean()


def test_reference_has_the_asked_size(room):
    reference = render_reference(room, replace(FEW, samples=1, resolution=(20, 10)))
    assert reference.combined.shape == (10, 20, 3)
    assert reference.samples == 1
    assert reference.seconds > 0.0


def test_progress_frames_the_render(room):
    told = []
    render_reference(room, replace(FEW, samples=1), lambda fraction, text: told.append(fraction))
    assert told == [0.0, 1.0]


def test_panoramic_camera_is_refused(room):
    room.camera.data.type = "PANO"
    with pytest.raises(SSGIError, match="panoramic"):
        render_reference(room, FEW)


def test_kept_scene_renders_by_the_settings_of_now(room):
    """With persistent data, and nothing but settings of Cycles' own changed between two renders."""
    room.render.use_persistent_data = True
    with Restorer() as restorer:
        view_layer = borrow_scene(restorer, room, resolution=(32, 18))
        restorer.change(room.cycles, use_denoising=False)
        pictures = []
        for samples in (16, 1, 16):
            room.cycles.samples = samples
            pictures.append(render_passes(room, view_layer, ("Combined",)).layers["Combined"])
    assert np.array_equal(pictures[0], pictures[2])
    assert not np.array_equal(pictures[0], pictures[1])
