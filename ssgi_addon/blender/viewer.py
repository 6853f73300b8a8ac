# SPDX-License-Identifier: GPL-3.0-or-later
"""Results in the image editors that are open."""

from __future__ import annotations

from pathlib import Path

import bpy

from .layer_group import MARK


def show_result(window_manager: bpy.types.WindowManager, exr_path: Path) -> bpy.types.Image | None:
    """Show a result in an image editor: first where a render, a result or nothing is shown.

    Shown is the picture as the scene's view transform makes it, in the PNG file beside the layers: of
    layers Blender shows the first by name, and no script can choose another.

    Parameters
    ----------
    window_manager
        Whose windows are looked through.
    exr_path
        The result file.

    Returns
    -------
    bpy.types.Image or None
        What is shown; None where no image editor is open to view images.
    """
    editors = [
        area.spaces.active
        for window in window_manager.windows
        for area in window.screen.areas
        if area.ui_type == "IMAGE_EDITOR"
    ]
    free = [editor for editor in editors if editor.mode == "VIEW" and not editor.use_image_pin]
    if not free:
        return None
    image = bpy.data.images.load(str(exr_path.with_suffix(".png")), check_existing=True)
    image.reload()
    image[MARK] = True
    min(free, key=lambda editor: _is_of_the_user(editor.image)).image = image
    return image


def _is_of_the_user(image: bpy.types.Image | None) -> bool:
    return image is not None and image.source != "VIEWER" and MARK not in image
