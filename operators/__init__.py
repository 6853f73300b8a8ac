# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: read settings, call `ssgi_addon`, report, return."""

from __future__ import annotations

import bpy

from . import compare, layers, presets, preview, render

CLASSES = (*render.CLASSES, *preview.CLASSES, *layers.CLASSES, *compare.CLASSES, *presets.CLASSES)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
