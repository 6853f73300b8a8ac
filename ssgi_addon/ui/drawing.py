# SPDX-License-Identifier: GPL-3.0-or-later
"""What several panels draw."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

import bpy

# About as many letters as fit a line of a panel of usual width.
_LINE = 48


def draw_messages(layout: bpy.types.UILayout, texts: Iterable[str], icon: str = "ERROR") -> None:
    """Draw sentences, each wrapped into lines, with an icon before the first: labels do not wrap."""
    for text in texts:
        column = layout.column(align=True)
        column.scale_y = 0.8
        for index, line in enumerate(textwrap.wrap(text, _LINE)):
            column.label(text=line, icon="BLANK1" if index else icon)


def draw_look(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """Draw strength and tint of each kind of light."""
    for kind in ("diffuse", "glossy"):
        column = layout.column(align=True)
        column.prop(settings, f"{kind}_strength")
        column.prop(settings, f"{kind}_tint", text="Tint")
