# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the compositor."""

from __future__ import annotations

import bpy

from ..blender import compare_image, compositor
from .drawing import draw_look, draw_messages


class SSGI_PT_compositor(bpy.types.Panel):
    """Puts the result into the compositor and takes it out again."""

    bl_label = "Indirect Light"
    bl_space_type = "NODE_EDITOR"
    bl_region_type = "UI"
    bl_category = "SSGI"

    @classmethod
    def poll(cls, context):
        return context.space_data.tree_type == "CompositorNodeTree"

    def draw(self, context):
        layout, scene = self.layout, context.scene
        layout.use_property_split = True
        layout.use_property_decorate = False
        is_there = compositor.has_layers(scene)
        column = layout.column(align=True)
        text = "Update Layers" if is_there else "Add Layers"
        column.operator("ssgi.add_layers", icon="NODE_COMPOSITING", text=text)
        column.operator("ssgi.remove_layers", icon="X", text="Remove Layers")
        obstacle = compositor.edit_obstacle(scene)
        if obstacle:
            draw_messages(layout, [obstacle])
        elif not is_there and compare_image.result_path(scene) is None:
            draw_messages(layout, ["Nothing rendered yet: the button asks for a file"], icon="INFO")
        look = layout.column()
        look.active = is_there
        draw_look(look, scene.ssgi)
        draw_messages(layout, compositor.warnings(scene))


CLASSES = (SSGI_PT_compositor,)
