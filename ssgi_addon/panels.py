# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the render properties."""

from __future__ import annotations

from dataclasses import fields

import bpy

from .blender import compositor
from .core.settings import DiffuseSettings, ReflectionSettings, Settings
from .job_options import BEYOND_FRAME, CYCLES_ONLY
from .progress_panel import draw_render_buttons


class _RenderPanel:
    """What all panels share: their place, and the engines that have a render to add light to."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {"CYCLES", "BLENDER_EEVEE", "BLENDER_EEVEE_NEXT"}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        self.draw_settings(self.layout, context.scene.ssgi)


class SSGI_PT_main(_RenderPanel, bpy.types.Panel):
    bl_label = "Screen-Space Global Illumination"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout, settings):
        layout.prop(settings, "preset")
        layout.prop(settings, "engine")
        column = layout.column(align=True)
        column.prop(settings, "samples")
        row = column.row()
        row.active = settings.engine == "cycles"
        row.prop(settings, "denoiser")
        row = column.row()
        row.active = settings.engine == "cycles"
        row.prop(settings, "own_geometry")
        draw_render_buttons(layout)


class SSGI_PT_beyond(_RenderPanel, bpy.types.Panel):
    bl_label = "Beyond the Frame"
    bl_parent_id = "SSGI_PT_main"

    def draw_settings(self, layout, settings):
        column = layout.column()
        for name in BEYOND_FRAME:
            row = column.row()
            row.active = settings.engine == "cycles" or name not in CYCLES_ONLY
            row.prop(settings, name)


class SSGI_PT_diffuse(_RenderPanel, bpy.types.Panel):
    bl_label = "Diffuse"
    bl_parent_id = "SSGI_PT_main"

    def draw_header(self, context):
        self.layout.prop(context.scene.ssgi.diffuse, "enabled", text="")

    def draw_settings(self, layout, settings):
        layout.active = settings.diffuse.enabled
        _draw_options(layout, settings.diffuse, DiffuseSettings)


class SSGI_PT_reflections(_RenderPanel, bpy.types.Panel):
    bl_label = "Reflections"
    bl_parent_id = "SSGI_PT_main"

    def draw_header(self, context):
        self.layout.prop(context.scene.ssgi.reflections, "enabled", text="")

    def draw_settings(self, layout, settings):
        layout.active = settings.reflections.enabled
        _draw_options(layout, settings.reflections, ReflectionSettings)


class SSGI_PT_advanced(_RenderPanel, bpy.types.Panel):
    bl_label = "Advanced"
    bl_parent_id = "SSGI_PT_main"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout, settings):
        _draw_options(layout, settings, Settings)


class SSGI_PT_output(_RenderPanel, bpy.types.Panel):
    bl_label = "Output"
    bl_parent_id = "SSGI_PT_main"

    def draw_settings(self, layout, settings):
        layout.prop(settings, "output", text="")
        column = layout.column(heading="Saving")
        column.prop(settings, "overwrite")
        column.prop(settings, "save_passes")
        column.prop(settings, "add_to_compositor")

        column = layout.column(heading="Compare")
        column.prop(settings, "compare", text="With Cycles")
        row = column.row()
        row.active = settings.compare
        row.prop(settings, "reference_samples", text="Samples")

        row = layout.row(align=True)
        row.operator("ssgi.add_layers", icon="NODE_COMPOSITING")
        row.operator("ssgi.remove_layers", text="", icon="X")
        for warning in compositor.warnings(settings.id_data):
            layout.label(text=warning, icon="ERROR")


def _draw_options(layout, group, settings_type):
    """Draw the options of a settings dataclass that leave a choice, without the one in the panel's header."""
    column = layout.column()
    for item in fields(settings_type):
        choices = item.metadata.get("choices") or ()
        if item.metadata and item.name != "enabled" and len(choices) != 1:
            row, methods = column.row(), item.metadata["methods"]
            row.active = methods is None or group.method in methods
            row.prop(group, item.name)


CLASSES = (
    SSGI_PT_main,
    SSGI_PT_beyond,
    SSGI_PT_diffuse,
    SSGI_PT_reflections,
    SSGI_PT_advanced,
    SSGI_PT_output,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
