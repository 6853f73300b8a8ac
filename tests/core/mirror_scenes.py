# SPDX-License-Identifier: GPL-3.0-or-later
"""Mirrors before textured things, of planes and spheres: what reflections are measured on.

World space, +Y up; the floor is at y = 0, and the camera stands on the +Z side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ssgi_addon.core import Camera
from tests.core.synthetic import Plane, Sphere, Surface, look_at

# Both cameras see about six units across the wall: one pixel of 480 is about this long there.
PIXEL_AT_WALL = 6.0 / 480.0
# Periods of the texture's red, green and blue, in pixels of a frame of 480.
PERIODS_PX = (12.0, 24.0, 48.0)


def texture(points: np.ndarray) -> np.ndarray:
    """Return a radiance (N, 3) of 0..2 that varies along all three axes, each channel with its period."""
    frequency = 2.0 * np.pi / (PIXEL_AT_WALL * np.array(PERIODS_PX))
    phase = (points[:, :, None] + np.array([0.1, 0.2, 0.3])[:, None]) * frequency
    return 1.0 + np.sin(phase).sum(axis=1) / 3.0


def _stretched(points: np.ndarray) -> np.ndarray:
    """The texture four times as large: the floor is seen askew."""
    return texture(0.25 * points)


FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), specular=1.0, source=_stretched)


def perspective(width: int, height: int) -> Camera:
    """A camera that looks slightly down, six units before the wall."""
    pose = look_at((0.0, 0.8, 0.0), (0.0, 0.55, -6.0))
    return Camera.perspective(width, height, 2.0 * math.atan(0.5), world_from_view=pose)


def orthographic(width: int, height: int) -> Camera:
    """Parallel rays, down at 12 degrees."""
    pose = look_at((0.0, 1.9, 0.0), (0.0, 0.85, -5.0))
    return Camera.orthographic(width, height, 6.0, world_from_view=pose)


LENSES = {"perspective": perspective, "orthographic": orthographic}


def wall(turn: float = 0.0) -> Plane:
    """A wall of finite width at z = -6, turned about the vertical by some degrees."""
    normal = (math.sin(math.radians(turn)), 0.0, math.cos(math.radians(turn)))
    return Plane((0.0, 0.0, -6.0), normal, source=texture, bounds=lambda p: np.abs(p[:, 0]) < 2.4)


def mirror_floor() -> list[Surface]:
    """A mirror floor before a wall that stands askew."""
    return [FLOOR, wall(turn=20.0)]


def mirror_ball() -> list[Surface]:
    """A mirror ball over the floor, before the wall."""
    return [Sphere((0.2, 0.7, -4.0), 0.6, specular=1.0), FLOOR, wall()]


def grazing_mirror() -> list[Surface]:
    """A mirror that is seen at ten degrees and less, before the wall."""
    angle = math.radians(80.0)
    normal = (-math.sin(angle), 0.0, math.cos(angle))
    return [Plane((0.2, 0.0, -6.0), normal, specular=1.0), wall()]


def box_on_mirror() -> list[Surface]:
    """A box that stands on the mirror floor and touches it, at an angle to the pixels, before the wall."""
    return [FLOOR, *_box((0.1, 0.4, -4.0), (0.5, 0.4, 0.4), math.radians(25.0)), wall()]


def ball_over_mirror() -> list[Surface]:
    """A ball that floats over the mirror floor, before the wall."""
    return [FLOOR, Sphere((0.1, 0.6, -5.0), 0.4, source=texture), wall()]


@dataclass(frozen=True)
class _Bumped(Plane):
    """A plane whose shading normals a bump map bends by up to 25 degrees; what it shows stays the same."""

    def meet(self, origin: np.ndarray, direction: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return distances and bent normals."""
        [(distance, normal)] = super().meet(origin, direction)
        points = origin + direction * np.where(np.isfinite(distance), distance, 0.0)[:, None]
        slope = 0.33 * np.sin(np.pi / PIXEL_AT_WALL * points[:, [1, 2, 0]] / np.array([5.0, 7.0, 11.0]))
        bent = normal + slope
        return [(distance, bent / np.linalg.norm(bent, axis=1, keepdims=True))]


def bumped_wall() -> list[Surface]:
    """A mirror floor before a wall that stands askew and has a bump map."""
    plain = wall(turn=20.0)
    return [FLOOR, _Bumped(plain.point, plain.normal, source=texture, bounds=plain.bounds)]


# What is built, and the index of the mirror in it.
SCENES: dict[str, tuple[Callable[[], list[Surface]], int]] = {
    "mirror floor": (mirror_floor, 0),
    "bumped wall": (bumped_wall, 0),
    "mirror ball": (mirror_ball, 0),
    "grazing mirror": (grazing_mirror, 0),
    "box on mirror": (box_on_mirror, 0),
    "ball over mirror": (ball_over_mirror, 0),
}


def _box(centre: Sequence[float], half: Sequence[float], turn: float) -> list[Surface]:
    """The six sides of a box that is turned about the vertical."""
    axes = np.array(
        [[math.cos(turn), 0.0, -math.sin(turn)], [0.0, 1.0, 0.0], [math.sin(turn), 0.0, math.cos(turn)]]
    )

    def side(axis: int, sign: float) -> Plane:
        others = [other for other in range(3) if other != axis]

        def is_on_side(points: np.ndarray) -> np.ndarray:
            local = (points - np.asarray(centre)) @ axes.T
            return (np.abs(local[:, others]) <= np.asarray(half)[others]).all(axis=1)

        point = np.asarray(centre) + sign * half[axis] * axes[axis]
        return Plane(tuple(point), tuple(axes[axis]), source=texture, bounds=is_on_side)

    return [side(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)]
