# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the frame's surfaces are, for lists of pixels."""

from __future__ import annotations

import numpy as np

from .camera import Camera
from .gbuffer import GBuffer
from .types import FloatArray, IntArray


def surface_points(gbuffer: GBuffer, camera: Camera, pixel: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return view-space positions and normals, each ``(3, N)``, at the centres of flat pixel indices."""
    width = gbuffer.shape[1]
    depth = gbuffer.depth.reshape(-1).take(pixel)
    x = ((pixel % width) + 0.5).astype(depth.dtype)
    y = ((pixel // width) + 0.5).astype(depth.dtype)
    position = np.ascontiguousarray(camera.pixel_to_view(x, y, depth).T)
    normal = np.ascontiguousarray(gbuffer.normal.reshape(-1, 3).take(pixel, axis=0).T)
    return position, normal


def toward_camera(camera: Camera, position_vs: FloatArray) -> FloatArray:
    """Return unit vectors ``(3, N)`` from view-space positions toward the camera."""
    if camera.is_orthographic:
        view = np.zeros_like(position_vs)
        view[2] = 1.0
        return view
    return -position_vs / np.sqrt((position_vs * position_vs).sum(axis=0))


def move_rays(move: FloatArray, point: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points and directions (3, N) moved by a (4, 4) transform, in their own dtype."""
    rows = [[float(value) for value in row] for row in move[:3]]
    (x, y, z), (dx, dy, dz) = point, direction
    moved = np.stack([r[0] * x + r[1] * y + r[2] * z + r[3] for r in rows])
    turned = np.stack([r[0] * dx + r[1] * dy + r[2] * dz for r in rows])
    return moved, turned
