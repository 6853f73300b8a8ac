# SPDX-License-Identifier: GPL-3.0-or-later
"""What a capture asks of a render engine, and what Cycles and EEVEE answer."""

from __future__ import annotations

from typing import Protocol

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SSGIError
from . import compat
from .cycles_passes import CYCLES, RenderedPasses, render_passes
from .eevee_passes import render_eevee_passes
from .gbuffer import LIGHT_PASSES, OTHER_LIGHT_PASSES
from .gl_driver import check_gl_driver
from .render_settings import borrow_denoiser
from .restore import Restorer
from .world_light import borrow_backdrop, borrow_sun, split_sun, world_radiance

FloatArray = NDArray[np.float32]


class Engine(Protocol):
    """One way to render passes.

    Attributes
    ----------
    name
        As in `CapturedFrame.engine`.
    emission_in_direct, world_in_direct
        As in `CapturedFrame`.
    denoises
        Whether it has a use for the denoiser.
    shares_geometry
        Whether its render of the light can bring depth, normals and roughness, too.
    light_passes
        All that the direct light is made of, by the passes' long names.
    """

    name: str
    emission_in_direct: bool
    world_in_direct: bool
    denoises: bool
    shares_geometry: bool
    light_passes: tuple[str, ...]

    def engine_id(self) -> str:
        """Return what ``scene.render.engine`` calls it; refuse where it is not there."""

    def borrow_scene(
        self, restorer: Restorer, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer
    ) -> FloatArray | None:
        """Set up what all renders share; return the world's light, None where the direct light holds it."""

    def borrow_geometry(
        self, restorer: Restorer, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer
    ) -> None:
        """Let the next render take one sample, and spend nothing on light."""

    def borrow_light(
        self,
        restorer: Restorer,
        scene: bpy.types.Scene,
        view_layer: bpy.types.ViewLayer,
        samples: int,
        denoiser: str,
    ) -> bool:
        """Let the next renders take the direct light; return whether Combined is denoised then."""

    def render(
        self, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, names: tuple[str, ...]
    ) -> RenderedPasses:
        """Render `scene` with the settings that it has and return passes of `view_layer`."""


class CyclesEngine:
    """Direct light of lamps, emissive meshes and the world, with true shadows."""

    name = "cycles"
    emission_in_direct = world_in_direct = denoises = shares_geometry = True
    light_passes = (*LIGHT_PASSES, *OTHER_LIGHT_PASSES)

    def engine_id(self):
        return CYCLES

    def borrow_scene(self, restorer, scene, view_layer):
        # Cycles then builds its scene once for all renders of this capture; switching it off frees it.
        restorer.change(scene.render, use_persistent_data=True)

    def borrow_geometry(self, restorer, scene, view_layer):
        # Rays that are cut out of leaves go on; all else about light is not needed.
        restorer.change(scene.cycles, samples=1, max_bounces=0)
        borrow_denoiser(restorer, scene, view_layer, denoiser="none")

    def borrow_light(self, restorer, scene, view_layer, samples, denoiser):
        restorer.change(scene.cycles, samples=samples, diffuse_bounces=0, glossy_bounces=0)
        return borrow_denoiser(restorer, scene, view_layer, denoiser)

    def render(self, scene, view_layer, names):
        return render_passes(scene, view_layer, names)


class EeveeEngine:
    """Direct light of lamps alone: emissive meshes and the world are left to our passes.

    EEVEE's direct passes hold no light of emissive meshes, and the world's without its shadows, unless ray
    tracing or baked probes guess at them. So the world is a backdrop here, and all of these are off.
    """

    name = "eevee"
    emission_in_direct = world_in_direct = denoises = shares_geometry = False
    light_passes = (*LIGHT_PASSES, "Emission", "Environment")

    def engine_id(self):
        check_gl_driver()
        return compat.eevee_engine_id()

    def borrow_scene(self, restorer, scene, view_layer):
        world = compat.world_of(view_layer)
        radiance = world_radiance(scene, world)
        if world is not None:
            radiance, sun = split_sun(radiance, world.sun_threshold)
            if sun is not None:
                borrow_sun(restorer, scene, sun, world.sun_angle)
        borrow_backdrop(restorer, scene, view_layer)
        restorer.change(scene.eevee, use_raytracing=False, use_fast_gi=False)
        # Its vertex normals have ten bits a component without this.
        restorer.change(scene.render, use_high_quality_normals=True)
        for thing in scene.objects:
            if thing.type == "LIGHT_PROBE":
                restorer.change(thing, hide_render=True)
        return radiance

    def borrow_geometry(self, restorer, scene, view_layer):
        # Shadows cost more than all the rest.
        restorer.change(scene.eevee, taa_render_samples=1, use_shadows=False)

    def borrow_light(self, restorer, scene, view_layer, samples, denoiser):
        # Its shadows cost most of the render, also where nothing casts any.
        has_lamps = any(light.users for light in bpy.data.lights)
        restorer.change(
            scene.eevee, taa_render_samples=samples, use_shadows=scene.eevee.use_shadows and has_lamps
        )
        return False

    def render(self, scene, view_layer, names):
        return render_eevee_passes(scene, view_layer, names)


_ENGINES: dict[str, Engine] = {engine.name: engine for engine in (CyclesEngine(), EeveeEngine())}


def engine_named(name: str) -> Engine:
    """Return the engine of that name.

    Raises
    ------
    SSGIError
        If there is none.
    """
    if name not in _ENGINES:
        raise SSGIError(f"Engine '{name}' cannot be captured: use {' or '.join(_ENGINES)}.")
    return _ENGINES[name]
