# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison of a scene's last result, as an image of the open file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ..compare_picture import DIRECT, KNOWN, OURS, REFERENCE, compose, view_named
from ..errors import SSGIError
from ..exr import read_layers
from ..last_result import frame_record, modified, reference_path
from .float_image import show_in_image

IMAGE_NAME = "SSGI Compare"


def result_path(scene: bpy.types.Scene) -> Path | None:
    """Return the file of the last result of `scene`; None if there is none any more."""
    if not scene.ssgi.result:
        return None
    path = Path(bpy.path.abspath(scene.ssgi.result))
    return None if modified(path) is None else path


def has_reference(scene: bpy.types.Scene) -> bool:
    """Whether the last result of `scene` was compared with Cycles.

    The file of the reference alone does not tell: it may be that of an earlier result.
    """
    path = result_path(scene)
    return path is not None and metrics(scene) is not None and modified(reference_path(path)) is not None


def metrics(scene: bpy.types.Scene) -> dict[str, dict[str, float | None]] | None:
    """Return the errors of the last result of `scene`, as its report has them; None without a comparison."""
    path = result_path(scene)
    record = None if path is None else frame_record(path)
    return None if record is None else record.get("metrics")


def draw_comparison(scene: bpy.types.Scene) -> bpy.types.Image:
    """Draw what the scene's settings choose into the image of the comparison, which is made if need be.

    Raises
    ------
    SSGIError
        If there is no result, no reference for a view that needs it, or a file cannot be read.
    """
    path = result_path(scene)
    if path is None:
        raise SSGIError("There is no result to show: render the indirect light first")
    view = view_named(scene.ssgi.compare_view)
    layers = _layers(path, modified(path))
    if view.needs_reference:
        if not has_reference(scene):
            raise SSGIError(
                "The last result was not compared with Cycles: switch the comparison on, then render again"
            )
        reference = reference_path(path)
        layers = layers | {REFERENCE: _layers(reference, modified(reference))[OURS]}
    try:
        pixels = compose(view, layers, scene.ssgi.compare_split)
    except (KeyError, ValueError) as error:
        raise SSGIError(f"{path} cannot be compared: {error}; render it again") from error
    return show_in_image(IMAGE_NAME, pixels, is_light=view.is_light)


def redraw(scene: bpy.types.Scene) -> None:
    """Draw the comparison again where its image is there; without a result the image stays as it is."""
    if IMAGE_NAME not in bpy.data.images or result_path(scene) is None:
        return
    if view_named(scene.ssgi.compare_view).needs_reference and not has_reference(scene):
        return
    draw_comparison(scene)


@lru_cache(maxsize=2)
def _layers(path: Path, _written: int) -> dict[str, Any]:
    """Read the layers that views are made of; a result and its reference are kept until they change."""
    layers = read_layers(path)
    return {name: layers[name] for name in (DIRECT, OURS, KNOWN) if name in layers}
