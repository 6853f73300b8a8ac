# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: they draw what there is to set, and compute nothing."""

from __future__ import annotations

import bpy

from . import compare_panel, compositor_panel, presets, render_panels

CLASSES = (*presets.CLASSES, *render_panels.CLASSES, *compositor_panel.CLASSES, *compare_panel.CLASSES)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
