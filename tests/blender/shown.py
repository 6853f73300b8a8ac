# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that were written for people, read back."""

from __future__ import annotations

import bpy
import numpy as np


def read_png(path):
    """(H, W, 3) uint8, top row first, as stored."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return np.rint(pixels.reshape(height, width, 4)[::-1, :, :3] * 255).astype(np.uint8)


def find_picture(sheet, picture):
    """Row and column of `picture` in `sheet`, None where it does not stand there unchanged."""
    height, width = picture.shape[:2]
    for y, x in np.argwhere((sheet == picture[0, 0]).all(axis=-1)):
        if np.array_equal(sheet[y : y + height, x : x + width], picture):
            return int(y), int(x)
    return None
