# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory the passes take at their peak, beyond the frame itself.

What Python and numpy ask for at most, by each preset without a fill, alone and with a surround of six views;
at two sizes, so that what a pixel takes can be told from what is at work at a time. Run from the repository's
root:

    python -m benchmarks.memory [--sizes 640x360 1280x720] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import tracemalloc
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.inputs import Size, analytic_room, parse_size
from ssgi_addon.core import Camera, Environment, Settings, render_indirect
from ssgi_addon.core.scene import View
from ssgi_addon.core.settings import PRESETS
from tests.core.synthetic import Plane, capture

SIZES = ((640, 360), (1280, 720))
# Sides of the faces of a surround, as shares of the frame's width.
_FACE = 0.25


def surround(size: Size) -> list[View]:
    """Return six views around the camera of a room."""
    side = round(_FACE * size[0])
    walls = [
        Plane(np.multiply(3.0, axis), np.negative(axis), 0.6, 0.1, 0.4, 0.5)
        for axis in (*np.eye(3), *-np.eye(3))
    ]
    views: list[View] = []
    for column in range(3):
        for sign in (1.0, -1.0):
            pose = np.eye(4)
            pose[:3, :3] = np.roll(np.eye(3), column, axis=0) * np.array([sign, 1.0, sign])
            camera = Camera.perspective(side, side, np.pi / 2, world_from_view=pose)
            views.append((capture(camera, walls), camera))
    return views


def peak_bytes(size: Size, settings: Settings, views: list[View]) -> int:
    """Return the most that is allocated at a time, beyond the frame and the views."""
    frame = analytic_room(*size)
    sky = Environment.constant((1.0, 1.0, 1.0))
    tracemalloc.start()
    try:
        render_indirect(frame.gbuffer, frame.camera, settings, sky, views)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def bytes_per_pixel(sizes: tuple[Size, Size], settings: Settings, *, has_views: bool) -> float:
    """Return how many bytes each further pixel of the frame takes, with its share of the views."""
    peaks = [peak_bytes(size, settings, surround(size) if has_views else []) for size in sizes]
    pixels = [width * height for width, height in sizes]
    return (peaks[1] - peaks[0]) / (pixels[1] - pixels[0])


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=parse_size, nargs=2, default=SIZES, metavar="WIDTHxHEIGHT")
    parser.add_argument("--presets", nargs="+", default=tuple(PRESETS), choices=tuple(PRESETS))
    parser.add_argument("--output", type=Path, help="JSON file for the results")
    arguments = parser.parse_args()
    rows = []
    for preset in arguments.presets:
        for has_views in (False, True):
            settings = Settings.preset(preset)
            found = bytes_per_pixel(tuple(arguments.sizes), settings, has_views=has_views)
            rows.append({"preset": preset, "has_views": has_views, "bytes_per_pixel": found})
            print(f"{preset:9} {'six views' if has_views else '':10} {found:7.0f} bytes/pixel", flush=True)
    if arguments.output is not None:
        record.store(arguments.output, {"sizes": arguments.sizes}, rows)


if __name__ == "__main__":
    main()
