# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the camera of a rendered frame from where its pixels are in the world.

Each pixel gives its own image point, its world position and its depth. With the depth known, a camera
is linear in the 12 entries of its projection matrix (direct linear transformation: Hartley and
Zisserman, "Multiple View Geometry", section 7.1), so plain least squares finds it.
"""

from __future__ import annotations

import math

import numpy as np

from .camera import Camera
from .types import BoolArray, FloatArray

# A reader can trust a pose that puts half of the pixels within this distance of where they are.
LARGEST_RESIDUAL_PX = 0.1
# More points do not make the pose better, only slower to find.
MOST_POINTS = 50_000
FEWEST_POINTS = 12
# Smallest spread of the points out of their best plane, relative to their spread in it: below it a plane
# is all that is seen, and a plane fits many cameras.
FLATTEST_SCENE = 1e-4
LARGEST_SKEW = 1e-3
LARGEST_SCALE_ERROR = 1e-2


def solve_camera(position_ws: FloatArray, depth: FloatArray) -> Camera:
    """Solve pose and intrinsics from the Position and Depth passes.

    Parameters
    ----------
    position_ws : (H, W, 3)
        World-space position of each pixel's surface, scene units.
    depth : (H, W)
        Its distance along the view axis; pixels that are not finite and positive do not count.

    Returns
    -------
    Camera
        Perspective or orthographic, whichever puts the points nearer to their pixels.

    Raises
    ------
    ValueError
        If too little is seen, all of it lies in one plane, or no pinhole or orthographic camera explains
        half of the pixels to 0.1 pixels (panoramic cameras; depth of field; passes of other frames).
    """
    height, width = depth.shape
    is_surface = np.isfinite(depth) & (depth > 0.0) & np.isfinite(position_ws).all(axis=-1)
    points, pixels, depths = _gather(position_ws, depth, is_surface)
    center, scale = _check_spread(points)
    unit_points = (points - center) / scale
    solutions = []
    for solve in (_solve_perspective, _solve_orthographic):
        camera = solve(unit_points, pixels, depths / scale, width, height)
        if camera is not None:
            camera.world_from_view[:3, 3] = camera.world_from_view[:3, 3] * scale + center
            camera = _rescaled(camera, scale)
            solutions.append((_residual_px(camera, points, pixels, depths), camera))
    residual, camera = min(solutions, key=lambda solution: solution[0], default=(math.inf, None))
    if camera is None or not residual <= LARGEST_RESIDUAL_PX:
        raise ValueError(
            "no perspective or orthographic camera fits Position and Depth"
            + (f" (half of the pixels are off by {residual:.2g} pixels)" if math.isfinite(residual) else "")
        )
    return camera


def _gather(
    position_ws: FloatArray, depth: FloatArray, is_surface: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Evenly chosen surface points (N, 3), their pixel centres (N, 2) and depths (N,), float64."""
    rows, columns = np.nonzero(is_surface)
    if rows.size < FEWEST_POINTS:
        raise ValueError(
            f"only {rows.size} pixels show a surface, which is too little to find the camera from"
        )
    step = max(1, rows.size // MOST_POINTS)
    rows, columns = rows[::step], columns[::step]
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=-1)
    return position_ws[rows, columns].astype(np.float64), pixels, depth[rows, columns].astype(np.float64)


def _check_spread(points: FloatArray) -> tuple[FloatArray, float]:
    """Centre and size of the points; refuse what lies in one plane."""
    center = points.mean(axis=0)
    offsets = points - center
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(offsets.T @ offsets / len(points)), 0.0))
    if not spread[0] > FLATTEST_SCENE * spread[2]:
        raise ValueError("all that is seen lies in one plane, which fits many cameras")
    return center, float(spread[2])


def _solve_perspective(
    points: FloatArray, pixels: FloatArray, depths: FloatArray, width: int, height: int
) -> Camera | None:
    # Divided by its depth, each equation's error is in pixels (and relative, for the depth itself).
    homogeneous = np.column_stack([points, np.ones(len(points))]) / depths[:, None]  # (N, 4)
    targets = np.column_stack([pixels, np.ones(len(points))])  # (N, 3)
    x_row, y_row, z_row = _least_squares(homogeneous, targets)
    length = float(np.linalg.norm(z_row[:3]))
    if abs(length - 1.0) > LARGEST_SCALE_ERROR:
        return None
    forward = z_row[:3] / length
    # Split K [R | t]: the part of a row along the axis is the principal point, the rest the focal length.
    cx, cy = float(x_row[:3] @ forward), float(y_row[:3] @ forward)
    right, up = x_row[:3] - cx * forward, -(y_row[:3] - cy * forward)
    offsets = ((x_row[3] - cx * z_row[3]), -(y_row[3] - cy * z_row[3]), -z_row[3])
    return _camera(right, up, forward, offsets, (cx, cy), width, height, is_orthographic=False)


def _solve_orthographic(
    points: FloatArray, pixels: FloatArray, depths: FloatArray, width: int, height: int
) -> Camera | None:
    homogeneous = np.column_stack([points, np.ones(len(points))])
    x_row, y_row, z_row = _least_squares(homogeneous, np.column_stack([pixels, depths]))
    length = float(np.linalg.norm(z_row[:3]))
    if abs(length - 1.0) > LARGEST_SCALE_ERROR:
        return None
    # Where the axis meets the image is free here; the centre of the image keeps the shift at 0.
    cx, cy = 0.5 * width, 0.5 * height
    offsets = (x_row[3] - cx, -(y_row[3] - cy), -z_row[3])
    return _camera(
        x_row[:3], -y_row[:3], z_row[:3] / length, offsets, (cx, cy), width, height, is_orthographic=True
    )


def _least_squares(matrix: FloatArray, targets: FloatArray) -> FloatArray:
    solution: FloatArray = np.linalg.lstsq(matrix, targets, rcond=None)[0].T
    return solution


def _camera(
    right: FloatArray,
    up: FloatArray,
    forward: FloatArray,
    offsets: tuple[float, float, float],
    center_px: tuple[float, float],
    width: int,
    height: int,
    *,
    is_orthographic: bool,
) -> Camera | None:
    """Build the camera from its scaled axes (world space) and the offsets along them."""
    fx, fy = float(np.linalg.norm(right)), float(np.linalg.norm(up))
    if not (fx > 0.0 and fy > 0.0):
        return None
    axes = np.stack([right / fx, up / fy, -forward])  # view from world
    is_mirrored = np.linalg.det(axes) < 0.0
    if is_mirrored or np.abs(axes @ axes.T - np.eye(3)).max() > LARGEST_SKEW:
        return None
    u, _, vt = np.linalg.svd(axes)
    rotation = u @ vt  # the nearest true rotation
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ (np.array(offsets) / (fx, fy, 1.0))
    return Camera(width, height, fx, fy, *center_px, is_orthographic, pose)


def _rescaled(camera: Camera, scale: float) -> Camera:
    """Undo the scaling of the world; only an orthographic camera's pixels per unit change."""
    if not camera.is_orthographic:
        return camera
    return Camera(
        camera.width,
        camera.height,
        camera.fx / scale,
        camera.fy / scale,
        camera.cx,
        camera.cy,
        True,
        camera.world_from_view,
    )


def _residual_px(camera: Camera, points_ws: FloatArray, pixels: FloatArray, depths: FloatArray) -> float:
    """Median distance in pixels; the depth counts as the parallax that its error would make at the border."""
    pose = camera.world_from_view
    x_px, y_px, depth = camera.view_to_pixel((points_ws - pose[:3, 3]) @ pose[:3, :3])
    with np.errstate(invalid="ignore", divide="ignore"):
        off_px = np.hypot(x_px - pixels[:, 0], y_px - pixels[:, 1])
        off_depth = np.abs(depth - depths) * (
            camera.fx if camera.is_orthographic else 0.5 * camera.width / depths
        )
    return float(np.median(np.maximum(off_px, off_depth)))
