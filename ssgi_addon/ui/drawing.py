# SPDX-License-Identifier: GPL-3.0-or-later
"""What several panels draw."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

import bpy

# Of a letter, and of what stands beside a line: icon, margins, tabs; in pixels at a scale of 1.
_LETTER_PX, _BESIDE_PX = 6.5, 75.0
_FEWEST_LETTERS = 16
_LETTERS_WITHOUT_REGION = 48
# Of a cost behind a property, in Blender's units of a button's height.
_COST_WIDTH = 2.5


def draw_messages(layout: bpy.types.UILayout, texts: Iterable[str], icon: str = "ERROR") -> None:
    """Draw sentences, each wrapped into lines, with an icon before the first: labels do not wrap."""
    letters = _letters_per_line()
    for text in texts:
        column = layout.column(align=True)
        column.scale_y = 0.8
        for index, line in enumerate(textwrap.wrap(text, letters)):
            column.label(text=line, icon="BLANK1" if index else icon)


def draw_look(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """Draw strength and tint of each kind of light."""
    for kind in ("diffuse", "glossy"):
        column = layout.column(align=True)
        column.prop(settings, f"{kind}_strength")
        column.prop(settings, f"{kind}_tint", text="Tint")


def draw_cost(row: bpy.types.UILayout, share: float | None) -> None:
    """Draw what a switch costs behind it, as a share of the direct light; None keeps the place free."""
    label = row.row()
    label.ui_units_x = _COST_WIDTH
    label.label(text="" if share is None else f"+{share:.0%}")


def _letters_per_line() -> int:
    """Return about how many letters fit a line of the region that is being drawn."""
    region, system = bpy.context.region, bpy.context.preferences.system
    if region is None:
        return _LETTERS_WITHOUT_REGION
    return max(_FEWEST_LETTERS, int((region.width / system.ui_scale - _BESIDE_PX) / _LETTER_PX))
