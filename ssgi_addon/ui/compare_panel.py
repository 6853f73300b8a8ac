# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the image editor."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from ..blender import compare_image
from ..compare_picture import VIEWS, view_named
from .drawing import draw_messages

# Errors as reports have them: label, key, how to write the number.
_METRICS = (
    ("relMSE", "relmse", ".4f"),
    ("SSIM", "ssim", ".4f"),
    ("FLIP", "flip", ".4f"),
    ("Bias", "bias", "+.4f"),
)


class SSGI_PT_comparison(bpy.types.Panel):
    """Chooses what the comparison shows, and tells the errors of the last one."""

    bl_label = "Compare Indirect Light"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "SSGI"

    @classmethod
    def poll(cls, context):
        return context.space_data.mode != "UV"

    def draw(self, context):
        layout, scene = self.layout, context.scene
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.operator("ssgi.show_comparison", icon="IMAGE_DATA")
        layout.operator("ssgi.preview", icon="RENDER_STILL")
        has_result = compare_image.result_path(scene) is not None
        has_reference = compare_image.has_reference(scene)
        column = layout.column(align=True)
        column.use_property_split = False
        for view in VIEWS:
            row = column.row()
            row.enabled = has_result and (has_reference or not view.needs_reference)
            row.prop_enum(scene.ssgi, "compare_view", view.name)
        row = layout.row()
        row.active = view_named(scene.ssgi.compare_view).is_split
        row.prop(scene.ssgi, "compare_split", slider=True)
        if not has_result:
            draw_messages(layout, ["Nothing to compare: render the indirect light first"], icon="INFO")
        elif not has_reference:
            draw_messages(
                layout,
                ["No reference: switch on Compare with Cycles in the render properties, then render again"],
                icon="INFO",
            )
        draw_metrics(layout, compare_image.metrics(scene))


def draw_metrics(
    layout: bpy.types.UILayout, metrics: Mapping[str, Mapping[str, float | None]] | None
) -> None:
    """Draw the errors of a comparison as a table: of the direct light alone, and of ours."""
    if metrics is None:
        return
    grid = layout.box().grid_flow(row_major=True, columns=3, even_columns=True, align=True)
    for text in ("Error", "Direct", "Ours"):
        grid.label(text=text)
    for label, key, form in _METRICS:
        grid.label(text=label)
        for name in ("direct_only", "combined"):
            value = metrics[name][key]
            grid.label(text="—" if value is None else format(value, form))


CLASSES = (SSGI_PT_comparison,)
