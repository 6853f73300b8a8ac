# SPDX-License-Identifier: GPL-3.0-or-later
"""What perfect mirrors among planes and spheres show, in closed form and float64.

One reflection: the surface that the mirrored ray meets hands on its `source`, as in the reflection pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ssgi_addon.core import Camera
from tests.core.synthetic import Surface

# Two distances along one camera ray belong to the same point when they differ by less than this, relative.
_SAME_POINT = 1e-6


@dataclass(frozen=True, eq=False)
class Mirrored:
    """Where the mirrored rays of N pixels end; world space.

    Attributes
    ----------
    owner, surface : (N,) int64
        Index of the surface that the pixel shows, and of the one that its mirrored ray meets first; -1: none.
    radiance : (N, 3)
        What the met surface hands on, 0 where there is none.
    x_px, y_px : (N,)
        Where the camera would see the met point, pixels; NaN where there is none.
    is_visible : (N,) bool
        The camera does see it: it lies in the frame, and nothing stands before it.
    """

    owner: np.ndarray
    surface: np.ndarray
    radiance: np.ndarray
    x_px: np.ndarray
    y_px: np.ndarray
    is_visible: np.ndarray

    def only(self, chosen: np.ndarray) -> Mirrored:
        """Return some of the rays."""
        return Mirrored(*(getattr(self, field.name)[chosen] for field in fields(self)))


def mirror_at(camera: Camera, surfaces: Sequence[Surface], pixel: np.ndarray) -> Mirrored:
    """Reflect the camera's rays through the centres of flat pixel indices at the first surface they meet.

    Mirrors are planes and spheres seen from outside, which do not show themselves.
    """
    origin, direction = camera_rays(camera, pixel % camera.width + 0.5, pixel // camera.width + 0.5)
    owner, distance, normal = first_met(surfaces, origin, direction)
    point = origin + direction * np.where(owner >= 0, distance, np.nan)[:, None]
    mirrored = direction - 2.0 * (direction * normal).sum(axis=1, keepdims=True) * normal
    surface, distance, _ = first_met(surfaces, point, mirrored, leaving=owner)
    met = point + mirrored * np.where(surface >= 0, distance, np.nan)[:, None]
    x_px, y_px, is_visible = _seen(camera, surfaces, met, surface)
    return Mirrored(owner, surface, radiance_of(surfaces, surface, met), x_px, y_px, is_visible)


def surfaces_seen(
    camera: Camera, surfaces: Sequence[Surface], x_px: np.ndarray, y_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which surface (N,) the camera sees at pixel coordinates, -1 for none, and its source (N, 3)."""
    origin, direction = camera_rays(camera, x_px, y_px)
    surface, distance, _ = first_met(surfaces, origin, direction)
    point = origin + direction * np.where(surface >= 0, distance, np.nan)[:, None]
    return surface, radiance_of(surfaces, surface, point)


def camera_rays(camera: Camera, x_px: np.ndarray, y_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return world-space origins and directions (N, 3), directions per unit of depth."""
    near = camera.pixel_to_view(x_px, y_px, np.zeros(x_px.shape))
    far = camera.pixel_to_view(x_px, y_px, np.ones(x_px.shape))
    pose = camera.world_from_view
    return near @ pose[:3, :3].T + pose[:3, 3], (far - near) @ pose[:3, :3].T


def first_met(
    surfaces: Sequence[Surface],
    origin: np.ndarray,
    direction: np.ndarray,
    leaving: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return index (-1 for none), distance and normal of the first surface along rays (N, 3).

    `leaving` (N,) are surfaces that the rays start on and do not meet.
    """
    index = np.full(len(origin), -1)
    nearest = np.full(len(origin), np.inf)
    facing = np.zeros_like(origin)
    for number, surface in enumerate(surfaces):
        for distance, normal in surface.meet(origin, direction):
            is_nearer = distance < nearest
            if leaving is not None:
                is_nearer &= leaving != number
            index[is_nearer] = number
            nearest[is_nearer] = distance[is_nearer]
            facing[is_nearer] = normal[is_nearer]
    return index, nearest, facing


def radiance_of(surfaces: Sequence[Surface], index: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return what surfaces hand on at points on them (N, 3)."""
    radiance = np.zeros_like(point)
    for number, surface in enumerate(surfaces):
        mine = index == number
        radiance[mine] = surface.source(point[mine]) if callable(surface.source) else surface.source
    return radiance


def _seen(
    camera: Camera, surfaces: Sequence[Surface], point: np.ndarray, surface: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pixel coordinates of world-space points, and whether the camera sees them."""
    view_from_world = np.linalg.inv(camera.world_from_view)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y, depth = camera.view_to_pixel(point @ view_from_world[:3, :3].T + view_from_world[:3, 3])
    is_inside = (x >= 0.0) & (x < camera.width) & (y >= 0.0) & (y < camera.height) & (depth > 0.0)
    where = np.flatnonzero((surface >= 0) & is_inside)
    index, distance, _ = first_met(surfaces, *camera_rays(camera, x[where], y[where]))
    is_visible = np.zeros(len(point), dtype=np.bool_)
    is_same = (index == surface[where]) & (np.abs(distance - depth[where]) <= _SAME_POINT * depth[where])
    is_visible[where] = is_same
    return x, y, is_visible
