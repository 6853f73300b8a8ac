# SPDX-License-Identifier: GPL-3.0-or-later
"""A multilayer EXR file as a render leaves it, made without one: for what reads such files.

It imports nothing of the tests, so that a check of the installed package can use it.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ssgi_addon.core import Camera
from ssgi_addon.exr import write_layers

RED, GREY = (0.8, 0.1, 0.1), (0.8, 0.8, 0.8)
# Z is up, as in Blender; the camera stands one unit above the floor and looks along Y.
WORLD_FROM_VIEW = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 1], [0, 0, 0, 1]], np.float64)
WALL_DISTANCE = 4.0


def write_rendered_passes(path: Path | str, width: int = 64, height: int = 36) -> None:
    """Write a lit red floor before a grey wall that no lamp reaches, without gloss."""
    camera = Camera.perspective(width, height, math.radians(60.0), world_from_view=WORLD_FROM_VIEW)
    x_px, y_px = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    below_horizon = np.maximum(y_px - camera.cy, 1e-3)
    depth = np.minimum(camera.fy / below_horizon, WALL_DISTANCE)
    is_floor = (depth < WALL_DISTANCE)[..., None]
    points_vs = camera.pixel_to_view(x_px, y_px, depth)
    white, black = np.ones((height, width, 3)), np.zeros((height, width, 3))
    albedo, irradiance = np.where(is_floor, RED, GREY), np.where(is_floor, white, black)
    passes = {
        "Combined": albedo * irradiance,
        "Depth": depth,
        "Position": points_vs @ WORLD_FROM_VIEW[:3, :3].T + WORLD_FROM_VIEW[:3, 3],
        "Normal": np.where(is_floor, (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
        "Diffuse Color": albedo,
        "Diffuse Direct": irradiance,
        "Glossy Color": black,
        "Glossy Direct": black,
        "Emission": black,
        "Environment": black,
        "Roughness": np.ones((height, width)),
    }
    write_layers(path, passes, letters={"Position": "XYZ", "Normal": "XYZ", "Depth": "Z"})
