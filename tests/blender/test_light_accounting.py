# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light and ours together are Cycles' global illumination: no light is lost, none counted twice."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.reference import Reference, ReferenceOptions, render_reference
from ssgi_addon.core import Settings
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.results import compute_picture
from tests.blender.opengl import needs_opengl
from tests.scenes import build_closed_room, build_emissive_room, build_open_field
from tests.tolerances import ACCOUNTED_COMBINED, ACCOUNTED_INDIRECT, EMITTED

SIZE = (96, 54)
BOUNCES = 2


@dataclass(frozen=True)
class Case:
    frame: CapturedFrame
    reference: Reference
    bounces: int

    @property
    def is_ours_alone(self):
        """Whether the passes bring light that Cycles has in its direct passes: that of emission and world."""
        return not self.frame.world_in_direct


def build_room_with_glowing_ceiling():
    """The panel lies in the ceiling: the light above a hanging one is hidden from every camera below."""
    scene = build_emissive_room()
    scene.objects["Glowing Panel"].location.z += 0.1
    return scene


CAPTURES = {
    # The ball's unseen side lights the ground: stations show it.
    "cycles": CaptureOptions(
        samples=32, resolution=SIZE, surround=64, stations=4, view_size=64, view_samples=16
    ),
    # A coarse surround makes emitters larger, by up to half a pixel on each side.
    "eevee": CaptureOptions(
        engine="eevee", samples=8, resolution=SIZE, surround=128, view_samples=2, denoiser="none"
    ),
}
SCENES = {
    "closed room": build_closed_room,
    "open field": build_open_field,
    "emissive mesh": build_room_with_glowing_ceiling,
}


@pytest.fixture(
    scope="module",
    name="case",
    params=[
        pytest.param((name, engine), id=f"{name}, {engine}", marks=needs_opengl if engine == "eevee" else ())
        for engine in CAPTURES
        for name in SCENES
    ],
)
def captured_and_reference(request):
    name, engine = request.param
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = SCENES[name]()
    truth = ReferenceOptions(
        samples=64, denoiser="none", resolution=SIZE, diffuse_bounces=BOUNCES, glossy_bounces=BOUNCES
    )
    # In the last two scenes our first bounce through EEVEE is Cycles' direct light.
    bounces = BOUNCES + (engine == "eevee" and name != "closed room")
    return Case(capture_frame(scene, CAPTURES[engine]), render_reference(scene, truth), bounces)


def picture_of(case, frame=None):
    settings = Settings.preset("balanced")
    return compute_picture(
        frame or case.frame,
        replace(
            settings,
            diffuse=replace(settings.diffuse, rays=64 if case.is_ours_alone else 32, bounces=case.bounces),
            reflections=replace(settings.reflections, rays=16),
        ),
    )


def added_by_cycles(case):
    """What our passes have to bring."""
    if case.is_ours_alone:
        return case.reference.combined - case.frame.gbuffer.direct
    layers = case.reference.layers
    return (
        layers["Diffuse Color"] * layers["Diffuse Indirect"]
        + layers["Glossy Color"] * layers["Glossy Indirect"]
    )


def mean(image):
    return float(image.mean(dtype=float))


def test_picture_has_the_light_of_cycles(case):
    combined = picture_of(case).combined
    engine = case.frame.engine
    assert mean(combined) == pytest.approx(mean(case.reference.combined), rel=ACCOUNTED_COMBINED[engine])
    added = mean(combined - case.frame.gbuffer.direct)
    assert added == pytest.approx(mean(added_by_cycles(case)), rel=ACCOUNTED_INDIRECT[engine])


def test_what_the_frame_does_not_show_is_missing_and_not_made_up(case):
    if case.frame.environment is not None and case.frame.environment.image.any():
        pytest.skip("unknown rays bring this world's light")
    alone = picture_of(case, replace(case.frame, views=()))
    share = mean(alone.combined - case.frame.gbuffer.direct) / mean(added_by_cycles(case))
    assert 0.2 < share < 1.0


def test_sky_and_emitters_show_their_own_light_once(case):
    """Where next to nothing is reflected, both pictures are the light that is sent out."""
    layers, combined = case.reference.layers, case.reference.combined
    shines = (layers["Emission"] + layers["Environment"]).mean(axis=-1)
    is_emitter = shines > 0.9 * combined.mean(axis=-1)
    if not is_emitter.any():
        pytest.skip("nothing shines into this camera")
    ours = picture_of(case).combined
    assert mean(ours[is_emitter]) == pytest.approx(mean(combined[is_emitter]), rel=EMITTED)
