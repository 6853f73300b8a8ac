# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the light that Cycles finds with all its bounces, to compare with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from .cycles_passes import render_passes
from .render_settings import borrow_bounces, borrow_denoiser, borrow_passes, borrow_scene
from .restore import Restorer

FloatArray = NDArray[np.float32]

_PASSES = (
    "Combined",
    "Diffuse Direct",
    "Diffuse Indirect",
    "Diffuse Color",
    "Glossy Direct",
    "Glossy Indirect",
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
class ReferenceOptions:
    """How to render the reference.

    Attributes
    ----------
    samples
        Cycles' samples per pixel.
    denoiser
        Of the combined picture, as in `CaptureOptions`.
    resolution, frame, view_layer
        As for a capture.
    diffuse_bounces, glossy_bounces, max_bounces
        None means as the scene has. Where a surface has both lobes, Cycles draws rays for their light from
        both: without glossy bounces, diffuse light is missing too, and the other way round. Light of one
        bounce is whole with 1, 1 and 1.
    seed
        Of the noise: two references with different seeds differ by their noise alone.
    """

    samples: int = 64
    denoiser: str = "accurate"
    resolution: tuple[int, int] | None = None
    frame: int | None = None
    view_layer: str | None = None
    diffuse_bounces: int | None = None
    glossy_bounces: int | None = None
    max_bounces: int | None = None
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Reference:
    """Cycles' own global illumination.

    Attributes
    ----------
    combined : (H, W, 3)
        The picture, scene-linear.
    diffuse_indirect, glossy_indirect : (H, W, 3)
        Blender's passes of those names: incoming light, divided by the surface's colour, never denoised.
    layers
        All passes by their long names.
    seconds
        Wall time of the render.
    samples
        Per pixel.
    """

    combined: FloatArray
    diffuse_indirect: FloatArray
    glossy_indirect: FloatArray
    layers: Mapping[str, FloatArray]
    seconds: float
    samples: int


def render_reference(scene: bpy.types.Scene, options: ReferenceOptions, progress=None) -> Reference:
    """Render one frame with indirect light, free of the shortcuts that bias it.

    Clamping, adaptive sampling, fast global illumination and the light threshold are off; bounces and
    caustics are the scene's, but bounces are switched off only by the options.

    Parameters
    ----------
    scene
        Exactly as before afterwards, also after an error.
    options
        How to render.
    progress
        Called with a fraction and a text.

    Raises
    ------
    SSGIError
        If the scene cannot be rendered, or the render was cancelled.
    """
    if progress:
        progress(0.0, "Reference")
    names = ("diffuse_bounces", "glossy_bounces", "max_bounces")
    bounces = {name: getattr(options, name) for name in names}
    with Restorer() as restorer:
        view_layer = borrow_scene(
            restorer,
            scene,
            resolution=options.resolution,
            frame=options.frame,
            view_layer=options.view_layer,
        )
        borrow_bounces(restorer, scene)
        restorer.change(
            scene.cycles,
            samples=options.samples,
            seed=options.seed,
            use_animated_seed=False,
            sample_clamp_direct=0.0,
            sample_clamp_indirect=0.0,
            light_sampling_threshold=0.0,
            **{name: value for name, value in bounces.items() if value is not None},
        )
        borrow_denoiser(restorer, scene, view_layer, options.denoiser)
        borrow_passes(restorer, view_layer, _PASSES)
        rendered = render_passes(scene, view_layer, _PASSES)
    if progress:
        progress(1.0, "Reference rendered")
    return Reference(
        combined=rendered.layers["Combined"],
        diffuse_indirect=rendered.layers["Diffuse Indirect"],
        glossy_indirect=rendered.layers["Glossy Indirect"],
        layers=rendered.layers,
        seconds=rendered.seconds,
        samples=options.samples,
    )
