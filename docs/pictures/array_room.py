# SPDX-License-Identifier: GPL-3.0-or-later
"""A room of planes and balls as arrays: scenes of the pictures that need no Blender.

World space, +Y up; the camera stands in the room and looks down -Z. Direct light is that of two point lamps
with their shadows, in closed form; `trace_paths` tells what Cycles would of the indirect light.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ssgi_addon.core import Camera, Environment, Fill, GBuffer
from ssgi_addon.core.lobes import Lobes
from ssgi_addon.core.sampling import cosine_directions
from tests.core.synthetic import Plane, Radiance, Sphere, capture, look_at

Image = npt.NDArray[np.float32]
Points = npt.NDArray[np.float64]
Vector = tuple[float, float, float]

SIZE = (240, 135)
MAIN_LAMP: Vector = (0.5, 1.5, -1.9)
_LAMPS: tuple[tuple[Vector, float], ...] = ((MAIN_LAMP, 6.0), ((-0.5, 1.3, 1.2), 3.0))
_WHITE, _RED, _GREEN = (0.75, 0.75, 0.75), (0.70, 0.08, 0.06), (0.10, 0.45, 0.12)
_ORANGE, _BLUE, _YELLOW = (0.80, 0.35, 0.05), (0.12, 0.22, 0.65), (0.80, 0.60, 0.10)
# A shadow ray begins and ends just off its surfaces.
_OFF_SURFACE = 1e-4
_MOST_BOUNCES = 5


@dataclass(frozen=True)
class Room:
    """Surfaces, and which of them make one closed thing.

    Attributes
    ----------
    surfaces
        With the direct light that they hand on.
    things
        Number of the thing that each belongs to; 0 for walls, which have no back.
    """

    surfaces: tuple[Surface, ...]
    things: tuple[int, ...]

    def frame(self, camera: Camera) -> GBuffer:
        """Return what a camera sees."""
        return capture(camera, self.surfaces)

    def with_layers(self, camera: Camera, *, back_faces: bool, behind: bool) -> GBuffer:
        """Return what a camera sees, with the thickness of things, and with what stands behind them."""
        front = capture(camera, self.surfaces, layers=3)
        marked = [
            replace(s, source=float(thing)) for s, thing in zip(self.surfaces, self.things, strict=True)
        ]
        first = capture(camera, marked, layers=2)
        second = first.behind
        assert second is not None
        assert front.behind is not None
        is_back = (first.direct[..., 0] == second.direct[..., 0]) & (first.direct[..., 0] > 0.0)
        thickness = np.where(is_back, front.behind.depth - front.depth, 0.02 * front.depth)
        return replace(
            front,
            thickness=np.nan_to_num(thickness, posinf=0.0, nan=0.0) if back_faces else None,
            behind=_chosen(is_back, front.behind.behind, front.behind) if behind else None,
        )


def _chosen(mask: npt.NDArray[np.bool_], one: GBuffer | None, other: GBuffer) -> GBuffer:
    """Return a G-buffer that is one where a mask says so, and elsewhere the other."""
    assert one is not None
    names = ("depth", "normal", "albedo", "specular", "roughness", "direct")
    planes = {}
    for name in names:
        a, b = getattr(one, name), getattr(other, name)
        planes[name] = np.where(mask if a.ndim == 2 else mask[..., None], a, b)
    return GBuffer(**planes)


def build_room() -> Room:
    """A closed room: red and green walls, an orange one behind the camera, things of many kinds."""
    walls = [
        Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=_tiles, specular=(0.25,) * 3, roughness=0.2),
        Plane((0.0, 2.0, 0.0), (0.0, -1.0, 0.0), albedo=_WHITE),
        Plane((-1.5, 0.0, 0.0), (1.0, 0.0, 0.0), albedo=_RED),
        Plane((1.5, 0.0, 0.0), (-1.0, 0.0, 0.0), albedo=_GREEN),
        Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), albedo=_WHITE),
        Plane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0), albedo=_ORANGE),
    ]
    return _lit(walls, _things())


def build_yard() -> Room:
    """The same things under an open sky: a floor, and a wall behind them; no lamps."""
    floor = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=(0.6, 0.6, 0.6))
    wall = Plane(
        (0.0, 0.0, -4.0),
        (0.0, 0.0, 1.0),
        albedo=_WHITE,
        bounds=lambda p: (p[:, 1] < 1.3) & (abs(p[:, 0]) < 1.5),
    )
    room = _lit([floor, wall], _things())
    return replace(room, surfaces=tuple(replace(surface, source=0.0) for surface in room.surfaces))


def build_sky(sun: float = 1500.0) -> Environment:
    """A blue sky above dark ground, with a sun of a few pixels at the left."""
    height, width = 64, 128
    up = np.cos((np.arange(height) + 0.5) / height * np.pi)[:, None, None]
    blue, ground = np.array([0.35, 0.5, 0.8]), np.array([0.12, 0.11, 0.1])
    image = np.where(up > 0.0, blue * (0.6 + 0.4 * (1.0 - up)), ground) * np.ones((height, width, 1))
    image[15:17, 98:100] = sun
    # Blender's world has +Z up; the room's view space +Y
    z_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return Environment.equirectangular(image, z_up @ room_camera().world_from_view[:3, :3])


def room_camera(size: tuple[int, int] = SIZE) -> Camera:
    """The camera in the room."""
    pose = look_at((0.0, 1.0, 0.7), (0.0, 0.72, -4.0))
    return Camera.perspective(*size, math.radians(58.0), world_from_view=pose)


def trace_paths(room: Room, frame: GBuffer, camera: Camera, paths: int, seed: int = 0) -> tuple[Image, Image]:
    """Return the mean incoming indirect light of pixels, diffuse and glossy, ``(H, W, 3)`` each.

    Plain path tracing over the room's surfaces, which hand on diffuse light alone: noise falls with `paths`,
    the number of them per pixel.
    """
    pixel = np.flatnonzero(~frame.is_background)
    row, column = np.divmod(pixel, camera.width)
    pose = camera.world_from_view
    place = camera.pixel_to_view(
        column + 0.5, row + 0.5, frame.depth.reshape(-1).take(pixel).astype(np.float64)
    )
    normal = frame.normal.reshape(-1, 3).take(pixel, axis=0).astype(np.float64)
    view = -place / np.linalg.norm(place, axis=1, keepdims=True)
    lobes = Lobes.at(normal.T, view.T, frame.roughness.reshape(-1).take(pixel).astype(np.float64))
    origin = place @ pose[:3, :3].T + pose[:3, 3]
    origin += (normal @ pose[:3, :3].T) * _OFF_SURFACE
    random = np.random.default_rng(seed)
    light = np.zeros((2, frame.depth.size, 3))
    for _ in range(paths):
        u, v = random.random((2, 1, pixel.size))
        for kind, direction in enumerate((cosine_directions(u, v, normal.T), lobes.draw(u, v, False)[0])):
            world = direction[:, 0].T @ pose[:3, :3].T
            light[kind, pixel] += _followed(room, origin, world, random) / paths
    diffuse, glossy = light.reshape(2, *frame.direct.shape).astype(np.float32)
    return diffuse, glossy


def build_fill(room: Room, camera: Camera, paths: int, shrink: int = 4, *, is_denoised: bool = True) -> Fill:
    """Return a path-traced fill; many paths stand in for a denoiser."""
    small = room_camera((camera.width // shrink, camera.height // shrink))
    frame = room.frame(small)
    diffuse, glossy = trace_paths(room, frame, small, paths)
    return Fill(frame.depth, frame.normal, diffuse, glossy, small, float(paths), is_denoised)


def _followed(room: Room, origin: Points, direction: Points, random: np.random.Generator) -> Points:
    """Return the radiance (N, 3) that paths bring which begin with these rays."""
    radiance, weight = np.zeros((2, *origin.shape))
    weight += 1.0
    for _ in range(_MOST_BOUNCES):
        source, albedo, origin, normal = _met(room.surfaces, origin, direction)
        radiance += weight * source
        weight *= albedo
        u, v = random.random((2, 1, origin.shape[0]))
        direction = cosine_directions(u, v, normal.T)[:, 0].T
        origin = origin + normal * _OFF_SURFACE
    return radiance


def _met(
    surfaces: Sequence[Surface], origin: Points, direction: Points
) -> tuple[Points, Points, Points, Points]:
    """Return source, albedo, place and normal, each (N, 3), of what rays meet first; all 0 for nothing."""
    nearest = np.full(origin.shape[0], np.inf)
    owner = np.full(origin.shape[0], -1)
    normal = np.zeros_like(origin)
    normal[:, 1] = 1.0
    for index, surface in enumerate(surfaces):
        for distance, toward in surface.meet(origin, direction):
            is_nearer = (distance > _OFF_SURFACE) & (distance < nearest)
            nearest[is_nearer], owner[is_nearer] = distance[is_nearer], index
            normal[is_nearer] = toward[is_nearer]
    place = origin + direction * np.where(np.isfinite(nearest), nearest, 0.0)[:, None]
    found = np.zeros((2, *origin.shape))
    for index in np.unique(owner[owner >= 0]):
        mine = owner == index
        for value, name in zip(found, ("source", "albedo"), strict=True):
            own = getattr(surfaces[index], name)
            value[mine] = own(place[mine]) if callable(own) else own
    return found[0], found[1], place, normal


def _things() -> list[Surface]:
    """What stands in the room, each thing one surface."""
    return [
        _box((-0.38, 0.55, -2.9), (0.32, 0.55, 0.32), 22.0, _WHITE),
        _box((-0.1, 0.16, -1.75), (0.16, 0.16, 0.16), -30.0, _BLUE),
        Sphere((0.8, 0.38, -2.5), 0.38, albedo=_YELLOW),
        replace(_box((-1.1, 0.5, -2.1), (0.02, 0.5, 0.4), -28.0, (0.0, 0.0, 0.0)), specular=(0.9, 0.9, 0.9)),
        _box((0.55, 1.15, -3.7), (0.55, 0.025, 0.25), 0.0, _WHITE),
        _box((0.22, 0.55, -2.9), (0.02, 0.55, 0.02), 0.0, _WHITE),
        _box((1.15, 0.6, -1.9), (0.02, 0.6, 0.02), 0.0, _WHITE),
    ]


@dataclass(frozen=True)
class Box:
    """A box: its centre, half its size along each of its axes (rows), and what `Plane` has besides."""

    centre: Vector
    half: Vector
    axes: Points = field(repr=False)
    albedo: Radiance = 0.0
    specular: Radiance = 0.0
    roughness: float = 0.0
    source: Radiance = 0.0

    def meet(self, origin: Points, direction: Points) -> list[tuple[Points, Points]]:
        """Return distances (N,), +inf for none, and normals (N, 3) of where rays come in and go out."""
        start, along = (origin - np.asarray(self.centre)) @ self.axes.T, direction @ self.axes.T
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (-np.asarray(self.half) - start) / along, (np.asarray(self.half) - start) / along
        near, far = np.minimum(one, other), np.maximum(one, other)
        meets = near.max(axis=1) < far.min(axis=1)
        found = []
        for distance, axis in (
            (near.max(axis=1), near.argmax(axis=1)),
            (far.min(axis=1), far.argmin(axis=1)),
        ):
            sign = -np.sign(np.take_along_axis(along, axis[:, None], axis=1))
            is_ahead = meets & (distance > 0.0)
            found.append((np.where(is_ahead, distance, np.inf), sign * self.axes[axis]))
        return found

    def outward(self, points: Points) -> Points:
        """Return the outer normals (N, 3) at points of the surface."""
        local = (points - np.asarray(self.centre)) @ self.axes.T
        axis = (np.abs(local) / np.asarray(self.half)).argmax(axis=1)
        return np.sign(np.take_along_axis(local, axis[:, None], axis=1)) * self.axes[axis]


Surface = Plane | Sphere | Box


def _box(centre: Vector, half: Vector, degrees: float, color: Vector) -> Box:
    """A box that is turned about the vertical."""
    angle = math.radians(degrees)
    axes = [
        [math.cos(angle), 0.0, -math.sin(angle)],
        [0.0, 1.0, 0.0],
        [math.sin(angle), 0.0, math.cos(angle)],
    ]
    return Box(centre, half, np.array(axes), albedo=color)


def _lit(walls: Sequence[Surface], things: Sequence[Surface]) -> Room:
    """Give surfaces the lamps' light; things cast shadows, and walls, which lie around, none."""
    lit = [replace(surface, source=_Lamplight(surface, things)) for surface in (*walls, *things)]
    return Room(tuple(lit), (*(0 for _ in walls), *range(1, len(things) + 1)))


@dataclass(frozen=True)
class _Lamplight:
    """Radiance that a surface hands on of the lamps: albedo / π times irradiance."""

    surface: Surface
    blockers: Sequence[Surface]

    def __call__(self, points: Points) -> Points:
        normal = _outward(self.surface, points)
        irradiance = sum(self._of(np.asarray(lamp), power, points, normal) for lamp, power in _LAMPS)
        albedo = self.surface.albedo
        color = albedo(points) if callable(albedo) else np.asarray(albedo, dtype=np.float64)
        return color / np.pi * np.asarray(irradiance)[:, None]

    def _of(self, lamp: Points, power: float, points: Points, normal: Points) -> Points:
        toward = lamp - points
        squared = (toward * toward).sum(axis=1)
        cosine = np.maximum((toward * normal).sum(axis=1), 0.0) / np.sqrt(squared)
        start = points + normal * _OFF_SURFACE
        is_lit = cosine > 0.0
        for blocker in self.blockers:
            for distance, _ in blocker.meet(start, toward):
                is_lit &= ~((distance > _OFF_SURFACE) & (distance < 1.0 - _OFF_SURFACE))
        light: Points = power * cosine / squared * is_lit
        return light


def _outward(surface: Surface, points: Points) -> Points:
    if isinstance(surface, Sphere):
        return (points - np.asarray(surface.centre)) / surface.radius
    if isinstance(surface, Box):
        return surface.outward(points)
    normal = np.asarray(surface.normal, dtype=np.float64)
    return np.broadcast_to(normal / np.linalg.norm(normal), points.shape)


def _tiles(points: Points) -> Points:
    """A floor of pale and darker tiles."""
    is_dark = (np.floor(points[:, 0] / 0.5) + np.floor(points[:, 2] / 0.5)) % 2.0 == 0.0
    return np.where(is_dark[:, None], (0.35, 0.36, 0.4), (0.7, 0.7, 0.68))
