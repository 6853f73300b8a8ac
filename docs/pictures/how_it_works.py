# SPDX-License-Identifier: GPL-3.0-or-later
"""The figures in ``docs/how_it_works.md``, made by the passes themselves: steps, pyramid, walk, reuse.

Needs no Blender, but matplotlib (the extra ``docs``). ``python -m docs.pictures.how_it_works [NAME ...]``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from docs.pictures.array_room import build_room, room_camera
from docs.pictures.panels import IMAGES, Shown, to_screen, write_panels, write_webp
from ssgi_addon.core import ReflectionSettings, Settings, composite, render_indirect
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.frame_points import surface_points, toward_camera
from ssgi_addon.core.lobes import Lobes
from ssgi_addon.core.resolve import neighbour_offsets
from ssgi_addon.core.sampling import sample_square
from ssgi_addon.core.tracer import HIT, trace_rays

FOLDER = IMAGES / "how_it_works"
_DPI = 110
_INK, _BLUE, _GREEN, _PALE = "#333338", "#2f6db3", "#1b7f3b", "#d8d8dc"
_LEVELS = (0, 2, 4, 5)
# Where the ray of the walk starts, pixels, and where it goes, in view space: past the blue box, to the ball.
_START, _TOWARD = (19, 126), (2.728, 0.165, -1.0)
# A pixel of the floor before the ball, whose neighbours' rays are drawn.
_RECEIVER = (140, 121)
_REUSE = 8
# The part of the frame in which the floor is.
_FLOOR = np.s_[90:135, 60:240]
_LIGHT_EXPOSURE = 1.3


def draw_pyramid() -> None:
    """Both bounds of some levels, as depths: nearest above, farthest below."""
    camera = room_camera()
    field = DepthField.build(build_room().frame(camera), camera, Settings().thickness)
    rows = []
    for bound in (field.nearest, field.farthest):
        with np.errstate(divide="ignore"):
            rows.append([_level(field, 1.0 / bound, level) for level in _LEVELS])
    shown = [np.concatenate(pair) for pair in zip(*rows, strict=True)]
    titles = [f"level {level}: cells of {1 << level} pixel{'s' if level else ''}" for level in _LEVELS]
    write_panels(FOLDER / "pyramid.webp", list(zip(titles, shown, strict=True)))


def _level(field: DepthField, depth: np.ndarray, level: int) -> Shown:
    """Return a level of an atlas of depths as a picture of the frame's size: near is bright."""
    camera = field.camera
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] >> level
    values = depth.take(field.origins[level] + y * field.stride + x)
    nearest, farthest = 1.2, 5.4
    return to_screen(np.clip((farthest - values) / (farthest - nearest), 0.0, 1.0) ** 1.5)


def draw_walk() -> None:
    """One ray from above: the cells that the walk looks into, by both bounds, and by the linear walk."""
    camera = room_camera()
    frame = build_room().frame(camera)
    figure = Figure(figsize=(9.0, 5.2), dpi=_DPI)
    axes = figure.subplots(2, 1, sharex=True)
    for ax, max_level in zip(axes, (0, 7), strict=True):
        field = DepthField.build(frame, camera, Settings().thickness, max_level=max_level)
        _draw_one_walk(ax, field)
    axes[1].set_xlabel("column of the frame, pixels")
    _save(figure, "walk")


def _draw_one_walk(ax: Any, field: DepthField) -> None:
    camera = field.camera
    pixel = np.array([_START[1] * camera.width + _START[0]])
    origin = camera.pixel_to_view(
        np.array([_START[0] + 0.5]), np.array([_START[1] + 0.5]), 1.0 / field.front.take(pixel)
    ).T
    direction = (np.array([_TOWARD]) / np.linalg.norm(_TOWARD)).T
    stops = _stops(field, origin, direction)
    places = origin + direction * np.array(stops)
    x, _, depth = camera.view_to_pixel(places.T)
    # The surface under the ray, and its back
    at = np.linspace(0.0, stops[-1], 1500)
    column, row, _ = camera.view_to_pixel((origin + direction * at).T)
    column, row = np.clip(column, 0, camera.width - 1), np.clip(row, 0, camera.height - 1)
    under = np.floor(row).astype(np.int64) * camera.width + np.floor(column).astype(np.int64)
    front, back = 1.0 / field.front.take(under), 1.0 / (field.front - field.slab).take(under)
    ax.fill_between(column, front, np.minimum(back, 7.0), color=_PALE, linewidth=0.0, label="surfaces")
    ax.plot(column, front, color=_INK, linewidth=1.0)
    ax.plot(x, depth, color=_BLUE, linewidth=1.6)
    ax.plot(x, depth, "o", color=_BLUE, markersize=3.0)
    for begin, end in pairwise(x):
        width = max(abs(end - begin), 0.15)
        ax.add_patch(
            Rectangle((min(begin, end), 5.9), width, 0.35, facecolor="none", edgecolor=_BLUE, linewidth=0.8)
        )
    ax.plot(x[-1], depth[-1], "*", color=_GREEN, markersize=13)
    name = "linear walk" if field.levels == 1 else "nearest and farthest bound"
    ax.set_title(f"{name}: {len(stops) - 1} cells", fontsize=10, color=_INK, loc="left")
    ax.set_ylim(6.4, 0.8)
    ax.set_ylabel("depth, units")


def _stops(field: DepthField, origin: np.ndarray, direction: np.ndarray) -> list[float]:
    """Return the distances at which a ray stands after each look into a cell, up to its hit."""
    stops = [0.0]
    for steps in range(1, 1000):
        result = trace_rays(field, origin, direction, max_steps=steps)
        stops.append(float(result.distance[0]))
        if result.status[0] == HIT:
            return stops
    raise ValueError("the ray of the figure meets nothing: choose another one")


def draw_reuse() -> None:
    """Rays of a pixel of the floor and its neighbours, and the lobe's light without and with their reuse."""
    camera = room_camera()
    frame = build_room().frame(camera)
    rough = replace(frame, roughness=np.where(frame.specular[..., 0] > 0.2, 0.35, frame.roughness))
    panels = []
    for reuse in (0, _REUSE):
        own = replace(ReflectionSettings(), reuse=reuse, filter=False, color_pyramid=False)
        light = render_indirect(rough, camera, Settings(reflections=own))
        floor = to_screen(light.glossy)[_FLOOR].repeat(2, axis=0).repeat(2, axis=1)
        panels.append((f"reuse {reuse}", floor))
    write_panels(FOLDER / "reuse_light.webp", panels)

    figure = Figure(figsize=(9.0, 5.2), dpi=_DPI)
    axes = figure.subplots()
    axes.imshow(to_screen(composite(frame, render_indirect(frame, camera, Settings()))))
    row, column = _RECEIVER[1], _RECEIVER[0]
    offsets = neighbour_offsets(1, (0, 0), _REUSE)
    # Spread out so that they can be told apart
    pixel = np.array([(row + 4 * down) * camera.width + column + 4 * right for down, right in offsets])
    start, normal = surface_points(frame, camera, pixel)
    lobes = Lobes.at(normal, toward_camera(camera, start), rough.roughness.reshape(-1).take(pixel))
    u, v = sample_square(pixel, camera.width, 1, 0, np.dtype(np.float32))
    direction = lobes.draw(u, v, False)[0][:, 0]
    field = DepthField.build(frame, camera, Settings().thickness)
    result = trace_rays(field, start, direction)
    for index in range(pixel.size):
        y, x = divmod(int(pixel[index]), camera.width)
        color = _BLUE if index == 0 else _GREEN
        axes.plot(x + 0.5, y + 0.5, "o", color=color, markersize=6 if index == 0 else 4)
        if result.status[index] == HIT:
            axes.plot([x, result.x_px[index]], [y, result.y_px[index]], color=color, linewidth=1.0)
            axes.plot(result.x_px[index], result.y_px[index], "*", color=color, markersize=7)
            axes.plot(
                [column, result.x_px[index]], [row, result.y_px[index]], ":", color=_BLUE, linewidth=0.9
            )
    axes.set_axis_off()
    _save(figure, "reuse_rays")


def draw_steps() -> None:
    """One frame from its direct light to the picture, layer by layer."""
    camera = room_camera()
    frame = build_room().frame(camera)
    light = render_indirect(frame, camera, Settings())
    shown = {
        "depth": to_screen(np.clip((5.4 - frame.depth) / 4.2, 0.0, 1.0)),
        "normal": to_screen((0.5 * frame.normal + 0.5)[..., :3] ** 2.2),
        "direct light": to_screen(frame.direct),
        "diffuse light": to_screen(light.diffuse, _LIGHT_EXPOSURE),
        "glossy light": to_screen(light.glossy, _LIGHT_EXPOSURE),
        "picture": to_screen(composite(frame, light)),
    }
    for name, titles in (("passes_in", list(shown)[:3]), ("passes_out", list(shown)[3:])):
        write_panels(FOLDER / f"{name}.webp", [(title, shown[title]) for title in titles])


def _save(figure: Figure, name: str) -> None:
    figure.tight_layout(pad=0.6)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    write_webp(FOLDER / f"{name}.webp", np.asarray(canvas.buffer_rgba())[..., :3].copy())


FIGURES: dict[str, Callable[[], None]] = {
    "pyramid": draw_pyramid,
    "walk": draw_walk,
    "reuse": draw_reuse,
    "steps": draw_steps,
}


def main(names: Sequence[str] = ()) -> None:
    """Draw all figures, or those that are named."""
    for name in names or FIGURES:
        FIGURES[name]()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if there is none")
    main(parser.parse_args().names)
