# SPDX-License-Identifier: GPL-3.0-or-later
"""Save the settings of a scene as a preset of the user's, and remove one."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase

from ..ssgi_addon.ui.presets import SUBFOLDER, preset_values


class SSGI_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the indirect light"""

    bl_idname = "ssgi.preset_add"
    bl_label = "Add SSGI Preset"

    preset_menu = "SSGI_PT_presets"
    preset_subdir = SUBFOLDER
    preset_defines = ["ssgi = bpy.context.scene.ssgi"]
    preset_values = preset_values()


CLASSES = (SSGI_OT_preset_add,)
