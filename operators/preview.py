# SPDX-License-Identifier: GPL-3.0-or-later
"""A small picture with indirect light, within seconds."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty

from ..ssgi_addon.blender import preview
from ..ssgi_addon.blender.camera import camera_obstacle
from ..ssgi_addon.blender.float_image import present
from ..ssgi_addon.blender.render_settings import render_obstacle
from ..ssgi_addon.errors import SSGIError


class SSGI_OT_preview(bpy.types.Operator):
    """Render the frame with its indirect light at a low resolution, by the draft preset"""

    bl_idname = "ssgi.preview"
    bl_label = "Preview"
    bl_options = {"REGISTER"}

    percentage: IntProperty(
        name="Resolution",
        description="Size of the preview, as a percentage of the render's",
        subtype="PERCENTAGE",
        default=25,
        min=1,
        max=100,
    )

    @classmethod
    def poll(cls, context):
        obstacle = camera_obstacle(context.scene) or render_obstacle()
        if obstacle:
            cls.poll_message_set(obstacle)
        return obstacle is None

    def execute(self, context):
        window_manager = context.window_manager
        window_manager.progress_begin(0.0, 1.0)
        try:
            image = preview.render_preview(
                context.scene,
                self.percentage / 100.0,
                lambda fraction, _text: window_manager.progress_update(fraction),
            )
        except SSGIError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            window_manager.progress_end()
        present(self, context, image)
        return {"FINISHED"}


CLASSES = (SSGI_OT_preview,)
