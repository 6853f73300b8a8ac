# SPDX-License-Identifier: GPL-3.0-or-later
"""What belongs to the machine and not to a scene."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty

# The extension that this package lies in; empty where it is imported by itself.
_EXTENSION = __package__.rpartition(".")[0]


class SSGI_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = _EXTENSION

    threads: IntProperty(
        name="Threads",
        description="Most threads that a render uses where the scene does not say how many; 0 uses all. "
        "Never changes a result",
        min=0,
        max=1024,
        default=0,
    )
    cache_folder: StringProperty(
        name="Cache Folder",
        description="Where a render in the background keeps the copy of the file, as long as it runs. Empty: "
        "the extension's own folder among the user's files",
        subtype="DIR_PATH",
        default="",
    )

    def draw(self, _context):
        self.layout.use_property_split = True
        self.layout.prop(self, "threads")
        self.layout.prop(self, "cache_folder", placeholder=str(default_cache_folder()))


def threads() -> int | None:
    """Return the most threads that a render may use; None means all."""
    preferences = _preferences()
    return (preferences.threads or None) if preferences else None


def cache_folder() -> Path:
    """Return where the copies of files go."""
    preferences = _preferences()
    if preferences and preferences.cache_folder:
        return Path(bpy.path.abspath(preferences.cache_folder))
    return default_cache_folder()


def default_cache_folder() -> Path:
    """Return the folder that Blender gives this extension for its files; it may not exist yet."""
    return Path(bpy.utils.extension_path_user(_EXTENSION))


def _preferences() -> SSGI_AP_preferences | None:
    addon = bpy.context.preferences.addons.get(_EXTENSION)
    return addon.preferences if addon else None


register, unregister = bpy.utils.register_classes_factory((SSGI_AP_preferences,))
