# SPDX-License-Identifier: GPL-3.0-or-later
"""What a capture takes, at most."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class CaptureOptions:
    """What to capture.

    Attributes
    ----------
    engine
        ``"cycles"`` or ``"eevee"``.
    samples
        Per pixel, of the direct light.
    denoiser
        How Cycles' denoiser cleans the direct light, where this build of Blender has one: ``"none"``,
        ``"fast"`` or ``"accurate"``; EEVEE's light is never denoised.
    view_denoiser
        The same for all views beyond the frame; None means as the frame's.
    own_geometry
        Render geometry by itself, with one sample at each pixel's centre; else (Cycles, without volumes) it
        comes with the light.
    resolution
        Width and height, pixels; None means the scene's resolution and percentage.
    frame
        Frame number; None means the current one.
    view_layer
        Name; None means the active one, or the first that renders.
    budget
        Most work for all that is captured beyond the frame, relative to that of its direct light.
    overscan
        How many times as wide and high as the frame one more view is, with as many pixels; 1 captures none.
    mirrors_only
        With a fill, take views only where sharp reflections show them.
    surround
        Width and height of each of the six views around the camera, pixels; 0 captures none.
    stations
        Most views from elsewhere that show what the frame's rays lose sight of.
    light_views
        Most views from lamps, the strongest first.
    view_size
        Width and height of stations and light views, pixels.
    view_samples
        Per pixel, of the light in all views beyond the frame.
    back_faces
        Capture how thick the visible surfaces are (Cycles), in all views.
    behind
        Capture the layer behind the visible surfaces with its light (Cycles), in all views.
    keep_passes
        Also take passes that only files hold: position, and light that is neither diffuse nor glossy.
    splits_light
        Take what surfaces hand on from passes of their own (or with `keep_passes`); else, through Cycles, it
        is what they show to the camera: a few passes less, good enough for mirrors.
    fill
        Light paths for every 4 x 4 pixels, with all bounces, in a small render (Cycles); 0 captures none.
    fill_denoiser
        How its light is denoised: ``"none"``, or as this build of Blender can, ``"fast"`` or ``"accurate"``.
    """

    engine: str = "cycles"
    samples: int = 16
    denoiser: str = "accurate"
    view_denoiser: str | None = None
    own_geometry: bool = True
    resolution: tuple[int, int] | None = None
    frame: int | None = None
    view_layer: str | None = None
    budget: float = math.inf
    overscan: float = 1.0
    surround: int = 0
    stations: int = 0
    light_views: int = 0
    view_size: int = 128
    view_samples: int = 4
    back_faces: bool = False
    behind: bool = False
    fill: int = 0
    fill_denoiser: str = "none"
    mirrors_only: bool = False
    splits_light: bool = True
    keep_passes: bool = True
