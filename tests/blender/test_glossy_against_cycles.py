# SPDX-License-Identifier: GPL-3.0-or-later
"""Reflections of every roughness converge to Cycles' Glossy Indirect with one bounce.

What remains at 64 rays is noise, most of it ours.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.reference import ReferenceOptions, render_reference
from ssgi_addon.core import Settings, render_indirect
from ssgi_addon.core.metrics import KNOWN_ENOUGH, bias, relmse
from ssgi_addon.frame import CapturedFrame
from tests.scenes.glossy_floor import build_glossy_floor
from tests.tolerances import (
    LOBE_BIAS,
    LOBE_BIAS_ANSWERED,
    LOBE_BIAS_DEFAULTS,
    LOBE_ERROR_LEFT,
    LOBE_RELMSE,
    LOBE_RELMSE_VERY_ROUGH,
)

SIZE = (96, 72)
SHARP = (0.0, 0.05, 0.1, 0.2, 0.4)
VERY_ROUGH = tuple(LOBE_RELMSE_VERY_ROUGH)
RAYS = 64
# Each pixel by its own rays, each ray a line.
LOBE_ALONE = {"reuse": 0, "color_pyramid": False}


@dataclass(frozen=True)
class Case:
    roughness: float
    frame: CapturedFrame
    truth: np.ndarray


@dataclass(frozen=True)
class Error:
    pixels: int
    relmse: float
    bias: float  # relative to the mean of the reference


def capture_case(roughness, *, is_metal=False):
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = build_glossy_floor(roughness, is_metal=is_metal)
    # The lamp is a point and light paths start at pixel centres: one sample of direct light is free of noise
    captured = CaptureOptions(samples=1, denoiser="none", resolution=SIZE, surround=96, view_samples=1)
    truth = ReferenceOptions(
        samples=128, denoiser="none", resolution=SIZE, diffuse_bounces=0, glossy_bounces=1
    )
    frame = capture_frame(scene, captured)
    return Case(roughness, frame, render_reference(scene, truth).glossy_indirect)


@pytest.fixture(scope="module", params=[*SHARP, *VERY_ROUGH], ids=lambda roughness: f"roughness {roughness}")
def case(request):
    return capture_case(request.param)


def reflect(case, *, views, rays=RAYS, **options):
    """The glossy light of unfiltered rays."""
    settings = Settings()
    settings = replace(
        settings,
        diffuse=replace(settings.diffuse, enabled=False),
        reflections=replace(settings.reflections, rays=rays, filter=False, **options),
    )
    return render_indirect(case.frame.gbuffer, case.frame.camera, settings, views=views)


def is_answered(case, light, least=KNOWN_ENOUGH):
    return (case.frame.gbuffer.specular.max(axis=-1) > 0.0) & (light.known_glossy >= least)


def error_of(light, case, mask):
    error = Error(
        int(np.count_nonzero(mask)),
        relmse(light.glossy, case.truth, mask=mask),
        bias(light.glossy, case.truth, mask=mask) / float(case.truth[mask].mean(dtype=float)),
    )
    print(
        f"roughness {case.roughness}, {light.rays['reflections']} rays, {error.pixels} pixels: "
        f"relMSE {error.relmse:.4f}, bias {error.bias:+.2%}"
    )
    return error


def test_frame_alone_answers_sharp_lobes_as_cycles(case):
    if case.roughness in VERY_ROUGH:
        pytest.skip("wider than what the frame shows of the surroundings")
    light = reflect(case, views=(), **LOBE_ALONE)
    error = error_of(light, case, is_answered(case, light))
    assert error.pixels > 500
    assert error.relmse <= LOBE_RELMSE
    assert abs(error.bias) <= LOBE_BIAS


@pytest.mark.parametrize("options", [LOBE_ALONE, {}], ids=["lobe alone", "defaults"])
def test_frame_and_surround_answer_every_lobe_as_cycles(case, options):
    light = reflect(case, views=case.frame.views, **options)
    error = error_of(light, case, is_answered(case, light, 0.99))
    assert error.pixels > 2000
    assert error.relmse <= LOBE_RELMSE_VERY_ROUGH.get(case.roughness, LOBE_RELMSE)
    assert abs(error.bias) <= (LOBE_BIAS_ANSWERED if options else LOBE_BIAS_DEFAULTS)


def test_error_falls_with_the_rays(case):
    """From 1 to 4 to 16 to 64 of them."""
    if case.roughness < 0.2:
        pytest.skip("so narrow that a few rays leave next to nothing")
    lights = [reflect(case, views=case.frame.views, rays=rays, **LOBE_ALONE) for rays in (1, 4, 16, RAYS)]
    mask = is_answered(case, lights[-1])
    errors = [error_of(light, case, mask).relmse for light in lights]
    assert all(more <= LOBE_ERROR_LEFT * fewer for fewer, more in itertools.pairwise(errors))


def test_metal_with_its_fresnel_reflects_as_cycles():
    """Our lobe has no Fresnel within it: the glossy colour holds its mean, which is enough for a metal."""
    case = capture_case(0.3, is_metal=True)
    light = reflect(case, views=case.frame.views, **LOBE_ALONE)
    error = error_of(light, case, is_answered(case, light))
    assert error.relmse <= LOBE_RELMSE
    assert abs(error.bias) <= LOBE_BIAS_ANSWERED
