# SPDX-License-Identifier: GPL-3.0-or-later
"""Capture a frame's G-buffer and direct light through Cycles or EEVEE, and leave the scene as it was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import Camera, Environment
from ..errors import SSGIError
from ..frame import CapturedFrame
from .capture_notes import capture_notes
from .cycles_passes import RenderedPasses
from .engines import Engine, engine_named
from .fill import capture_fill
from .gbuffer import gbuffer_from_passes
from .render_settings import borrow_passes, borrow_pixel_centers, borrow_scene
from .restore import Restorer
from .roughness import borrow_roughness
from .surround import capture_surround, surround_pose
from .volumes import borrow_clear_air

FloatArray = NDArray[np.float32]
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class CaptureOptions:
    """What to capture.

    Attributes
    ----------
    engine
        ``"cycles"`` or ``"eevee"``.
    samples
        Per pixel, of the direct light.
    denoise
        Denoise the direct light where this build of Blender has a denoiser; EEVEE's is never denoised.
    resolution
        Width and height, pixels; None means the scene's resolution and percentage.
    frame
        Frame number; None means the current one.
    view_layer
        Name; None means the active one, or the first that renders.
    surround
        Width and height of each of the six views around the camera, pixels; 0 captures none.
    surround_samples
        Per pixel, of the light in those views.
    fill
        Samples per pixel of a small render of the indirect light, through Cycles alone; 0 captures none.
    """

    engine: str = "cycles"
    samples: int = 16
    denoise: bool = True
    resolution: tuple[int, int] | None = None
    frame: int | None = None
    view_layer: str | None = None
    surround: int = 0
    surround_samples: int = 4
    fill: int = 0


def capture_frame(
    scene: bpy.types.Scene, options: CaptureOptions, progress: Progress | None = None
) -> CapturedFrame:
    """Render geometry and direct light of one frame.

    Two renders: geometry from a single sample at each pixel's centre, since averaged normals belong to no
    surface; and light with as many samples as asked for, without diffuse and glossy bounces. A surround
    takes six small ones more, a fill another one.

    Parameters
    ----------
    scene
        Exactly as before afterwards, also after an error.
    options
        What to capture.
    progress
        Called with a fraction and a text before each step; an exception from it ends the capture.

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
    engine = engine_named(options.engine)
    if options.fill and engine.name != "cycles":
        raise SSGIError("A fill is rendered by Cycles alone: choose it as the engine, or set the fill to 0.")
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
        report(0.0, "Geometry")
        geometry, roughness = _capture_geometry(engine, scene, view_layer)
        report(0.3, "Direct light")
        light, is_denoised = _capture_light(engine, scene, view_layer, options)
        notes = capture_notes(scene)
        frame = _assemble(engine, geometry, roughness, light, is_denoised, notes)
        frame = replace(frame, environment=_environment(world, frame.camera))
        if options.surround:
            frame = _add_surround(engine, frame, scene, view_layer, options, report)
        if options.fill:
            report(0.97, "Fill")
            fill, seconds = capture_fill(scene, view_layer, samples=options.fill)
            frame = replace(frame, fill=fill, seconds={**frame.seconds, "fill": seconds})
    if options.denoise and engine.denoises and not is_denoised:
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
        names = ("Depth", "Normal", "Position", *roughness.passes)
        if not engine.emission_in_direct:
            names = (*names, "Emission")
        borrow_passes(restorer, view_layer, names)
        rendered = engine.render(scene, view_layer, names)
        return rendered, roughness.read(rendered.layers)


def _capture_light(
    engine: Engine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, options: CaptureOptions
) -> tuple[RenderedPasses, bool]:
    """Render the light that needs no bounce; return its passes and whether Combined is denoised."""
    with Restorer() as restorer:
        is_denoised = engine.borrow_light(
            restorer, scene, view_layer, samples=options.samples, denoise=options.denoise
        )
        borrow_passes(restorer, view_layer, engine.light_passes)
        return engine.render(scene, view_layer, engine.light_passes), is_denoised


def _add_surround(
    engine: Engine,
    frame: CapturedFrame,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    options: CaptureOptions,
    report: Progress,
) -> CapturedFrame:
    """Return the frame with the views around it, none where no surface could send rays into them."""
    nearest = float(frame.gbuffer.depth.min())
    if not np.isfinite(nearest):
        return frame
    views, seconds = capture_surround(
        engine,
        scene,
        view_layer,
        surround_pose(frame.camera, nearest, scene.camera.data.clip_start),
        size=options.surround,
        samples=options.surround_samples,
        denoise=options.denoise,
        progress=lambda fraction, text: report(0.7 + 0.27 * fraction, text),
    )
    return replace(frame, views=views, seconds={**frame.seconds, "surround": seconds})


def _environment(radiance: FloatArray | None, camera: Camera) -> Environment | None:
    if radiance is None:
        return None
    if radiance.shape[:2] == (1, 1):
        return Environment.constant(radiance[0, 0])
    return Environment.equirectangular(radiance, camera.world_from_view)


def _assemble(
    engine: Engine,
    geometry: RenderedPasses,
    roughness: FloatArray,
    light: RenderedPasses,
    is_denoised: bool,
    notes: tuple[str, ...],
) -> CapturedFrame:
    layers = {**light.layers, **{name: geometry.layers[name] for name in ("Depth", "Normal", "Position")}}
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
        seconds={"geometry": geometry.seconds, "light": light.seconds},
        notes=notes,
    )


def _ignore(fraction: float, text: str) -> None:
    """Stand in for a progress callback."""
