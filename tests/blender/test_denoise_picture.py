# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' denoiser cleans the finished picture, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import denoise_picture as module
from ssgi_addon.blender import one_frame
from ssgi_addon.blender.denoise_picture import can_denoise_pictures, denoise_picture
from ssgi_addon.blender.one_frame import make_picture
from ssgi_addon.core import Settings, composite
from ssgi_addon.errors import SSGIError
from ssgi_addon.job_options import JobOptions
from tests.blender.fingerprint import changes, fingerprint
from tests.scenes import build_closed_room
from tests.tolerances import DENOISED_CONSTANT, DENOISED_MEAN, DENOISED_NOISE, DENOISED_ROOM

SIZE = (64, 36)
SHAPE = (36, 64, 3)


@pytest.fixture
def room(empty_file):
    return build_closed_room()


@pytest.fixture
def denoiser(room):
    """A scene of a Blender that denoises."""
    if not can_denoise_pictures(room):
        pytest.skip("this Blender has no denoiser")
    return room


@pytest.fixture
def options(tmp_path):
    return JobOptions(
        output=tmp_path,
        settings=Settings.preset("balanced"),
        resolution=SIZE,
        samples=1,
        denoiser="together",
        fill=0,
        surround=0,
        stations=0,
        back_faces=False,
    )


def flat_wall(shade=0.5):
    """Albedo and normals of a wall that faces the camera."""
    return np.full(SHAPE, shade, np.float32), np.broadcast_to(np.float32([0, 0, 1]), SHAPE)


@pytest.mark.parametrize("level", [0.01, 1.0, 300.0])
def test_constant_picture_stays_constant(denoiser, level):
    albedo, normal = flat_wall()
    picture = np.full(SHAPE, level, np.float32)
    clean = denoise_picture(denoiser, picture, albedo, normal)
    assert clean.shape == SHAPE
    assert clean.dtype == np.float32
    inside = (clean / picture)[4:-4, 4:-4]
    assert np.abs(inside - 1.0).max() < DENOISED_CONSTANT


def test_noise_falls_and_light_stays(denoiser):
    albedo, normal = flat_wall()
    picture = np.random.default_rng(1).gamma(2.0, 0.5, SHAPE).astype(np.float32)
    clean = denoise_picture(denoiser, picture, albedo, normal)
    assert clean.std() < DENOISED_NOISE * picture.std()
    assert abs(clean.mean() / picture.mean() - 1.0) < DENOISED_MEAN


def test_rows_and_channels_keep_their_order(denoiser):
    """A picture with red above and green on the right has them there afterwards."""
    albedo, normal = flat_wall()
    picture = np.full(SHAPE, 0.1, np.float32)
    picture[:12, :, 0] = 1.0
    picture[:, 48:, 1] = 1.0
    clean = denoise_picture(denoiser, picture, albedo, normal)
    assert clean[2:8, 5:40, 0].min() > 0.5 > clean[20:, 5:40, 0].max()
    assert clean[:, 56:, 1].min() > 0.5 > clean[:, :40, 1].max()


def test_inputs_and_scene_are_as_before(denoiser):
    albedo, normal = flat_wall(shade=1.5)
    normal = normal.copy()
    picture = np.ones(SHAPE, np.float32)
    given = [values.copy() for values in (picture, albedo, normal)]
    denoiser.cycles.denoising_prefilter = "ACCURATE"
    before = fingerprint()
    denoise_picture(denoiser, picture, albedo, normal)
    assert changes(before, fingerprint()) == {}
    assert all(np.array_equal(*pair) for pair in zip(given, (picture, albedo, normal), strict=True))


def test_failure_names_what_to_do(denoiser, monkeypatch):
    # Without them Cycles finds nothing to denoise
    monkeypatch.setattr(module, "PREFIX", "other")
    albedo, normal = flat_wall()
    with pytest.raises(SSGIError, match="another denoiser"):
        denoise_picture(denoiser, np.ones(SHAPE, np.float32), albedo, normal)


def test_sum_is_clean_and_its_parts_are_as_they_came(denoiser, options):
    before = fingerprint()
    picture, seconds = make_picture(denoiser, options)
    assert changes(before, fingerprint()) == {}
    assert seconds["denoise"] > 0.0
    noisy = composite(picture.frame.gbuffer, picture.light)
    plain, _ = make_picture(denoiser, replace(options, denoiser="none"))
    assert np.array_equal(picture.frame.gbuffer.direct, plain.frame.gbuffer.direct)
    truth, _ = make_picture(denoiser, replace(options, denoiser="none", samples=64))
    error, noise = (np.mean((image - truth.combined) ** 2) for image in (picture.combined, noisy))
    assert error < DENOISED_ROOM * noise


def test_without_a_denoiser_our_filters_clean_and_a_note_says_so(room, options, monkeypatch):
    monkeypatch.setattr(one_frame, "can_denoise_pictures", lambda scene: False)
    picture, seconds = make_picture(room, options)
    plain, _ = make_picture(room, replace(options, denoiser="none"))
    assert "denoise" not in seconds
    assert np.array_equal(picture.combined, plain.combined)
    assert any("cannot denoise" in note for note in picture.frame.notes)
