# SPDX-License-Identifier: GPL-3.0-or-later
"""Interiors that the benchmarks run on, at any size, captured once and kept.

Run ``python -m benchmarks.inputs WIDTHxHEIGHT [SCENE]`` to capture one ahead.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ssgi_addon.core import Camera, GBuffer, parallel
from ssgi_addon.core.frame_points import surface_points, toward_camera
from ssgi_addon.core.lobes import Lobes
from ssgi_addon.core.sampling import sample_square
from ssgi_addon.core.types import FloatArray, IntArray
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import read_passes, write_passes
from tests.core.synthetic import Plane, Sphere, Surface, capture, look_at

ROOT = Path(__file__).parents[1]
CACHE = ROOT / ".cache" / "benchmarks"
SCENES = Path(os.environ.get("SSGI_SCENES", ROOT.parent / "shared" / "scenes"))
# From the one that says most to the one that is always there.
NAMES = ("living_room", "demo", "room")
_PIXELS_PER_CHUNK = 262144

Size = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Rays:
    """One glossy ray per surface pixel: pixels (N,), view-space origins and directions (3, N)."""

    pixel: IntArray
    origin_vs: FloatArray
    direction_vs: FloatArray


def parse_size(text: str) -> Size:
    """Return (width, height) of a text like 1920x1080."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text!r} is no size: expected WIDTHxHEIGHT")
    return int(width), int(height)


def best_interior() -> str:
    """Return the name of the best interior that can be had here."""
    if importlib.util.find_spec("bpy") is None:
        return "room"
    return "living_room" if (SCENES / "living_room.blend").is_file() else "demo"


def interior(size: Size, name: str | None = None) -> CapturedFrame:
    """Return an interior, captured in a process of its own so that no Blender stays in this one.

    Parameters
    ----------
    size
        Width and height, pixels.
    name
        One of `NAMES`; None means the best that can be had here.
    """
    name = name or best_interior()
    return kept_frame(_path(size, name), "benchmarks.inputs", f"{size[0]}x{size[1]}", name)


def kept_frame(path: Path, module: str, *words: str) -> CapturedFrame:
    """Return the frame that is kept in a file; where it is not yet, run the module that keeps it."""
    # Written last
    if not path.with_suffix(".json").is_file():
        run_module(module, *words)
    return read_passes(path)


def run_module(name: str, *words: str) -> None:
    """Run a module of this repository in a process of its own; what it prints goes to standard error."""
    # No preferences and no extensions of the user
    environment = {"BLENDER_USER_RESOURCES": str(ROOT / ".cache" / "blender"), **os.environ}
    command = [sys.executable, "-m", name, *words]
    subprocess.run(command, check=True, cwd=ROOT, stdout=sys.stderr, env=environment)


def glossy_rays(gbuffer: GBuffer, camera: Camera) -> Rays:
    """Draw the first reflection ray of each surface pixel, as the reflection pass does."""
    pixel = np.flatnonzero(~gbuffer.is_background)
    dtype = gbuffer.depth.dtype
    origin, direction = np.empty((2, 3, pixel.size), dtype=dtype)

    def draw(slots: IntArray) -> None:
        where, own = slice(slots[0], slots[-1] + 1), pixel.take(slots)
        origin[:, where], normal = surface_points(gbuffer, camera, own)
        lobes = Lobes.at(
            normal, toward_camera(camera, origin[:, where]), gbuffer.roughness.reshape(-1).take(own)
        )
        u, v = sample_square(own, camera.width, 1, 0, dtype)
        direction[:, where] = lobes.draw(u, v, False)[0][:, 0]

    parallel.run_chunks(draw, parallel.split(np.arange(pixel.size), _PIXELS_PER_CHUNK), None)
    return Rays(pixel, origin, direction)


def analytic_room(width: int, height: int) -> CapturedFrame:
    """Return a furnished room of planes and spheres: shelves of balls, a table, rough and glossy surfaces."""
    camera = Camera.perspective(
        width, height, 1.2, world_from_view=look_at((-1.6, 1.5, 2.6), (0.3, 0.9, -1.0))
    )
    gbuffer = capture(camera, _room_surfaces())
    return CapturedFrame(gbuffer, camera, None, "analytic", True, True)


def _room_surfaces() -> list[Surface]:
    def within(low: tuple[float, float, float], high: tuple[float, float, float]):
        return lambda points: ((points >= low) & (points <= high)).all(axis=1)

    grey = {"albedo": 0.7, "specular": 0.04, "source": 0.5}
    walls = [
        Plane((0, 0, 0), (0, 1, 0), 0.3, 0.06, 0.25, 0.3),
        Plane((0, 2.6, 0), (0, -1, 0), roughness=0.9, **grey),
        Plane((-2.2, 0, 0), (1, 0, 0), roughness=0.8, **grey),
        Plane((2.2, 0, 0), (-1, 0, 0), roughness=0.5, **grey),
        Plane((0, 0, -2.5), (0, 0, 1), roughness=0.7, **grey),
        Plane((0, 0, 3.0), (0, 0, -1), roughness=0.7, **grey),
    ]
    shelves = [
        Plane((0, y, 0), (0, 1, 0), roughness=0.4, bounds=within((0.2, -1, -2.5), (2.2, 3, -2.0)), **grey)
        for y in (0.6, 1.2, 1.8)
    ]
    table = [
        Plane((0, 0.7, 0), (0, 1, 0), roughness=0.1, bounds=within((-0.8, 0, -1.0), (0.8, 1, 0.4)), **grey),
        *(
            Plane((0, 0, z), (0, 0, 1), roughness=0.5, bounds=within((x, 0, -9), (x + 0.08, 0.7, 9)), **grey)
            for x in (-0.75, 0.67)
            for z in (-0.9, 0.3)
        ),
    ]
    balls = [
        Sphere((0.4 + 0.3 * i, y + 0.12, -2.2), 0.12, 0.5, 0.1, 0.05 + 0.1 * i, 0.4)
        for i in range(6)
        for y in (0.6, 1.2, 1.8)
    ]
    bowls = [Sphere((-0.3, 0.85, -0.3), 0.15, 0.1, 0.8, 0.02, 0.2), Sphere((-1.2, 0.35, -1.2), 0.35, **grey)]
    return [*walls, *shelves, *table, *balls, *bowls]


def _path(size: Size, name: str) -> Path:
    return CACHE / f"{name}_{size[0]}x{size[1]}.exr"


def _capture(size: Size, name: str) -> CapturedFrame:
    if name == "room":
        return analytic_room(*size)
    # Both need Blender, which nothing else here does
    from ssgi_addon.bpy_module import require_bpy

    require_bpy()
    import bpy

    from ssgi_addon.blender import demo_scene, scene_file
    from ssgi_addon.blender.capture import CaptureOptions, capture_frame

    if name == "demo":
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        scene = demo_scene.build_demo_scene()
    else:
        scene_file.open_scene(SCENES / f"{name}.blend")
        scene = bpy.context.scene
    # Geometry is what matters
    return capture_frame(scene, CaptureOptions(samples=1, denoiser="none", resolution=size))


def main() -> None:
    """Capture one interior."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("size", type=parse_size)
    parser.add_argument("name", nargs="?", choices=NAMES, default=best_interior())
    arguments = parser.parse_args()
    frame = _capture(arguments.size, arguments.name)
    path = _path(arguments.size, arguments.name)
    # The compositor's layers are half of the file, and nothing here reads them
    frame = replace(frame, layers={})
    print(write_passes(frame, path.parent, path.stem))


if __name__ == "__main__":
    main()
