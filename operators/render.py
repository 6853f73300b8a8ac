# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the indirect light of the current frame."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..ssgi_addon.blender import compositor, job
from ..ssgi_addon.errors import SSGIError
from ..ssgi_addon.properties import job_options


class SSGI_OT_render(bpy.types.Operator):
    """Render the direct light of the current frame and add the indirect light to it"""

    bl_idname = "ssgi.render"
    bl_label = "Render Indirect Light"
    bl_options = {"REGISTER"}

    def execute(self, context):
        scene = context.scene
        window_manager = context.window_manager
        window_manager.progress_begin(0.0, 1.0)
        try:
            result = job.render_frame(
                scene,
                job_options(scene.ssgi, _output_folder(scene.ssgi.output)),
                lambda fraction, _text: window_manager.progress_update(fraction),
            )
        except (SSGIError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            window_manager.progress_end()
        scene.ssgi.result = str(result.exr_path)
        self.report({"INFO"}, f"Saved {result.exr_path}")
        if scene.ssgi.add_to_compositor:
            self._publish(scene)
        return {"FINISHED"}

    def _publish(self, scene: bpy.types.Scene) -> None:
        """Hand the result to the compositor; where that is refused, the files are there all the same."""
        try:
            compositor.publish_layers(scene, scene.ssgi.result)
        except SSGIError as error:
            self.report({"WARNING"}, str(error))
            return
        for warning in compositor.warnings(scene):
            self.report({"WARNING"}, warning)


def _output_folder(path: str) -> Path:
    """Resolve a folder; what is relative to a file that was never saved lies in the temporary folder."""
    if path.startswith("//") and not bpy.data.filepath:
        return Path(bpy.app.tempdir, path.removeprefix("//"))
    return Path(bpy.path.abspath(path))


CLASSES = (SSGI_OT_render,)
