# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of a scene that change how a finished result is shown, not what is computed."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, FloatProperty, FloatVectorProperty

from .blender import compare_image, compositor
from .compare_picture import VIEWS


def _apply_look(group: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    compositor.apply_look(group.id_data)


def redraw_comparison(group: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Show a change in the comparison, if there is one."""
    compare_image.redraw(group.id_data)


def _strength(kind: str) -> FloatProperty:
    return FloatProperty(
        name=f"{kind} Strength",
        description=f"Factor on the {kind.lower()} indirect light, applied in the compositor: nothing is "
        "rendered again",
        default=1.0,
        min=0.0,
        max=100.0,
        soft_max=2.0,
        step=1,
        precision=3,
        update=_apply_look,
    )


def _tint(kind: str) -> FloatVectorProperty:
    return FloatVectorProperty(
        name=f"{kind} Tint",
        description=f"Color that the {kind.lower()} indirect light is multiplied by, applied in the "
        "compositor: nothing is rendered again",
        subtype="COLOR",
        size=3,
        default=(1.0, 1.0, 1.0),
        min=0.0,
        max=100.0,
        soft_max=1.0,
        update=_apply_look,
    )


class LookProperties:
    """Strength and tint of each kind of light; the inputs of the node group follow them."""

    __annotations__ = {
        "diffuse_strength": _strength("Diffuse"),
        "diffuse_tint": _tint("Diffuse"),
        "glossy_strength": _strength("Glossy"),
        "glossy_tint": _tint("Glossy"),
    }


class CompareProperties:
    """What the comparison in the image editor shows."""

    __annotations__ = {
        "compare_view": EnumProperty(
            name="Show",
            description="Part of the last result that the comparison shows",
            items=[(view.name, view.label, view.help) for view in VIEWS],
            default=VIEWS[0].name,
            update=redraw_comparison,
        ),
        "compare_split": FloatProperty(
            name="Split",
            description="Place of the border between both pictures, from the left to the right edge",
            subtype="FACTOR",
            default=0.5,
            min=0.0,
            max=1.0,
            update=redraw_comparison,
        ),
    }
