# SPDX-License-Identifier: GPL-3.0-or-later
"""Change a rendered picture's colours and light, and compute its indirect light anew, without rendering.

    pip install .
    python examples/relight.py render.exr --output relit.exr --paint 20,90=0.1,0.3,0.8 --light 1.5

render.exr is a multilayer EXR file that Cycles wrote, with the passes Depth, Normal, Position, Diffuse and
Glossy (Direct and Color), Emission and Environment of one view layer. Changed are

    --paint X,Y=R,G,B   surfaces of the diffuse colour that the pixel X,Y has, from the top left: another one,
                        linear; pixels that mix it with what is behind keep their colour
    --light FACTOR      the strength of all lamps
    --sky R,G,B         light from everywhere outside, on top of what the render had

What the changed surfaces reflect on to others follows by itself: paint a wall red, and the floor before it
reddens. Beside the result, relit.png shows the picture before and after, both with the indirect light that
their passes give.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from ssgi_addon.blender_passes import BOUNCES, frame_from_blender
from ssgi_addon.core import Environment, Settings
from ssgi_addon.core.metrics import display_referred
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers
from ssgi_addon.png import write_png
from ssgi_addon.results import Picture, compute_picture, write_picture

# How far apart two colours may be in each channel and count as the same paint
SAME_PAINT = 0.05


def main() -> None:
    """Read the passes, change them, compute and write."""
    arguments = parse_arguments()
    # Sums that hold the old light are left out: what they were made of is what changes.
    passes = {name: values for name, values in read_layers(arguments.render).items() if name not in BOUNCES}
    # Many rays, since no fill from Blender helps here
    settings = Settings.preset("final")
    settings = replace(settings, diffuse=replace(settings.diffuse, rays=arguments.rays))
    before = light_up(arguments.render, passes, settings)

    passes["Diffuse Color"] = paint(passes["Diffuse Color"], arguments.paint)
    for name in ("Diffuse Direct", "Glossy Direct"):
        passes[name] = passes[name] * np.float32(arguments.light)
    after = light_up(arguments.render, passes, settings, arguments.sky)

    write_picture(after, arguments.output)
    rows = (before.combined, after.combined)
    sheet = np.concatenate([to_screen(picture, before.combined) for picture in rows], axis=1)
    write_png(arguments.output.with_suffix(".png"), sheet)
    print(f"{arguments.output}, and beside it {arguments.output.with_suffix('.png').name}: before and after")


def light_up(
    path: Path, passes: dict[str, np.ndarray], settings: Settings, sky: np.ndarray | None = None
) -> Picture:
    """Return the picture that passes give together with the indirect light that follows from them."""
    frame = frame_from_blender(path, passes, camera=None)  # solved from Position and Depth
    if sky is not None:
        frame = replace(frame, environment=Environment.constant(sky))
    return compute_picture(frame, settings)


def paint(color: np.ndarray, changes: list[tuple[int, int, np.ndarray]]) -> np.ndarray:
    """Return a colour pass with new colours in place of those that some pixels have."""
    painted = color.copy()
    for x, y, new in changes:
        painted[(np.abs(color - color[y, x]) < SAME_PAINT).all(axis=-1)] = new
    return painted


def to_screen(picture: np.ndarray, exposed_for: np.ndarray) -> np.ndarray:
    """Return sRGB bytes, at the exposure that suits one of the pictures."""
    exposure = float(np.log2(0.9 / np.percentile(exposed_for, 98.0)))
    return np.rint(255.0 * display_referred(picture, exposure)).astype(np.uint8)


def rgb(text: str) -> np.ndarray:
    """Read `r,g,b`."""
    color = np.array([float(part) for part in text.split(",")], np.float32)
    if color.shape != (3,):
        raise ValueError(text)
    return color


def change(text: str) -> tuple[int, int, np.ndarray]:
    """Read `x,y=r,g,b`."""
    pixel, _, color = text.partition("=")
    x, y = map(int, pixel.split(","))
    return x, y, rgb(color)


def parse_arguments() -> argparse.Namespace:
    """Return what to change."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("render", metavar="RENDER.exr", type=Path)
    parser.add_argument("--output", metavar="FILE.exr", type=Path, default=Path("relit.exr"))
    parser.add_argument("--paint", metavar="X,Y=R,G,B", type=change, action="append", default=[])
    parser.add_argument("--light", metavar="FACTOR", type=float, default=1.0)
    parser.add_argument("--sky", metavar="R,G,B", type=rgb)
    parser.add_argument("--rays", metavar="N", type=int, default=32, help="per pixel (default: 32)")
    return parser.parse_args()


if __name__ == "__main__":
    try:
        main()
    except SSGIError as error:
        sys.exit(f"relight: {error}")
