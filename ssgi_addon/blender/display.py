# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene-linear radiance to the picture that the scene's colour management shows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from ..errors import SSGIError
from ..files import scratch_folder
from ..png import check_whole, write_png


def to_display(scene: bpy.types.Scene, image: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """Show scene-linear radiance through the scene's view transform.

    View transform, look, exposure, gamma, curves and white balance all count, and so does a colour
    management that the output settings override, because Blender itself applies them: the result
    equals a PNG that Blender saves from a render of the same radiance, without the dither noise.
    The scene is as before afterwards.

    Parameters
    ----------
    scene
        Whose colour management to use.
    image : (H, W, 3) float32
        Scene-linear radiance, top row first. NaN shows as black, infinity as white.

    Returns
    -------
    (H, W, 3) uint8
        Display-referred, top row first.

    Raises
    ------
    ValueError
        If `image` is not ``(H, W, 3)`` or has no pixels.
    SSGIError
        If Blender cannot write the temporary picture.
    """
    radiance = np.asarray(image, dtype=np.float32)
    if radiance.ndim != 3 or radiance.shape[2] != 3 or radiance.size == 0:
        raise ValueError(f"image: expected shape (H, W, 3) with at least one pixel, got {radiance.shape}")
    radiance = np.nan_to_num(radiance)  # infinity becomes the largest finite value, which shows as white

    with scratch_folder() as folder:
        path = str(folder / "display.png")
        _save_through_view(scene, radiance, path)
        return _read_png(path)


def write_display_png(scene: bpy.types.Scene, image: npt.ArrayLike, path: str | os.PathLike[str]) -> None:
    """Write scene-linear radiance as the PNG that the scene's colour management shows.

    Parameters are those of `to_display`; the file appears whole or not at all.
    """
    write_png(Path(path), to_display(scene, image))


def _save_through_view(scene: bpy.types.Scene, radiance: npt.NDArray[np.float32], path: str) -> None:
    height, width = radiance.shape[:2]
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., :3] = radiance[::-1]  # Blender keeps the bottom row first
    datablock = bpy.data.images.new("ssgi display", width, height, alpha=True, float_buffer=True)
    try:
        datablock.pixels.foreach_set(pixels.ravel())
        datablock.update()
        with _png_copy(scene) as copy:
            datablock.save_render(path, scene=copy)
        check_whole(path)
    except (OSError, RuntimeError) as error:
        raise SSGIError(
            f"Cannot write a temporary picture in {os.path.dirname(path)}: {error}. "
            "Make room there, or set TMPDIR to another folder."
        ) from error
    finally:
        bpy.data.images.remove(datablock)


def _read_png(path: str) -> npt.NDArray[np.uint8]:
    datablock = bpy.data.images.load(path)
    try:
        datablock.colorspace_settings.name = "Non-Color"
        width, height = datablock.size
        pixels = np.empty(width * height * 4, dtype=np.float32)
        datablock.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(datablock)
    rgb = pixels.reshape(height, width, 4)[::-1, :, :3]
    return np.ascontiguousarray(np.rint(rgb * 255.0).astype(np.uint8))


@contextmanager
def _png_copy(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """Give a copy of `scene` that saves 8-bit RGB PNGs; a chosen format cannot be put back in full."""
    copy = scene.copy()
    try:
        settings = copy.render.image_settings
        if hasattr(settings, "media_type"):  # 5.0 and later; it decides which file formats may be chosen
            settings.media_type = "IMAGE"
        settings.file_format = "PNG"
        settings.color_mode = "RGB"
        settings.color_depth = "8"
        settings.compression = 0
        yield copy
    finally:
        bpy.data.scenes.remove(copy)
