# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the light in ordinary renders."""

from __future__ import annotations

import bpy

from .blender.cycles_passes import CYCLES
from .panels import SSGI_PT_main


class SSGI_PT_in_render(bpy.types.Panel):
    bl_label = "In Renders"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_parent_id = SSGI_PT_main.__name__

    def draw(self, context):
        settings, layout = context.scene.ssgi, self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        is_cycles = context.scene.render.engine == CYCLES
        if not is_cycles:
            layout.label(text="With Cycles only: use Render Indirect Light", icon="INFO")
        column = layout.column()
        column.active = is_cycles and settings.enabled
        column.prop(settings, "replace_combined")
        column.prop(settings, "replace_gi")


CLASSES = (SSGI_PT_in_render,)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
