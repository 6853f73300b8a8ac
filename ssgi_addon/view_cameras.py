# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras of the views beyond a frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .core import Camera
from .core.stations import CUBE_FACES, facing

Pose = NDArray[np.float64]


def square_camera(world_from_view: Pose, size: int) -> Camera:
    """Return a camera of 90 degrees and `size` x `size` pixels."""
    return Camera.perspective(size, size, 0.5 * np.pi, world_from_view=world_from_view)


def surround_cameras(camera: Camera, nearest_depth: float, clip_start: float, size: int) -> list[Camera]:
    """Return the six cameras of a surround: those of `CUBE_FACES`, each `size` pixels wide.

    A perspective frame is surrounded from its camera's place. An orthographic camera may stand anywhere on
    its axis, often far outside; there the surround goes to the middle of the frame, as far ahead as its
    front face still holds what the frame shows. Everything up to the nearest surface is empty space.

    Parameters
    ----------
    camera
        The frame's.
    nearest_depth
        Of the frame's surfaces, scene units; not finite where it shows none.
    clip_start
        Depth before which the frame shows nothing, scene units.
    size
        Pixels.
    """
    pose = camera.world_from_view.copy()
    if camera.is_orthographic:
        stand_off = 0.5 * max(camera.width / camera.fx, camera.height / camera.fy)
        ahead = max(clip_start, nearest_depth - stand_off) if np.isfinite(nearest_depth) else clip_start
        place_vs = camera.pixel_to_view(
            np.float64(0.5 * camera.width), np.float64(0.5 * camera.height), np.float64(ahead)
        )
        pose[:3, 3] += pose[:3, :3] @ place_vs
    return [square_camera(pose @ facing(face), size) for face in CUBE_FACES]


def overscan_camera(camera: Camera, factor: float) -> Camera:
    """Return a camera that sees `factor` times as wide and as high as the frame, with as many pixels.

    Its pixels are square, whatever the frame's are, and about `factor` times as large.
    """
    # Half the extent of the wider frame at depth 1 (orthographic: everywhere)
    half_x, half_y = 0.5 * factor * camera.width / camera.fx, 0.5 * factor * camera.height / camera.fy
    focal = np.sqrt(camera.width * camera.height / (4.0 * half_x * half_y))
    width, height = max(1, round(2.0 * half_x * focal)), max(1, round(2.0 * half_y * focal))
    # The optical axis is as far from the middle as in the frame
    shift = (
        (camera.cx - 0.5 * camera.width) / camera.fx * focal,
        (camera.cy - 0.5 * camera.height) / camera.fy * focal,
    )
    placed = {"shift_px": shift, "world_from_view": camera.world_from_view}
    if camera.is_orthographic:
        return Camera.orthographic(width, height, width / focal, **placed)
    return Camera.perspective(width, height, 2.0 * np.arctan(0.5 * width / focal), **placed)
