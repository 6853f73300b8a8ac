# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the fill: a small image of the indirect light as Cycles traces it, with all bounces."""

from __future__ import annotations

import bpy

from ..core import Fill
from .camera import full_size
from .cycles_passes import render_passes
from .gbuffer import GEOMETRY_PASSES, surfaces_from_passes
from .render_settings import (
    borrow_bounces,
    borrow_denoiser,
    borrow_framing,
    borrow_passes,
    borrow_pixel_centers,
)
from .restore import Restorer
from .volumes import borrow_clear_air

# Pixels of the frame that one of the fill stands for, each way.
FILL_STRIDE = 4
_LIGHT_PASSES = ("Diffuse Indirect", "Glossy Indirect")


def capture_fill(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, *, samples: int
) -> tuple[Fill, float]:
    """Render geometry and indirect light of every fourth pixel each way, in one render.

    Bounces, caustics and what else shapes the light are the scene's, but bounces are never switched off;
    clamping is off, and there is no denoiser, which would clean the sum of all light alone. Volumes are
    left out as in a surround.

    Parameters
    ----------
    scene
        Set up by `borrow_scene` for Cycles; exactly as before afterwards, also after an error.
    view_layer
        The one that renders.
    samples
        Of each pixel, all at its centre: the light belongs to the surface that depth and normal describe.

    Returns
    -------
    fill
        With the camera of the small render.
    seconds
        Wall time.

    Raises
    ------
    SSGIError
        If the render was cancelled.
    """
    with Restorer() as restorer:
        _borrow_small_frame(restorer, scene)
        borrow_pixel_centers(restorer, scene)
        borrow_bounces(restorer, scene)
        restorer.change(scene.cycles, samples=samples, sample_clamp_direct=0.0, sample_clamp_indirect=0.0)
        borrow_denoiser(restorer, scene, view_layer, denoiser="none")
        borrow_clear_air(restorer, view_layer)
        names = (*GEOMETRY_PASSES, *_LIGHT_PASSES)
        borrow_passes(restorer, view_layer, names)
        rendered = render_passes(scene, view_layer, names)
        depth, normal = surfaces_from_passes(rendered.layers, rendered.camera)
        fill = Fill(
            depth=depth,
            normal=normal,
            diffuse=rendered.layers["Diffuse Indirect"],
            glossy=rendered.layers["Glossy Indirect"],
            camera=rendered.camera,
            samples=float(samples),
        )
    return fill, rendered.seconds


def _borrow_small_frame(restorer: Restorer, scene: bpy.types.Scene) -> None:
    """Let renders return the whole frame in a quarter of its pixels each way, rounded up."""
    # A border may be smaller than a pixel of the fill; around it, light helps the filter
    restorer.change(scene.render, use_border=False)
    width, height = (-(-side // FILL_STRIDE) for side in full_size(scene))
    borrow_framing(restorer, scene, (width, height))
