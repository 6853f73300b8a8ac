# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the fill: a small image of the indirect light as Cycles traces it, with all bounces."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ..core import Fill
from .camera import full_size
from .cycles_passes import render_passes
from .denoise_picture import denoise_picture
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
_STRIDE = 4
# The same where a denoiser cleans it, by the fewest light paths for 4 x 4 pixels: it does more for many noisy
# pixels than for a few better ones, our filter does not (ADR 22).
_FINE_STRIDES = ((64, 1), (4, 2))
# Samples are given for so many pixels of the frame, each way.
BLOCK = 4
_LIGHT_PASSES = ("Diffuse Indirect", "Glossy Indirect")


def capture_fill(
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    *,
    samples: int,
    is_fine: bool = False,
    share: float = 1.0,
) -> tuple[Fill, float]:
    """Render geometry and indirect light of every fourth pixel each way, in one render.

    Bounces, caustics and what else shapes the light are the scene's, but bounces are never switched off;
    clamping is off. Denoise it by `denoised_fill`: within the render, the denoiser would clean the sum of all
    light alone. Volumes are left out as in a surround.

    Parameters
    ----------
    scene
        Set up by `borrow_scene` for Cycles; exactly as before afterwards, also after an error.
    view_layer
        The one that renders.
    samples
        For every 4 x 4 pixels of the frame, all at the centre of a pixel: the light belongs to the surface
        that depth and normal describe.
    is_fine
        Spread the samples over more pixels: over every second one each way, or all, if they are enough.
    share
        Of the samples that are rendered, at least one a pixel: less where other fills are there to be merged
        with, more in one that is to be merged with others.

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
    stride = next((stride for least, stride in _FINE_STRIDES if is_fine and samples >= least), _STRIDE)
    samples = max(1, round(share * samples * (stride / BLOCK) ** 2))
    with Restorer() as restorer:
        _borrow_small_frame(restorer, scene, stride)
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


def denoised_fill(
    scene: bpy.types.Scene, fill: Fill, *, denoiser: str = "fast", has_glossy: bool = True
) -> Fill:
    """Return a fill whose light Cycles' denoiser cleaned; scene and errors as in `denoise_picture`.

    Parameters
    ----------
    scene, fill
        Of the same render.
    denoiser
        ``"fast"`` or ``"accurate"``.
    has_glossy
        Whether anything takes the glossy light: it is left as it is otherwise.
    """
    white = np.ones((*fill.shape, 3), dtype=np.float32)
    names = ("diffuse", "glossy") if has_glossy else ("diffuse",)
    clean = {
        name: denoise_picture(scene, getattr(fill, name), white, fill.normal, denoiser=denoiser)
        for name in names
    }
    return replace(fill, **clean, is_denoised=True)


def _borrow_small_frame(restorer: Restorer, scene: bpy.types.Scene, stride: int) -> None:
    """Let renders return the whole frame in a fraction of its pixels each way, rounded up."""
    # A border may be smaller than a pixel of the fill; around it, light helps the filter
    restorer.change(scene.render, use_border=False)
    width, height = (-(-side // stride) for side in full_size(scene))
    borrow_framing(restorer, scene, (width, height))
