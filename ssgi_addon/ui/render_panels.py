# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels in the render properties."""

from __future__ import annotations

from dataclasses import fields

import bpy

from ..blender import compare_image, compositor
from ..blender.camera import camera_obstacle, full_size
from ..blender.capture_costs import cost_shares
from ..blender.cycles_passes import CYCLES
from ..blender.one_frame import VIEW_SAMPLES
from ..core.settings import DiffuseSettings, ReflectionSettings, Settings
from ..job_options import BEYOND_FRAME, CYCLES_ONLY
from ..last_result import frame_record, reasons_skipped
from ..progress_panel import draw_render_buttons
from .compare_panel import draw_metrics
from .drawing import draw_cost, draw_look, draw_messages
from .presets import SSGI_PT_presets

# Of the switches beyond the frame, those that limit the others.
_WITHOUT_COST = ("budget", "mirrors_only")
# Of what both passes share, what the fill is for; drawn below its samples.
_FILL_USE = ("fill_mode", "filled_roughness", "visibility")


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


class _SubPanel(_RenderPanel):
    bl_parent_id = "SSGI_PT_main"


class SSGI_PT_main(_RenderPanel, bpy.types.Panel):
    """The preset, and the buttons that render."""

    bl_label = "Screen-Space GI"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, context):
        SSGI_PT_presets.draw_panel_header(self.layout)

    def draw_settings(self, layout, settings):
        scene = settings.id_data
        obstacle = camera_obstacle(scene)
        if obstacle:
            draw_messages(layout, [obstacle])
        if settings.enabled and scene.render.engine != CYCLES:
            draw_messages(layout, ["Only Cycles' own renders get the light by themselves: use the button"])
        layout.prop(settings, "preset")
        layout.prop(settings, "engine")
        draw_render_buttons(layout)
        layout.operator("ssgi.preview", icon="IMAGE_DATA")


class SSGI_PT_in_render(_SubPanel, bpy.types.Panel):
    """What the light does in the scene's own renders."""

    bl_label = "In Renders"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        self.layout.active = context.engine == CYCLES
        self.layout.prop(context.scene.ssgi, "enabled", text="")

    def draw_settings(self, layout, settings):
        column = layout.column()
        column.active = settings.enabled and settings.id_data.render.engine == CYCLES
        column.prop(settings, "replace_combined")
        column.prop(settings, "replace_gi")
        double = compositor.double_light(settings.id_data) if settings.enabled else None
        if double:
            draw_messages(layout, [double])


class SSGI_PT_sampling(_SubPanel, bpy.types.Panel):
    """The render of the direct light."""

    bl_label = "Sampling"

    def draw_settings(self, layout, settings):
        layout.prop(settings, "samples")
        column = layout.column()
        column.active = settings.engine == "cycles"
        column.prop(settings, "denoiser")
        column.prop(settings, "own_geometry")


class _PassPanel(_SubPanel):
    """One kind of light: its switch, and its options."""

    bl_options = {"DEFAULT_CLOSED"}
    group: str
    settings_type: type

    def draw_header(self, context):
        self.layout.prop(getattr(context.scene.ssgi, self.group), "enabled", text="")

    def draw_settings(self, layout, settings):
        group = getattr(settings, self.group)
        layout.active = group.enabled
        _draw_options(layout, group, self.settings_type)


class SSGI_PT_diffuse(_PassPanel, bpy.types.Panel):
    """The diffuse indirect light."""

    bl_label = "Diffuse"
    group, settings_type = "diffuse", DiffuseSettings


class SSGI_PT_reflections(_PassPanel, bpy.types.Panel):
    """The glossy indirect light."""

    bl_label = "Reflections"
    group, settings_type = "reflections", ReflectionSettings


class SSGI_PT_beyond(_SubPanel, bpy.types.Panel):
    """What is captured beyond the frame: each switch with its cost, and why it was left out last time."""

    bl_label = "Beyond the Frame"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout, settings):
        is_cycles = settings.engine == "cycles"
        available = [name for name in BEYOND_FRAME if is_cycles or name not in CYCLES_ONLY]
        width, height = full_size(settings.id_data)
        costs = cost_shares(settings, max(1, width * height), VIEW_SAMPLES)
        shares = {name: share for name, share in costs.items() if name in available}
        path = compare_image.result_path(settings.id_data)
        record = None if path is None else frame_record(path)
        for name in BEYOND_FRAME:
            row = layout.row()
            row.active = name in available
            row.prop(settings, name)
            if name not in _WITHOUT_COST:
                draw_cost(row, shares.get(name))
            for reason in reasons_skipped(record, name):
                draw_messages(layout, [f"Last time skipped: {reason}"], icon="INFO")
            if name == "fill":
                _draw_fill_use(layout, settings, is_there=row.active and settings.fill > 0)
        layout.prop(settings, "keep_world")
        total = sum(shares.values())
        if total > settings.budget:
            text = f"About +{total:.0%}, more than the budget: what brings least is left out"
            draw_messages(layout, [text], icon="INFO")


class SSGI_PT_compositing(_SubPanel, bpy.types.Panel):
    """Strength and tint of each kind of light, in the compositor."""

    bl_label = "Compositing"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout, settings):
        draw_look(layout, settings)
        row = layout.row(align=True)
        is_there = compositor.has_layers(settings.id_data)
        row.operator("ssgi.add_layers", icon="NODE_COMPOSITING", text="Update" if is_there else "Add")
        row.operator("ssgi.remove_layers", icon="X", text="Remove")
        draw_messages(layout, compositor.warnings(settings.id_data))


class SSGI_PT_output(_SubPanel, bpy.types.Panel):
    """Where results go."""

    bl_label = "Output"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout, settings):
        layout.prop(settings, "output", text="")
        column = layout.column(heading="Saving")
        column.prop(settings, "overwrite")
        column.prop(settings, "save_passes")
        column.prop(settings, "add_to_compositor")


class SSGI_PT_compare(_SubPanel, bpy.types.Panel):
    """The comparison with Cycles' own indirect light."""

    bl_label = "Compare with Cycles"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        self.layout.prop(context.scene.ssgi, "compare", text="")

    def draw_settings(self, layout, settings):
        row = layout.row()
        row.active = settings.compare
        row.prop(settings, "reference_samples", text="Samples")
        layout.operator("ssgi.show_comparison", icon="IMAGE_DATA")
        draw_metrics(layout, compare_image.metrics(settings.id_data))


class SSGI_PT_advanced(_SubPanel, bpy.types.Panel):
    """What both passes share."""

    bl_label = "Advanced"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout, settings):
        _draw_options(layout, settings, Settings, elsewhere=_FILL_USE)


def _draw_fill_use(layout, settings, *, is_there):
    """Draw what the fill is for, and which rays there are beside one that brings the light."""
    column = layout.column()
    column.active = is_there
    column.prop(settings, "fill_mode")
    rays = column.column()
    rays.active = settings.fill_mode == "replace"
    for name in _FILL_USE[1:]:
        rays.prop(settings, name)


def _draw_options(layout, group, settings_type, elsewhere=("enabled",)):
    """Draw the options of a settings dataclass that leave a choice and are not drawn elsewhere."""
    column = layout.column()
    for item in fields(settings_type):
        choices = item.metadata.get("choices") or ()
        if item.metadata and item.name not in elsewhere and len(choices) != 1:
            row, methods = column.row(), item.metadata["methods"]
            row.active = methods is None or group.method in methods
            row.prop(group, item.name)


CLASSES = (
    SSGI_PT_main,
    SSGI_PT_in_render,
    SSGI_PT_sampling,
    SSGI_PT_diffuse,
    SSGI_PT_reflections,
    SSGI_PT_beyond,
    SSGI_PT_compositing,
    SSGI_PT_output,
    SSGI_PT_compare,
    SSGI_PT_advanced,
)
