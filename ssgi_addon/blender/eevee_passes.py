# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a view layer through EEVEE and take its passes from a temporary file.

EEVEE has no Python class whose ``render`` could be wrapped, and a background Blender gives the passes of a
finished render away in no other way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import Camera
from ..errors import SSGIError
from ..exr import read_layers
from ..files import scratch_folder
from . import compat
from .camera import camera_of_render
from .cycles_passes import RenderedPasses, render_error
from .restore import Restorer

FloatArray = NDArray[np.float32]


def render_eevee_passes(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, names: Iterable[str]
) -> RenderedPasses:
    """Render `scene` with the settings that it has and return passes of `view_layer`.

    EEVEE keeps colours, normals and positions as half floats (relative error 5e-4) and depth as float, so
    Position is computed from Depth and the camera.

    Parameters
    ----------
    scene
        Its engine is EEVEE. Its output settings are as before afterwards.
    view_layer
        The only one that renders; passes must be switched on.
    names
        Passes to read, by their long names.

    Raises
    ------
    SSGIError
        If Blender cannot render the scene, the render was cancelled, or EEVEE lacks a pass.
    """
    if scene.render.pixel_aspect_x != scene.render.pixel_aspect_y and not compat.writes_oblong_pixels():
        raise SSGIError(
            f"Blender {bpy.app.version_string} cannot write passes of pixels that are not square: use the "
            "engine cycles, or set Output properties > Format > Aspect to 1."
        )
    names = tuple(names)
    cameras: list[Camera] = []
    start = time.perf_counter()
    with scratch_folder() as folder, Restorer() as restorer:
        path = folder / "passes.exr"
        _borrow_output(restorer, scene, path)
        with _at_render(scene, lambda depsgraph: cameras.append(camera_of_render(None, depsgraph))):
            try:
                bpy.ops.render.render(scene=scene.name, write_still=True)
            except RuntimeError as error:
                raise render_error(scene, error) from error
        if not cameras or not path.is_file():
            raise SSGIError("The render was cancelled: nothing was written, start it again.")
        layers = read_layers(path)
    camera = cameras[-1]
    found = _named(layers, view_layer, [name for name in names if name != "Position"])
    if "Position" in names:
        found["Position"] = _positions(found["Depth"], found["Normal"], camera)
    return RenderedPasses(found, camera, time.perf_counter() - start)


def _borrow_output(restorer: Restorer, scene: bpy.types.Scene, path: Path) -> None:
    """Let renders of `scene` write all passes to `path`.

    The choice of a format changes other settings, too. All are put back but one that is empty until the first
    format is chosen, and then can never be emptied again: the linear colour space.
    """
    settings = scene.render.image_settings
    color_space = settings.linear_colorspace_settings
    kept_color_space = color_space.name
    kept = {
        item.identifier: getattr(settings, item.identifier)
        for item in settings.bl_rna.properties
        if not item.is_readonly and item.type not in ("POINTER", "COLLECTION")
    }
    wanted = compat.multilayer_exr_format()
    # The format first: what it allows for depth and colours depends on it.
    kept = {name: kept[name] for name in (*wanted, *kept)}

    def put_back() -> None:
        for name, value in kept.items():
            setattr(settings, name, value)
        if kept_color_space:
            color_space.name = kept_color_space

    restorer.callback(put_back)
    for name, value in wanted.items():
        setattr(settings, name, value)
    restorer.change(
        scene.render, filepath=str(path), use_file_extension=False, use_overwrite=True, use_placeholder=False
    )


@contextmanager
def _at_render(scene: bpy.types.Scene, read: Callable[[bpy.types.Depsgraph], None]) -> Iterator[None]:
    """Call `read` with what a render of `scene` is about to draw; its exceptions surface here."""
    failures: list[BaseException] = []

    def evaluated(rendered: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None) -> None:
        if depsgraph is None or depsgraph.mode != "RENDER" or rendered.name != scene.name:
            return
        try:
            read(depsgraph)
        except BaseException as error:  # Blender would print it and go on
            failures.append(error)

    # Blender brings the scene to the frame once for each view layer that it renders.
    handlers = bpy.app.handlers.frame_change_post
    handlers.append(evaluated)
    try:
        yield
    finally:
        handlers.remove(evaluated)
    if failures:
        raise failures[0]


def _named(
    layers: dict[str, FloatArray], view_layer: bpy.types.ViewLayer, names: Iterable[str]
) -> dict[str, FloatArray]:
    """Pick passes; a file may hold the compositor's picture besides, and names then begin with a layer."""
    found = {}
    missing = []
    for name in names:
        values = layers.get(name, layers.get(f"{view_layer.name}.{name}"))
        if values is None:
            missing.append(name)
        else:
            found[name] = values if values.ndim == 2 else np.ascontiguousarray(values[..., :3])
    if missing:
        raise SSGIError(
            f"EEVEE of Blender {bpy.app.version_string} wrote no pass {', '.join(missing)}: "
            "use the engine cycles."
        )
    return found


def _positions(depth: FloatArray, normal: FloatArray, camera: Camera) -> FloatArray:
    """World-space points of the surfaces at the pixels' centres; zero where there is none."""
    is_surface = np.abs(normal).sum(axis=-1) > 0.0
    y_px, x_px = np.mgrid[: camera.height, : camera.width] + 0.5
    points_vs = camera.pixel_to_view(x_px, y_px, np.where(is_surface, depth, 0.0))
    pose = camera.world_from_view
    points_ws = points_vs @ pose[:3, :3].T + pose[:3, 3]
    return np.where(is_surface[..., None], points_ws, 0.0).astype(np.float32)
