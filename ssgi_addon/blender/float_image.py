# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays as images of the open file, for the image editor."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from . import compat


def show_in_image(name: str, pixels: npt.ArrayLike, *, is_light: bool = True) -> bpy.types.Image:
    """Put an array into the image of that name; make the image if there is none.

    Parameters
    ----------
    name
        Of the image data-block. One of ours keeps its place in the editors that show it.
    pixels : (H, W, 3) float32
        Top row first.
    is_light
        Whether they are scene-linear radiance, which the scene's view transform shows, or display-referred
        sRGB, which is shown as it is.

    Returns
    -------
    bpy.types.Image
        Packed, so that neither undo nor saving loses it and Blender asks nobody to save it.
    """
    colors = np.asarray(pixels, np.float32)
    height, width = colors.shape[:2]
    image = _image_of_size(name, width, height)
    if is_light:
        compat.set_scene_linear(image)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = (colors if is_light else _linear(colors))[::-1]  # Blender keeps the bottom row first
    image.pixels.foreach_set(rgba.ravel())
    image.use_view_as_render = is_light
    image.update()
    image.pack()
    return image


def _show_in_editor(context: bpy.types.Context, image: bpy.types.Image) -> bool:
    """Show an image, as large as fits, in the editor of `context` or in another image editor that is open.

    Returns
    -------
    bool
        False if none is open.
    """
    windows = context.window_manager.windows if context.window_manager else ()
    editors = [
        (window, area)
        for window in windows
        for area in window.screen.areas
        if area.type == "IMAGE_EDITOR" and not area.spaces.active.use_image_pin
    ]
    if not editors:
        return False
    window, area = next((editor for editor in editors if editor[1] == context.area), editors[0])
    area.spaces.active.image = image
    region = next(region for region in area.regions if region.type == "WINDOW")
    with context.temp_override(window=window, area=area, region=region):
        bpy.ops.image.view_all(fit_view=True)
    return True


def present(operator: bpy.types.Operator, context: bpy.types.Context, image: bpy.types.Image) -> None:
    """Show an image in an editor that is open, or let an operator tell its name where no editor is open."""
    if not _show_in_editor(context, image):
        operator.report({"INFO"}, f"No image editor is open: choose the image '{image.name}' in one")


def _image_of_size(name: str, width: int, height: int) -> bpy.types.Image:
    old = bpy.data.images.get((name, None))  # not one that is linked
    if old is not None and tuple(old.size) == (width, height):
        return old
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True)
    if old is not None:
        # A packed image cannot be made larger; editors and nodes show the new one in its place.
        old.user_remap(image)
        bpy.data.images.remove(old)
        image.name = name
    return image


def _linear(encoded: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return scene-linear values that the display's sRGB curve turns into `encoded` (IEC 61966-2-1)."""
    curve = ((encoded + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve).astype(np.float32)
