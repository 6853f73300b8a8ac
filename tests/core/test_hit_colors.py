# SPDX-License-Identifier: GPL-3.0-or-later
"""What a ray reads where it hits: between pixels, as wide as its cone, and never off another surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, GBuffer, Settings, render_indirect, tracer
from ssgi_addon.core.answers import Answers
from ssgi_addon.core.hit_colors import HitColors
from ssgi_addon.core.scene import TraceScene
from tests.core.synthetic import Plane, capture, look_at, make_settings, uniform_gbuffer
from tests.tolerances import (
    CONE_ERROR_LEFT,
    CONE_NOISE_LEFT,
    CONES_OF_MANY_RAYS,
    REPEATED_SUM,
    SUBPIXEL_LIGHT,
)

WIDTH, HEIGHT = 37, 29  # odd: the pyramid's last cells stick out
LENSES = {
    "perspective": Camera.perspective(WIDTH, HEIGHT, 1.0, shift_px=(2.5, -1.0), pixel_aspect=0.9),
    "orthographic": Camera.orthographic(WIDTH, HEIGHT, 5.0),
}
CAMERA = LENSES["perspective"]
LEVELS = (1, 2, 3, 4, 5)


def colors_of(
    gbuffer: GBuffer, camera: Camera = CAMERA, views=(), *, subpixel: bool = True, levels: bool = True
) -> HitColors:
    scene = TraceScene(gbuffer, camera, views, Settings())
    return HitColors(scene, scene.table("reflection_source"), is_subpixel=subpixel, has_levels=levels)


def read(colors: HitColors, x, y, wide_px=0.0, layer: int = 0) -> np.ndarray:
    """Return the radiance (N, 3) at points of a layer for cones that are so many pixels wide there."""
    given = np.broadcast_arrays(x, y, wide_px)
    x, y, wide_px = (np.asarray(values, dtype=np.float32).ravel() for values in given)
    here = colors.layers[layer]
    camera = here.field.camera
    pixel = y.astype(np.int64) * camera.width + x.astype(np.int64)
    # As far as the point is deep: how far a ray came must not matter, only how wide its cone became
    depth = 1.0 if camera.is_orthographic else 1.0 / here.field.front[pixel]
    distance = np.broadcast_to(np.float32(3.0) * depth, x.shape).astype(np.float32)
    spread = wide_px / max(camera.fx, camera.fy) * depth / distance
    status = np.full(x.shape, tracer.HIT, dtype=np.int8)
    return colors.radiance(Answers(status, pixel + here.offset, distance, x, y), slice(0, x.size), spread)


def lit(gbuffer: GBuffer, radiance: np.ndarray) -> GBuffer:
    """Let the pixels hand on a radiance (H, W) or (H, W, 3)."""
    colored = radiance if radiance.ndim == 3 else np.repeat(radiance[..., None], 3, axis=-1)
    return replace(gbuffer, glossy_source=colored)


def gradient(x, y) -> np.ndarray:
    """A radiance (..., 3) that is linear on the screen."""
    return np.stack([3.0 + 0.2 * x, 7.0 - 0.1 * x + 0.3 * y, 1.0 + 0.05 * (x + y)], axis=-1)


def pixel_centres(height: int = HEIGHT, width: int = WIDTH) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[0:height, 0:width] + 0.5
    return x, y


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.6, 0.3, 0.7), (0.0, 1.0, 0.15)])
@pytest.mark.parametrize("lens", LENSES)
def test_linear_gradients_are_exact_between_the_pixels_of_a_plane(lens, normal, rng):
    camera = LENSES[lens]
    gbuffer = lit(capture(camera, [Plane((0.0, -1.0, -6.0), normal)]), gradient(*pixel_centres()))
    x, y = rng.uniform(0.0, WIDTH, 2000), rng.uniform(0.0, HEIGHT, 2000)
    seen = ~gbuffer.is_background[y.astype(int), x.astype(int)]
    # The plane ends at its horizon
    seen &= ~gbuffer.is_background[np.maximum(y - 1.0, 0.0).astype(int), x.astype(int)]
    x, y = x[seen], y[seen]
    assert x.size > 500
    expected = gradient(np.clip(x, 0.5, WIDTH - 0.5), np.clip(y, 0.5, HEIGHT - 0.5))
    np.testing.assert_allclose(read(colors_of(gbuffer, camera), x, y), expected, rtol=REPEATED_SUM)


def test_without_subpixel_hits_are_whole_pixels(rng):
    gbuffer = lit(uniform_gbuffer((HEIGHT, WIDTH)), gradient(*pixel_centres()))
    x, y = rng.uniform(0.0, WIDTH, 200), rng.uniform(0.0, HEIGHT, 200)
    whole = gradient(np.floor(x) + 0.5, np.floor(y) + 0.5).astype(np.float32)
    np.testing.assert_array_equal(read(colors_of(gbuffer, subpixel=False), x, y), whole)


def two_surfaces(kind: str, edge: int) -> tuple[GBuffer, np.ndarray]:
    """Return a frame whose first `edge` rows or columns are one surface, and which those are (H, W)."""
    x, y = pixel_centres()
    if kind == "crease":
        # The wall ends above the floor in the row `edge`
        bottom = (CAMERA.cy - edge) / CAMERA.fy * 6.0
        wall = Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0), bounds=lambda p: p[:, 1] >= bottom)
        gbuffer = capture(CAMERA, [wall, Plane((0.0, bottom, 0.0), (0.0, 1.0, 0.0))])
        return gbuffer, y < edge
    is_first = x < edge
    depth = np.where(is_first, 4.0, {"step": 6.0, "background": np.inf}[kind])
    return uniform_gbuffer((HEIGHT, WIDTH), depth), is_first


@pytest.mark.parametrize("edge", [18, 19, 23, 24])
@pytest.mark.parametrize("kind", ["step", "background", "crease"])
def test_nothing_is_read_off_another_surface(kind, edge, rng):
    gbuffer, is_first = two_surfaces(kind, edge)
    colors = colors_of(lit(gbuffer, np.where(is_first, 1.0, 50.0)))
    # Dense around the edge, in both directions, for lines and for cones of all widths
    x, y = rng.uniform(0.0, WIDTH, 4000), rng.uniform(0.0, HEIGHT, 4000)
    across = y if kind == "crease" else x
    across[:2000] = edge + rng.uniform(-1.5, 1.5, 2000)
    wide = rng.choice([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 1000.0], x.shape)
    pixel = y.astype(int), x.astype(int)
    seen = ~gbuffer.is_background[pixel]
    found = read(colors, x[seen], y[seen], wide[seen])[:, 0]
    np.testing.assert_allclose(found, np.where(is_first[pixel], 1.0, 50.0)[seen], rtol=REPEATED_SUM)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("lens", LENSES)
def test_a_cone_reads_the_mean_of_a_cell_as_wide_as_itself(lens, level, rng):
    camera = LENSES[lens]
    light = rng.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    gbuffer = lit(uniform_gbuffer((HEIGHT, WIDTH)), light)
    side = 1 << level
    x, y = pixel_centres()
    expected = np.empty_like(light)
    for top in range(0, HEIGHT, side):
        for left in range(0, WIDTH, side):
            cell = (slice(top, top + side), slice(left, left + side))
            expected[cell] = light[cell].mean(axis=(0, 1), dtype=np.float64)
    # In the middle of a cell, where the image has one; any width nearer to the cell's than to the next one's
    middle_x, middle_y = (np.floor(at / side) * side + 0.5 * side for at in (x, y))
    inside = (middle_x < WIDTH) & (middle_y < HEIGHT)
    for wide in side * np.array([0.75, 1.0, 1.35]):
        found = read(colors_of(gbuffer, camera), middle_x[inside], middle_y[inside], wide)
        np.testing.assert_allclose(found, expected[inside], rtol=REPEATED_SUM)


def test_background_in_a_cell_does_not_darken_its_mean(rng):
    is_hole = rng.random((HEIGHT, WIDTH)) < 0.03
    depth = np.where(is_hole, np.inf, 5.0)
    x, y = pixel_centres()
    gbuffer = lit(uniform_gbuffer((HEIGHT, WIDTH), depth), np.where(is_hole, 0.0, 2.0))
    for wide in (2.0, 8.0, 32.0):
        found = read(colors_of(gbuffer), x[~is_hole], y[~is_hole], wide)
        np.testing.assert_allclose(found, 2.0, rtol=REPEATED_SUM)


@pytest.mark.parametrize("lens", LENSES)
def test_cones_average_more_the_rougher_the_lobe_and_the_longer_the_way(lens, rng):
    camera = LENSES[lens]
    colors = colors_of(lit(uniform_gbuffer((HEIGHT, WIDTH)), rng.random((HEIGHT, WIDTH))), camera)
    x, y = rng.uniform(4.0, WIDTH - 4.0, 3000), rng.uniform(4.0, HEIGHT - 4.0, 3000)
    pixel = y.astype(np.int64) * WIDTH + x.astype(np.int64)
    status = np.full(x.shape, tracer.HIT, dtype=np.int8)
    per_pixel = 5.0 / camera.fx if lens == "perspective" else 1.0 / camera.fx

    def noise(distance: float, spread: float) -> float:
        way = np.full(x.shape, distance, dtype=np.float32)
        wide = np.full(x.shape, spread * per_pixel, dtype=np.float32)
        places = (x.astype(np.float32), y.astype(np.float32))
        return float(colors.radiance(Answers(status, pixel, way, *places), slice(None), wide).std())

    by_distance = [noise(distance, 1.0) for distance in (1.0, 2.0, 4.0, 8.0)]
    by_width = [noise(2.0, spread) for spread in (0.5, 1.0, 2.0, 4.0)]
    assert by_distance == by_width
    # A cell twice as wide has four times as many pixels
    assert (np.divide(by_distance[2:], by_distance[1:-1]) < CONE_NOISE_LEFT).all()
    assert by_distance[1] < by_distance[0]


def test_every_view_and_layer_reads_its_own_pixels(rng):
    shapes = {"frame": (HEIGHT, WIDTH), "view": (12, 20)}

    def front(shape: tuple[int, int], number: int) -> GBuffer:
        return lit(uniform_gbuffer(shape, 4.0), 10.0 * number + gradient(*pixel_centres(*shape)))

    def pair(shape: tuple[int, int], number: int) -> GBuffer:
        behind = lit(uniform_gbuffer(shape, 8.0), 10.0 * (number + 1) + gradient(*pixel_centres(*shape)))
        return replace(front(shape, number), behind=behind)

    second = Camera.perspective(20, 12, 1.4, world_from_view=look_at((0.0, 0.0, 1.0), (0.0, 0.0, 9.0)))
    colors = colors_of(pair(shapes["frame"], 1), CAMERA, [(pair(shapes["view"], 3), second)])
    assert len(colors.layers) == 4
    for layer, (number, (height, width)) in enumerate(
        [(1, shapes["frame"]), (2, shapes["frame"]), (3, shapes["view"]), (4, shapes["view"])]
    ):
        x, y = rng.uniform(0.5, width - 0.5, 300), rng.uniform(0.5, height - 0.5, 300)
        between = read(colors, x, y, layer=layer)
        np.testing.assert_allclose(between, 10.0 * number + gradient(x, y), rtol=REPEATED_SUM)
        # Between the middles of cells of 4 x 4 a gradient is what it is
        x, y = np.clip(x, 2.0, width // 4 * 4 - 2.0), np.clip(y, 2.0, height // 4 * 4 - 2.0)
        wide = read(colors, x, y, 4.0, layer=layer)
        np.testing.assert_allclose(wide, 10.0 * number + gradient(x, y), rtol=REPEATED_SUM)


def test_rays_without_a_hit_bring_black():
    colors = colors_of(uniform_gbuffer((HEIGHT, WIDTH)))
    nowhere = Answers(
        np.array([tracer.UNKNOWN, tracer.BLOCKED, tracer.ESCAPED], dtype=np.int8),
        np.full(3, HEIGHT * WIDTH),
        np.full(3, np.inf, dtype=np.float32),
        *np.zeros((2, 3), dtype=np.float32),
    )
    assert (colors.radiance(nowhere, slice(None), np.ones(3, dtype=np.float32)) == 0.0).all()


@pytest.mark.parametrize("level", [0, *LEVELS])
def test_one_very_bright_pixel_stays_within_a_cell_around_its_own(level):
    light = np.ones((HEIGHT, WIDTH))
    row, column = 13, 21
    light[row, column] = 1e5
    x, y = pixel_centres()
    # Off the centres: between pixels as well
    found = read(colors_of(lit(uniform_gbuffer((HEIGHT, WIDTH)), light)), x + 0.3, y - 0.2, 1 << level)
    side = 1 << level
    middle_x, middle_y = (column // side + 0.5) * side, (row // side + 0.5) * side
    is_near = (np.abs(x + 0.3 - middle_x) < side) & (np.abs(y - 0.2 - middle_y) < side)
    np.testing.assert_allclose(found[~is_near.ravel()], 1.0, rtol=REPEATED_SUM)
    assert found[is_near.ravel()].min() > 1.0


def mirror_before_wall(wall_light, roughness: float = 0.0, side: int = 64) -> tuple[GBuffer, Camera]:
    camera = Camera.perspective(side, side, 1.0)
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), specular=1.0, roughness=roughness)
    gbuffer = capture(camera, [floor, Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), source=wall_light)])
    return gbuffer, camera


def glossy_of(frame: tuple[GBuffer, Camera], views=(), rays: int = 1, **glossy) -> np.ndarray:
    return render_indirect(*frame, make_settings(diffuse=False, rays=rays, glossy=glossy), None, views).glossy


def test_mirror_shows_a_gradient_without_the_steps_of_pixels():
    """Floor and wall in closed form; without hits between pixels the same picture is a staircase."""
    frame = mirror_before_wall(lambda p: p + 5.0)
    gbuffer, camera = frame
    x, y = pixel_centres(64, 64)
    position = camera.pixel_to_view(x, y, gbuffer.depth.astype(np.float64))
    rise = (4.0 + position[..., 2]) / -position[..., 2]  # of the mirrored ray over the floor
    shown = np.stack([x - 32.0, np.zeros_like(x)], axis=-1) / camera.fx * 4.0
    shown[..., 1] = -1.0 + rise
    # Inside the outermost pixels' centres
    inside = (gbuffer.specular[..., 0] > 0.0) & (np.abs(shown[..., 0]) < 31.5 / camera.fx * 4.0)
    assert inside.sum() > 900
    off = {
        is_between: np.abs(glossy_of(frame, subpixel=is_between)[..., :2] - 5.0 - shown)[inside].max()
        for is_between in (True, False)
    }
    assert off[True] <= SUBPIXEL_LIGHT
    assert off[False] > 10.0 * off[True]


def test_mirror_shows_another_view_between_its_pixels():
    """The wall behind the camera hands on its own x and y, linear on the screen of a view that faces it."""
    camera = Camera.perspective(32, 24, 0.8)
    mirror = capture(camera, [Plane((0.0, 0.0, -3.0), (0.0, 0.0, 1.0), specular=1.0)]), camera
    back = Camera.perspective(80, 60, 2.0, world_from_view=np.diag([-1.0, 1.0, -1.0, 1.0]))
    wall = Plane((0.0, 0.0, 4.0), (0.0, 0.0, 1.0), source=lambda p: p + 10.0)
    view = capture(back, [wall]), back
    ahead = camera.pixel_to_view(*pixel_centres(24, 32), np.ones((24, 32)))
    expected = 10.0 + 10.0 * ahead[..., :2]  # 3 to the mirror, 7 back to the wall
    off = np.abs(glossy_of(mirror, [view], subpixel=True)[..., :2] - expected)
    assert off.max() <= SUBPIXEL_LIGHT
    whole = np.abs(glossy_of(mirror, [view], subpixel=False)[..., :2] - expected)
    assert whole.max() > 10.0 * off.max()


@pytest.mark.parametrize("roughness", [0.2, 0.5])
def test_cones_take_noise_away_and_narrow_as_rays_become_many(roughness, rng):
    """A wall of noise: one thin ray finds any of it, a cone its mean, and many cones what many rays find."""
    gbuffer, camera = mirror_before_wall(0.0, roughness, side=40)
    floor = gbuffer.specular[..., 0] > 0.0
    frame = lit(gbuffer, np.where(floor, 0.0, 2.0 * rng.random(floor.shape))), camera
    truth = glossy_of(frame, rays=256)[floor]

    def error(rays: int, is_wide: bool) -> float:
        return float(((glossy_of(frame, rays=rays, color_pyramid=is_wide)[floor] - truth) ** 2).mean())

    assert error(1, is_wide=True) < CONE_ERROR_LEFT * error(1, is_wide=False)
    assert error(64, is_wide=True) < CONES_OF_MANY_RAYS * error(64, is_wide=False)
