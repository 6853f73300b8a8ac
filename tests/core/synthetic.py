# SPDX-License-Identifier: GPL-3.0-or-later
"""G-buffers of planes and spheres, exact to float64 before they are stored: what tests know the answer of.

Points and normals are world space; a camera that looks down -Z from the origin sees them as view space.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssgi_addon.core import Camera, GBuffer, Settings

Radiance = Sequence[float] | float | Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Plane:
    """A plane through `point`, as far as `bounds` (points to booleans) says; it faces the viewer."""

    point: Sequence[float]
    normal: Sequence[float]
    albedo: Radiance = 0.0
    specular: Radiance = 0.0
    roughness: float = 0.0
    source: Radiance = 0.0
    bounds: Callable[[np.ndarray], np.ndarray] | None = None

    def meet(self, origin: np.ndarray, direction: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the distances (N,), +inf for none, and the normals (N, 3) of each time the rays meet it."""
        normal = np.asarray(self.normal, dtype=np.float64)
        normal = normal / np.linalg.norm(normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((np.asarray(self.point, dtype=np.float64) - origin) @ normal) / (direction @ normal)
        t = np.where(t > 0.0, t, np.inf)
        if self.bounds is not None:
            points = origin + direction * np.where(np.isfinite(t), t, 0.0)[:, None]
            t = np.where(self.bounds(points), t, np.inf)
        toward = -np.sign(direction @ normal)
        return [(t, toward[:, None] * normal)]


@dataclass(frozen=True)
class Sphere:
    """A sphere, seen from outside or from within."""

    centre: Sequence[float]
    radius: float
    albedo: Radiance = 0.0
    specular: Radiance = 0.0
    roughness: float = 0.0
    source: Radiance = 0.0

    def meet(self, origin: np.ndarray, direction: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the distances (N,), +inf for none, and the normals (N, 3) of each time the rays meet it."""
        offset = origin - np.asarray(self.centre, dtype=np.float64)
        a = (direction * direction).sum(axis=1)
        b = (offset * direction).sum(axis=1)
        c = (offset * offset).sum(axis=1) - self.radius**2
        root = np.sqrt(np.where(b * b - a * c > 0.0, b * b - a * c, np.nan))
        meetings = []
        for t in ((-b - root) / a, (-b + root) / a):
            t = np.where(t > 0.0, t, np.inf)  # NaN: misses
            outward = (offset + direction * np.where(np.isfinite(t), t, 0.0)[:, None]) / self.radius
            meetings.append(
                (t, np.where((outward * direction).sum(axis=1)[:, None] < 0.0, outward, -outward))
            )
        return meetings


Surface = Plane | Sphere


def capture(
    camera: Camera, surfaces: Sequence[Surface], *, layers: int = 1, thickness: float | None = None
) -> GBuffer:
    """Return what `camera` sees of `surfaces`: the nearest surface per pixel, and `layers` - 1 behind it.

    `direct` and `source` are both the surfaces' `source`.
    """
    origin, direction, back = _camera_rays(camera)
    meetings = [(surface, t, normal) for surface in surfaces for t, normal in surface.meet(origin, direction)]
    distance = np.stack([t for _, t, _ in meetings])
    order = np.argsort(distance, axis=0, kind="stable")
    behind = None
    for layer in reversed(range(layers)):
        nearest = order[min(layer, len(meetings) - 1)]
        t = np.take_along_axis(distance, nearest[None], axis=0)[0]
        if layer >= len(meetings):
            t = np.full_like(t, np.inf)
        behind = _shade(camera, (origin, direction, back), meetings, nearest, t, thickness, behind)
    assert behind is not None
    return behind


def _shade(camera, rays, meetings, nearest, t, thickness, behind) -> GBuffer:
    origin, direction, back = rays
    count = t.shape[0]
    is_surface = np.isfinite(t)
    points = origin + direction * np.where(is_surface, t, 0.0)[:, None]
    passes = {name: np.zeros((count, 3)) for name in ("normal", "albedo", "specular", "source")}
    roughness = np.zeros(count)
    for index, (surface, _, normal) in enumerate(meetings):
        mine = is_surface & (nearest == index)
        passes["normal"][mine] = normal[mine] @ back[:3, :3].T
        roughness[mine] = surface.roughness
        for name in ("albedo", "specular", "source"):
            value = getattr(surface, name)
            passes[name][mine] = value(points[mine]) if callable(value) else value
    # Along a unit of `direction` depth grows by one, except that parallel rays start at depth 0
    depth = np.where(is_surface, t, np.inf)
    image = (camera.height, camera.width)
    return GBuffer(
        depth.reshape(image),
        passes["normal"].reshape(*image, 3),
        passes["albedo"].reshape(*image, 3),
        passes["specular"].reshape(*image, 3),
        roughness.reshape(image),
        passes["source"].reshape(*image, 3),
        thickness=None if thickness is None else np.full(image, thickness),
        behind=behind,
    )


def _camera_rays(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return world-space origins and directions (N, 3) per unit of depth, and view_from_world."""
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    near = camera.pixel_to_view(x.ravel(), y.ravel(), np.zeros(x.size))
    far = camera.pixel_to_view(x.ravel(), y.ravel(), np.ones(x.size))
    pose = camera.world_from_view
    return near @ pose[:3, :3].T + pose[:3, 3], (far - near) @ pose[:3, :3].T, np.linalg.inv(pose)


def uniform_gbuffer(shape: tuple[int, int], depth: float = 5.0, **passes: object) -> GBuffer:
    """Return a G-buffer of one distance that faces the camera; `passes` are values or arrays."""

    def image(name: str, default: float, channels: tuple[int, ...]) -> np.ndarray:
        return np.broadcast_to(np.asarray(passes.pop(name, default), dtype=np.float64), (*shape, *channels))

    normal = np.zeros((*shape, 3))
    normal[..., 2] = 1.0
    return GBuffer(
        image("depth", depth, ()),
        passes.pop("normal", normal),
        image("albedo", 0.5, (3,)),
        image("specular", 0.5, (3,)),
        image("roughness", 0.3, ()),
        image("direct", 1.0, (3,)),
        **passes,
    )


def random_gbuffer(rng: np.random.Generator, shape: tuple[int, int], sky: float = 0.2) -> GBuffer:
    """Return a G-buffer of noise in every pass, `sky` of it background."""
    depth = np.where(rng.random(shape) < sky, np.inf, rng.uniform(1.0, 10.0, shape))
    normal = rng.normal(size=(*shape, 3))
    normal[..., 2] = np.abs(normal[..., 2])
    colors = [rng.random((*shape, 3)) for _ in range(4)]
    return GBuffer(depth, normal, colors[0], colors[1], rng.random(shape), colors[2], source=colors[3])


def make_settings(
    *,
    rays: int = 16,
    glossy_rays: int | None = None,
    bounces: int = 1,
    filter: bool = False,
    sky_rays: int = 2,
    diffuse: bool = True,
    reflections: bool = True,
    method: str = "hierarchical",
    glossy: Mapping[str, object] | None = None,
    **general: object,
) -> Settings:
    """Return settings without filters, later bounces and reuse unless asked for: every ray for itself."""
    base = Settings(**general)
    plain = {"reuse": 0, "color_pyramid": False, "subpixel": False}
    return replace(
        base,
        diffuse=replace(
            base.diffuse, enabled=diffuse, rays=rays, bounces=bounces, filter=filter, sky_rays=sky_rays
        ),
        reflections=replace(
            base.reflections,
            enabled=reflections,
            rays=glossy_rays or rays,
            filter=filter,
            method=method,
            **{**plain, **(glossy or {})},
        ),
    )


def look_at(position: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """Return the pose (4, 4) of a camera at `position` that looks at `target`, +Y up."""
    position, target = np.asarray(position, dtype=np.float64), np.asarray(target, dtype=np.float64)
    back = position - target
    back /= np.linalg.norm(back)
    up = np.array([0.0, 1.0, 0.0]) if abs(back[1]) < 0.99 else np.array([0.0, 0.0, -1.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(back, right), back, position
    return pose
