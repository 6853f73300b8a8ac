# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: read settings, call `ssgi_addon`, report, return."""

from __future__ import annotations

import bpy

from . import layers, render

CLASSES = (*render.CLASSES, *layers.CLASSES)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
