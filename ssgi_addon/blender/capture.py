# SPDX-License-Identifier: GPL-3.0-or-later
"""Capture a frame's G-buffer and direct light through Cycles, and leave the scene as it was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..blender_passes import FARTHEST_SURFACE
from ..core import Camera, GBuffer
from ..errors import SSGIError
from ..frame import CapturedFrame
from .capture_notes import capture_notes
from .cycles_passes import RenderedPasses, render_passes
from .render_settings import borrow_denoiser, borrow_passes, borrow_scene
from .restore import Restorer
from .roughness import borrow_roughness
from .volumes import borrow_clear_air

FloatArray = NDArray[np.float32]
Progress = Callable[[float, str], None]

_LIGHT_PASSES = (
    "Combined",
    "Diffuse Direct",
    "Diffuse Color",
    "Glossy Direct",
    "Glossy Color",
    "Transmission Direct",
    "Transmission Indirect",
    "Transmission Color",
    "Volume Direct",
    "Volume Indirect",
    "Emission",
    "Environment",
)


@dataclass(frozen=True)
class CaptureOptions:
    """What to capture.

    Attributes
    ----------
    engine
        ``"cycles"``.
    samples
        Cycles' samples of the direct light.
    denoise
        Denoise the direct light where this build of Blender has a denoiser.
    resolution
        Width and height, pixels; None means the scene's resolution and percentage.
    frame
        Frame number; None means the current one.
    view_layer
        Name; None means the active one, or the first that renders.
    """

    engine: str = "cycles"
    samples: int = 16
    denoise: bool = True
    resolution: tuple[int, int] | None = None
    frame: int | None = None
    view_layer: str | None = None


def capture_frame(
    scene: bpy.types.Scene, options: CaptureOptions, progress: Progress | None = None
) -> CapturedFrame:
    """Render geometry and direct light of one frame.

    Two renders: geometry from a single sample at each pixel's centre, since averaged normals belong to no
    surface; and light with as many samples as asked for, without diffuse and glossy bounces.

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
        With the direct light of lamps, emissive meshes and the world.

    Raises
    ------
    SSGIError
        If the scene cannot be captured, or the render was cancelled.
    """
    if options.engine != "cycles":
        raise SSGIError(f"Engine '{options.engine}' cannot be captured: use cycles.")
    report = progress or _ignore
    with Restorer() as restorer:
        view_layer = borrow_scene(
            restorer,
            scene,
            resolution=options.resolution,
            frame=options.frame,
            view_layer=options.view_layer,
        )
        report(0.0, "Geometry")
        geometry, roughness = _capture_geometry(scene, view_layer)
        report(0.3, "Direct light")
        light, is_denoised = _capture_light(scene, view_layer, options)
        notes = capture_notes(scene)
    if options.denoise and not is_denoised:
        notes = (*notes, "This Blender has no denoiser: the direct light is not denoised.")
    report(1.0, "Captured")
    return _assemble(geometry, roughness, light, notes)


def _capture_geometry(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer
) -> tuple[RenderedPasses, FloatArray]:
    """Render one sample at the centre of each pixel; return its passes and the roughness."""
    with Restorer() as restorer:
        restorer.change(
            scene.cycles,
            samples=1,
            # The narrowest filter; a box filter would ignore its width.
            pixel_filter_type="BLACKMAN_HARRIS",
            filter_width=0.01,
            # Rays that are cut out of leaves go on; all else about light is not needed.
            max_bounces=0,
        )
        restorer.change(scene.render, use_motion_blur=False)
        restorer.change(scene.camera.data.dof, use_dof=False)
        borrow_denoiser(restorer, scene, view_layer, wanted=False)
        borrow_clear_air(restorer, view_layer)
        roughness = borrow_roughness(restorer, view_layer)
        names = ("Depth", "Normal", "Position", *roughness.passes)
        borrow_passes(restorer, view_layer, names)
        rendered = render_passes(scene, view_layer, names)
        return rendered, roughness.read(rendered.layers)


def _capture_light(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, options: CaptureOptions
) -> tuple[RenderedPasses, bool]:
    """Render the light that needs no bounce; return its passes and whether Combined is denoised."""
    with Restorer() as restorer:
        restorer.change(scene.cycles, samples=options.samples, diffuse_bounces=0, glossy_bounces=0)
        is_denoised = borrow_denoiser(restorer, scene, view_layer, options.denoise)
        borrow_passes(restorer, view_layer, _LIGHT_PASSES)
        return render_passes(scene, view_layer, _LIGHT_PASSES), is_denoised


def _assemble(
    geometry: RenderedPasses, roughness: FloatArray, light: RenderedPasses, notes: tuple[str, ...]
) -> CapturedFrame:
    camera = geometry.camera
    depth = geometry.layers["Depth"]
    source = light.layers["Diffuse Direct"] * light.layers["Diffuse Color"]
    gbuffer = GBuffer(
        depth=np.where(depth < FARTHEST_SURFACE, depth, np.float32(np.inf)),
        normal=_world_to_view(geometry.layers["Normal"], camera),
        albedo=light.layers["Diffuse Color"],
        specular=light.layers["Glossy Color"],
        roughness=roughness,
        direct=light.layers["Combined"],
        source=source,
        glossy_source=source + light.layers["Glossy Direct"] * light.layers["Glossy Color"],
    )
    return CapturedFrame(
        gbuffer=gbuffer,
        camera=camera,
        environment=None,
        engine="cycles",
        emission_in_direct=True,
        world_in_direct=True,
        layers={
            **light.layers,
            "Depth": depth,
            "Normal": geometry.layers["Normal"],
            "Position": geometry.layers["Position"],
        },
        seconds={"geometry": geometry.seconds, "light": light.seconds},
        notes=notes,
    )


def _world_to_view(normal_ws: FloatArray, camera: Camera) -> FloatArray:
    """Rotate world-space normals into view space; rows times the pose are columns times its transpose."""
    rotation = camera.world_from_view[:3, :3].astype(np.float32)
    return np.einsum("hwi,ij->hwj", normal_ws, rotation)


def _ignore(fraction: float, text: str) -> None:
    """Stand in for a progress callback."""
