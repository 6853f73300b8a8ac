# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the last result beside what it is compared with."""

from __future__ import annotations

import bpy

from ..ssgi_addon.blender import compare_image
from ..ssgi_addon.blender.float_image import present
from ..ssgi_addon.errors import SSGIError


class SSGI_OT_show_comparison(bpy.types.Operator):
    """Show the last result in the image editor, beside its direct light or Cycles' own indirect light"""

    bl_idname = "ssgi.show_comparison"
    bl_label = "Show Comparison"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if compare_image.result_path(context.scene) is not None:
            return True
        cls.poll_message_set("There is nothing to compare: render the indirect light first")
        return False

    def execute(self, context):
        try:
            image = compare_image.draw_comparison(context.scene)
        except SSGIError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        present(self, context, image)
        return {"FINISHED"}


CLASSES = (SSGI_OT_show_comparison,)
