# SPDX-License-Identifier: GPL-3.0-or-later
"""Capture a frame's G-buffer and direct light through Cycles or EEVEE, and leave the scene as it was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import Camera, Environment
from ..errors import SSGIError
from ..frame import CapturedFrame
from .beyond import BeyondTheFrame
from .capture_notes import capture_notes
from .capture_options import CaptureOptions
from .cycles_passes import RenderedPasses
from .engines import Engine, engine_named
from .gbuffer import GEOMETRY_PASSES, LIGHT_PASSES, SUM_PASSES, gbuffer_from_passes
from .kept_world import KeptWorld
from .render_settings import borrow_passes, borrow_pixel_centers, borrow_scene
from .restore import Restorer
from .roughness import borrow_roughness
from .volumes import borrow_clear_air, has_volumes

__all__ = ["CaptureOptions", "capture_frame"]

FloatArray = NDArray[np.float32]
Progress = Callable[[float, str], None]

_GEOMETRY = (*GEOMETRY_PASSES, "Position")


def capture_frame(
    scene: bpy.types.Scene,
    options: CaptureOptions,
    progress: Progress | None = None,
    kept: KeptWorld | None = None,
) -> CapturedFrame:
    """Render geometry and direct light of one frame.

    Two renders: geometry from a single sample at each pixel's centre, since averaged normals belong to no
    surface; and light with as many samples as asked for, without diffuse and glossy bounces. Where the
    options allow it, and no volume scatters light, Cycles takes both from one render. Each view beyond
    the frame takes one more; back faces and the layer behind take one more of each view, and the fill takes
    one of its own.

    Parameters
    ----------
    scene
        Exactly as before afterwards, also after an error.
    options
        What to capture.
    progress
        Called with a fraction and a text before each step; an exception from it ends the capture.
    kept
        What earlier frames of this scene captured of its world; this one's captures are kept there, too.

    Returns
    -------
    CapturedFrame
        Through Cycles with the direct light of lamps, emissive meshes and the world; through EEVEE with that
        of lamps alone, emission in what surfaces hand on, and the world as the frame's environment.

    Raises
    ------
    SSGIError
        If the scene cannot be captured, or the render was cancelled.
    """
    if options.surround < 0 or options.view_size < 1:
        size = options.surround if options.surround < 0 else options.view_size
        raise SSGIError(f"A view of {size} x {size} has no pixels: give at least 1 x 1.")
    engine = engine_named(options.engine)
    report = progress or _ignore
    with Restorer() as restorer:
        view_layer = borrow_scene(
            restorer,
            scene,
            resolution=options.resolution,
            frame=options.frame,
            view_layer=options.view_layer,
            engine_id=engine.engine_id(),
        )
        world = engine.borrow_scene(restorer, scene, view_layer)
        notes = capture_notes(scene)
        report(0.0, "Geometry")
        geometry: RenderedPasses | None = None
        if options.own_geometry or not engine.shares_geometry or has_volumes(view_layer):
            geometry, roughness = _capture_geometry(engine, scene, view_layer)
            report(0.3, "Direct light")
            light, is_denoised = _capture_light(engine, scene, view_layer, options)
        else:
            light, roughness, is_denoised = _capture_together(engine, scene, view_layer, options)
        frame = assemble_frame(engine, geometry, roughness, light, is_denoised, notes)
        frame = replace(frame, environment=_environment(world, frame.camera))
        if kept is not None:
            kept.look_at(scene, view_layer)
            if kept.note:
                frame = replace(frame, notes=(*frame.notes, kept.note))
        frame = BeyondTheFrame(engine, scene, view_layer, options, report, kept).added_to(frame)
    if options.denoiser != "none" and engine.denoises and not is_denoised:
        note = "This Blender has no denoiser: the direct light is not denoised."
        frame = replace(frame, notes=(*frame.notes, note))
    report(1.0, "Captured")
    return frame


def _capture_geometry(
    engine: Engine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer
) -> tuple[RenderedPasses, FloatArray]:
    """Render one sample at the centre of each pixel; return its passes and the roughness."""
    with Restorer() as restorer:
        engine.borrow_geometry(restorer, scene, view_layer)
        borrow_pixel_centers(restorer, scene)
        borrow_clear_air(restorer, view_layer)
        roughness = borrow_roughness(restorer, view_layer)
        names = (*_GEOMETRY, *roughness.passes)
        if not engine.emission_in_direct:
            names = (*names, "Emission")
        borrow_passes(restorer, view_layer, names)
        rendered = engine.render(scene, view_layer, names)
        return rendered, roughness.read(rendered.layers)


def _capture_together(
    engine: Engine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, options: CaptureOptions
) -> tuple[RenderedPasses, FloatArray, bool]:
    """Render light and geometry at once; return the passes, the roughness and whether Combined is denoised.

    Depth is then of one of the samples of each pixel, normals and roughness are means over all of them.
    """
    with Restorer() as restorer:
        is_denoised = engine.borrow_light(restorer, scene, view_layer, options.samples, options.denoiser)
        roughness = borrow_roughness(restorer, view_layer)
        geometry = _GEOMETRY if options.keep_passes else GEOMETRY_PASSES
        light = _light_passes(engine, is_denoised, options)
        names = tuple(dict.fromkeys((*light, *geometry, *roughness.passes)))
        borrow_passes(restorer, view_layer, names)
        rendered = engine.render(scene, view_layer, names)
        return rendered, roughness.read(rendered.layers), is_denoised


def _capture_light(
    engine: Engine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, options: CaptureOptions
) -> tuple[RenderedPasses, bool]:
    """Render the light that needs no bounce; return its passes and whether Combined is denoised."""
    with Restorer() as restorer:
        is_denoised = engine.borrow_light(restorer, scene, view_layer, options.samples, options.denoiser)
        names = _light_passes(engine, is_denoised, options)
        borrow_passes(restorer, view_layer, names)
        return engine.render(scene, view_layer, names), is_denoised


def _light_passes(engine: Engine, is_denoised: bool, options: CaptureOptions) -> tuple[str, ...]:
    """Return the passes of light to take: each costs time, in the render and after it."""
    if options.keep_passes or not engine.world_in_direct:
        return engine.light_passes
    if not options.splits_light:
        return SUM_PASSES
    # What is neither diffuse nor glossy tells how much of a denoised sum is reflected light
    return engine.light_passes if is_denoised else LIGHT_PASSES


def _environment(radiance: FloatArray | None, camera: Camera) -> Environment | None:
    if radiance is None:
        return None
    if radiance.shape[:2] == (1, 1):
        return Environment.constant(radiance[0, 0])
    return Environment.equirectangular(radiance, camera.world_from_view)


def assemble_frame(
    engine: Engine,
    geometry: RenderedPasses | None,
    roughness: FloatArray,
    light: RenderedPasses,
    is_denoised: bool = False,
    notes: tuple[str, ...] = (),
) -> CapturedFrame:
    """Make a frame of what an engine rendered; without `geometry` the light has depth and normals, too."""
    layers, seconds = dict(light.layers), {"light": light.seconds}
    if geometry is not None:
        layers |= {name: geometry.layers[name] for name in _GEOMETRY}
        seconds = {"geometry": geometry.seconds, **seconds}
    else:
        geometry = light
    return CapturedFrame(
        gbuffer=gbuffer_from_passes(
            layers,
            roughness,
            geometry.camera,
            is_denoised=is_denoised,
            emission=None if engine.emission_in_direct else geometry.layers["Emission"],
        ),
        camera=geometry.camera,
        environment=None,
        engine=engine.name,
        emission_in_direct=engine.emission_in_direct,
        world_in_direct=engine.world_in_direct,
        layers=layers,
        seconds=seconds,
        notes=notes,
    )


def _ignore(fraction: float, text: str) -> None:
    """Stand in for a progress callback."""
