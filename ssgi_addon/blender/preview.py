# SPDX-License-Identifier: GPL-3.0-or-later
"""A small picture of a scene with its indirect light, as an image of the open file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..core import composite
from ..job_options import JobOptions
from ..results import FloatArray, Picture
from .camera import full_size
from .float_image import show_in_image
from .one_frame import make_picture

IMAGE_NAME = "SSGI Preview"
_PRESET = "draft"


def render_preview(
    scene: bpy.types.Scene, scale: float, progress: Callable[[float, str], None] | None = None
) -> bpy.types.Image:
    """Render a frame by the draft preset and put it into the image of the preview.

    Parameters
    ----------
    scene
        With the extension's settings: its engine, the passes that are on, strength and tint count.
    scale
        Width and height, relative to the render's.
    progress
        Called with a fraction and a text; may raise to stop.

    Raises
    ------
    SSGIError
        If the scene cannot be captured.
    """
    group = scene.ssgi
    width, height = (max(1, round(scale * side)) for side in full_size(scene))
    options = JobOptions.preset(_PRESET, Path(), engine=group.engine, resolution=(width, height))
    settings = replace(
        options.settings,
        diffuse=replace(options.settings.diffuse, enabled=group.diffuse.enabled),
        reflections=replace(options.settings.reflections, enabled=group.reflections.enabled),
    )
    picture, _ = make_picture(scene, replace(options, settings=settings), progress=progress)
    return show_in_image(IMAGE_NAME, _with_look(picture, group))


def _with_look(picture: Picture, group: bpy.types.PropertyGroup) -> FloatArray:
    """Return the picture with strength and tint of each kind of light, as the node group makes it."""
    light = picture.light
    looks = {
        kind: np.float32(getattr(group, f"{kind}_strength"))
        * np.array(getattr(group, f"{kind}_tint"), np.float32)
        * getattr(light, kind)
        for kind in ("diffuse", "glossy")
    }
    return composite(picture.frame.gbuffer, replace(light, **looks))
