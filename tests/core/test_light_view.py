# SPDX-License-Identifier: GPL-3.0-or-later
"""Views from lamps: what rays bring through one against the sum over its pixels in closed form.

The sum is that of reflective shadow maps (Dachsbacher and Stamminger 2005): each pixel p of a lamp's view is
a small lamp of flux Phi_p = pi L_p A_p (watts, of a Lambertian surface with radiance L_p in watts per
steradian and square unit, and area A_p in square units), and a point x with normal n receives the irradiance
(watts per square unit)

    E(x) = sum over p of (Phi_p / pi) max(0, n_p . (x - x_p)) max(0, n . (x_p - x)) / |x - x_p|^4.

The fourth power holds the lengths of both differences, which are no unit vectors; the paper leaves the 1 / pi
to its flux. The diffuse pass returns the mean radiance over the cosine hemisphere, E / pi.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import Camera, GBuffer, render_indirect
from tests.core.synthetic import Plane, capture, look_at, make_settings
from tests.tolerances import (
    FLOAT32_DISTANCE,
    LIGHT_VIEW_BIAS_LEFT,
    LIGHT_VIEW_MEAN,
    LIGHT_VIEW_PIXEL,
    LIGHT_VIEW_SHADOW,
)

RAYS = 256
WARM = np.array([3.0, 2.0, 1.0])
# Where the lamp stands, and the plane that it lights: a ceiling, or a wall.
LAMP = {
    "parallel": look_at((0.3, 1.0, 0.2), (0.0, 2.0, 0.0)),
    "perpendicular": look_at((0.2, 0.7, 1.2), (0.0, 0.8, 2.0)),
}
PLANE = {"parallel": ((0, 2.0, 0), (0, -1, 0)), "perpendicular": ((0, 0, 2.0), (0, 0, -1))}


def spot_camera(lit: str, size: int = 96) -> Camera:
    """A spot of 90 degrees."""
    return Camera.perspective(size, size, np.pi / 2.0, world_from_view=LAMP[lit])


def lit_surface(lit: str) -> Plane:
    """The plane, which shines where the lamp sees it."""
    camera = spot_camera(lit)
    pose = np.linalg.inv(camera.world_from_view)

    def source(points):
        x, y, depth = camera.view_to_pixel(points @ pose[:3, :3].T + pose[:3, 3])
        is_lit = (depth > 0) & (x >= 0) & (x <= camera.width) & (y >= 0) & (y <= camera.height)
        return is_lit[:, None] * WARM

    return Plane(*PLANE[lit], source=source)


def receiver() -> tuple[GBuffer, Camera]:
    """A small patch of a floor, seen from straight above, from below where either lit surface stands."""
    camera = Camera.perspective(12, 12, 0.5, world_from_view=look_at((0.0, 1.2, 0.0), (0.0, 0.0, 0.0)))
    return capture(camera, [Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.5)]), camera


def spot(lit: str, size: int = 96) -> tuple[GBuffer, Camera]:
    """What the lamp sees."""
    camera = spot_camera(lit, size)
    return capture(camera, [lit_surface(lit)]), camera


def world_points(gbuffer: GBuffer, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return world-space positions and normals (H, W, 3) of all pixels."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    points = camera.pixel_to_view(x, y, gbuffer.depth.astype(np.float64))
    pose = camera.world_from_view
    return points @ pose[:3, :3].T + pose[:3, 3], gbuffer.normal @ pose[:3, :3].T


def pixel_flux(gbuffer: GBuffer, camera: Camera) -> np.ndarray:
    """Return the flux (H, W, 3) of each pixel's piece of surface, from its radiance and its area.

    A pixel is 1 / (fx fy) of the plane at depth 1, at depth z it is z^2 times as much; on a plane with normal
    n, which the direction d of unit depth meets there, it is 1 / |n . d| times as much again.
    """
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    ahead = camera.pixel_to_view(x, y, np.ones_like(x))
    depth = gbuffer.depth.astype(np.float64)
    area = depth**2 / (camera.fx * camera.fy) / np.abs((gbuffer.normal * ahead).sum(axis=-1))
    return np.pi * gbuffer.diffuse_source * area[..., None]


def shadow_map_irradiance(view, x: np.ndarray, n: np.ndarray, passes=None) -> np.ndarray:
    """Return E (N, 3) at points x with normals n (N, 3) each; `passes` says which pairs see each other."""
    points, normals = (array.reshape(-1, 3) for array in world_points(*view))
    flux = pixel_flux(*view).reshape(-1, 3)
    total = np.zeros((len(x), 3))
    for index, (at, normal) in enumerate(zip(x, n, strict=True)):
        away = at - points
        form = np.maximum((normals * away).sum(axis=1), 0.0) * np.maximum(-away @ normal, 0.0)
        form /= (away * away).sum(axis=1) ** 2
        if passes is not None:
            form = form * passes(at, points)
        total[index] = (flux / np.pi * form[:, None]).sum(axis=0)
    return total


def traced_irradiance(frame, views) -> np.ndarray:
    """Return E (H * W, 3) by rays: pi times the mean radiance over the cosine hemisphere."""
    light = render_indirect(*frame, make_settings(rays=RAYS, reflections=False), None, views)
    return np.pi * light.diffuse.reshape(-1, 3).astype(np.float64)


def receiving(frame) -> tuple[np.ndarray, np.ndarray]:
    return tuple(array.reshape(-1, 3) for array in world_points(*frame))


def assert_near(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), rtol=LIGHT_VIEW_MEAN)
    error = np.sqrt(((found - expected) ** 2).mean(axis=0))
    assert (error <= LIGHT_VIEW_PIXEL * expected.mean(axis=0)).all()


def test_flux_of_a_light_view_is_radiance_times_area():
    """All pixels together: pi L times the area of the pyramid's section with the ceiling."""
    camera = Camera.perspective(96, 96, np.pi / 3.0, world_from_view=look_at((0, 0.5, 0), (0, 2.0, 0)))
    view = capture(camera, [Plane((0, 2.0, 0), (0, -1, 0), source=WARM)])
    side = 2.0 * 1.5 * np.tan(np.pi / 6.0)
    np.testing.assert_allclose(
        pixel_flux(view, camera).sum(axis=(0, 1)), np.pi * WARM * side**2, rtol=FLOAT32_DISTANCE
    )


@pytest.mark.parametrize("lit", ["parallel", "perpendicular"])
def test_light_of_a_surface_that_a_lamp_alone_sees_is_the_shadow_maps_sum(lit):
    frame, view = receiver(), spot(lit)
    expected = shadow_map_irradiance(view, *receiving(frame))
    assert expected.min() > 0.05
    assert (traced_irradiance(frame, []) == 0.0).all()  # the frame shows nothing of it
    assert_near(traced_irradiance(frame, [view]), expected)


@pytest.mark.parametrize("lit", ["parallel", "perpendicular"])
def test_smaller_pixels_come_nearer_to_the_sum(lit):
    """What is too bright are rays that come in over the view's border, half a pixel behind its surface."""
    frame, bias = receiver(), {}
    for size in (24, 192):
        view = spot(lit, size)
        expected = shadow_map_irradiance(view, *receiving(frame)).mean()
        bias[size] = traced_irradiance(frame, [view]).mean() / expected - 1.0
    assert abs(bias[192]) <= LIGHT_VIEW_BIAS_LEFT * bias[24]


@pytest.mark.parametrize("lit", ["parallel", "perpendicular"])
def test_what_a_third_view_shows_in_between_casts_its_shadow(lit):
    """A board behind the lamp, before the receiver, seen from beside the receiver, handing on nothing."""
    low, high = {
        "parallel": ((0.0, 0.8, -0.9), (0.9, 0.8, 0.9)),
        "perpendicular": ((0.0, 0.0, 1.0), (1.2, 1.6, 1.0)),
    }[lit]
    low, high = np.array(low), np.array(high)
    axis = int(np.argmin(high - low))
    others = [other for other in range(3) if other != axis]

    def is_within(p):
        return ((p[:, others] >= low[others]) & (p[:, others] <= high[others])).all(axis=1)

    toward = 0.5 * (low + high)
    board = Plane(toward, np.eye(3)[axis], bounds=is_within)
    camera = Camera.perspective(96, 96, 1.9, world_from_view=look_at((0.1, 0.1, -0.1), toward))
    third = (capture(camera, [board, lit_surface(lit)]), camera)

    def passes(at, points):
        way = points - at
        t = (low[axis] - at[axis]) / way[:, axis]
        return ~((t > 0.0) & (t < 1.0) & is_within(at + t[:, None] * way))

    frame, view = receiver(), spot(lit)
    x, n = receiving(frame)
    expected, open_to_it = shadow_map_irradiance(view, x, n, passes), shadow_map_irradiance(view, x, n)
    shadow = 1.0 - expected.sum() / open_to_it.sum()
    assert 0.2 < shadow < 0.8
    for views in ([view, third], [third, view]):
        found = traced_irradiance(frame, views)
        assert abs(1.0 - found.sum() / open_to_it.sum() - shadow) <= LIGHT_VIEW_SHADOW
