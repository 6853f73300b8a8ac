# SPDX-License-Identifier: GPL-3.0-or-later
"""Results in the image editors that are open."""

from __future__ import annotations

from pathlib import Path

import bpy

from .layer_group import GROUP_NAME, load_image


def show_result(window_manager: bpy.types.WindowManager, path: Path) -> bpy.types.Image | None:
    """Show a result file in an image editor: first where a render, a result or nothing is shown.

    Returns
    -------
    bpy.types.Image or None
        What is shown; None where no image editor is open to view images.

    Raises
    ------
    SSGIError
        If the file is no result.
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
    editor = min(free, key=lambda editor: _is_of_the_user(editor.image))
    old = editor.image
    editor.image = _newest_of(path) or load_image(path)
    if old is not None and not old.users and _is_of(old, path):
        bpy.data.images.remove(old)  # the same file as it was before
    return editor.image


def _newest_of(path: Path) -> bpy.types.Image | None:
    """Return the image of a file that was loaded last, as the file is now."""
    loaded = [image for image in bpy.data.images if _is_of(image, path)]
    if not loaded:
        return None
    newest = max(loaded, key=lambda image: image.session_uid)
    newest.reload()
    return newest


def _is_of(image: bpy.types.Image, path: Path) -> bool:
    return image.source == "FILE" and Path(bpy.path.abspath(image.filepath)) == path


def _is_of_the_user(image: bpy.types.Image | None) -> bool:
    return image is not None and image.source != "VIEWER" and not image.name.startswith(f"{GROUP_NAME} ")
