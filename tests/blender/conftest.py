# SPDX-License-Identifier: GPL-3.0-or-later
"""What tests inside Blender share."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")


@pytest.fixture
def empty_file():
    """A file with one empty scene, whatever earlier tests left."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy.context.scene
