# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets that users save themselves, through Blender's own preset system, in their own folder."""

from __future__ import annotations

from dataclasses import fields

import bpy
from bl_ui.utils import PresetPanel

from ..core.settings import DiffuseSettings, ReflectionSettings, Settings
from ..job_options import BEYOND_FRAME, DEFAULT_PRESET, RENDERED

# Below the user's own presets folder
SUBFOLDER = "ssgi"
# What is of this machine or of this take, not of a way to render.
_NOT_SAVED = ("seed", "threads")


def preset_values() -> list[str]:
    """Return what a preset holds, in the order in which it is set again.

    The built-in preset and the engine come first, for they set others.
    """
    rendered = dict.fromkeys((*RENDERED[DEFAULT_PRESET], *BEYOND_FRAME))
    shared = [item.name for item in fields(Settings) if item.metadata and item.name not in _NOT_SAVED]
    diffuse = [f"diffuse.{item.name}" for item in fields(DiffuseSettings)]
    reflections = [f"reflections.{item.name}" for item in fields(ReflectionSettings)]
    return [f"ssgi.{name}" for name in ("preset", "engine", *rendered, *shared, *diffuse, *reflections)]


class SSGI_PT_presets(PresetPanel, bpy.types.Panel):
    """Popover with the user's presets, in the header of the main panel."""

    bl_label = "SSGI Presets"
    preset_subdir = SUBFOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "ssgi.preset_add"


CLASSES = (SSGI_PT_presets,)
