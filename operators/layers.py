# SPDX-License-Identifier: GPL-3.0-or-later
"""Add the result to the compositor, and take it out again."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..ssgi_addon.blender import compositor
from ..ssgi_addon.errors import SSGIError


class SSGI_OT_add_layers(bpy.types.Operator, ImportHelper):
    """Add the indirect light of a result file to the compositor's output, or update it there"""

    bl_idname = "ssgi.add_layers"
    bl_label = "Add to Compositor"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".exr"
    filter_glob: StringProperty(default="*.exr", options={"HIDDEN"})

    @classmethod
    def poll(cls, context):
        return _may_edit(cls, context)

    def invoke(self, context, event):
        """Take the last result; ask for a file where there is none."""
        self.filepath = context.scene.ssgi.result
        if self.filepath:
            return self.execute(context)
        return super().invoke(context, event)

    def execute(self, context):
        path = bpy.path.abspath(self.filepath or context.scene.ssgi.result)
        if not path:
            self.report({"ERROR"}, "No result to add: render the indirect light first, or name its file")
            return {"CANCELLED"}
        try:
            compositor.publish_layers(context.scene, path)
        except SSGIError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for warning in compositor.warnings(context.scene):
            self.report({"WARNING"}, warning)
        return {"FINISHED"}


class SSGI_OT_remove_layers(bpy.types.Operator):
    """Take the indirect light out of the compositor and reconnect what it stood between"""

    bl_idname = "ssgi.remove_layers"
    bl_label = "Remove from Compositor"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if compositor.has_layers(context.scene):
            return _may_edit(cls, context)
        cls.poll_message_set("The compositor of this scene holds no result")
        return False

    def execute(self, context):
        try:
            compositor.remove_layers(context.scene)
        except SSGIError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def _may_edit(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    obstacle = compositor.edit_obstacle(context.scene)
    if obstacle:
        operator.poll_message_set(obstacle)
    return obstacle is None


CLASSES = (SSGI_OT_add_layers, SSGI_OT_remove_layers)
