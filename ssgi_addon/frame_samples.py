# SPDX-License-Identifier: GPL-3.0-or-later
"""A few samples of a frame, and a small picture of it: what a report of many frames looks at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from .core import Camera
from .exr import Pixels, write_layers
from .pictures import RGB, shrunk
from .png import write_png
from .results import Picture

#: Samples and thumbnail are at most so wide and high, pixels.
LARGEST_SIDE = 240


def write_samples(picture: Picture, shown: RGB, path: Path) -> Camera:
    """Write samples and thumbnail of a frame beside its manifest.

    Parameters
    ----------
    picture
        What was computed.
    shown : (H, W, 3) uint8
        The finished picture, display-referred.
    path
        The manifest.

    Returns
    -------
    Camera
        Of the samples.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    layers, camera = frame_samples(picture)
    write_layers(path.with_suffix(".exr"), layers)
    write_png(path.with_suffix(".png"), thumbnail(shown))
    return camera


def frame_samples(picture: Picture) -> tuple[Pixels, Camera]:
    """Return depth, normal and incoming diffuse light of every n-th pixel, and the camera that sees these.

    Single pixels, no means: their noise is what flickers.
    """
    gbuffer, camera = picture.frame.gbuffer, picture.frame.camera
    step = -(-max(camera.width, camera.height) // LARGEST_SIDE)
    first = (step - 1) // 2
    chosen = (slice(first, None, step), slice(first, None, step))
    layers = {
        "depth": gbuffer.depth[chosen],
        "normal": gbuffer.normal[chosen],
        "diffuse": picture.light.diffuse[chosen],
    }
    height, width = layers["depth"].shape
    # The centre of a sample is that of its pixel
    centre = first + 0.5
    small = replace(
        camera, width=width, height=height, fx=camera.fx / step, fy=camera.fy / step,
        cx=(camera.cx - centre) / step + 0.5, cy=(camera.cy - centre) / step + 0.5,
    )  # fmt: skip
    return {name: np.ascontiguousarray(values) for name, values in layers.items()}, small


def thumbnail(shown: RGB) -> RGB:
    """Return a display-referred picture in a size for contact sheets, each pixel the mean of a block."""
    step = -(-max(shown.shape[:2]) // LARGEST_SIDE)
    return shrunk(shown, step)
