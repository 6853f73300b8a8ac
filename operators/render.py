# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the indirect light: in this process, or from a window in a background one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
from bpy.props import BoolProperty

from ..ssgi_addon import preferences
from ..ssgi_addon.blender import background, compositor, job, viewer
from ..ssgi_addon.errors import SSGIError
from ..ssgi_addon.job_options import JobOptions
from ..ssgi_addon.progress_panel import redraw
from ..ssgi_addon.properties import job_options

# Seconds between two looks at the background process
_TICK = 0.1


class SSGI_OT_render(bpy.types.Operator):
    """Render the direct light of the current frame and add the indirect light to it"""

    bl_idname = "ssgi.render"
    bl_label = "Render Indirect Light"
    bl_options = {"REGISTER"}

    animation: BoolProperty(
        name="Animation",
        description="Render the scene's frame range. Without Overwrite, those that have a result are skipped",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, _context, properties):
        if properties.animation:
            return cls.bl_rna.properties["animation"].description
        return cls.__doc__

    @classmethod
    def poll(cls, _context):
        if background.running() is None:
            return True
        cls.poll_message_set("A render runs in the background: wait for it, or cancel it")
        return False

    def execute(self, context):
        scene = context.scene
        window_manager = context.window_manager
        window_manager.progress_begin(0.0, 1.0)
        try:
            options = _options(scene, animation=self.animation)
            job.render_frames(
                scene, options, lambda fraction, _text: window_manager.progress_update(fraction)
            )
        except (SSGIError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            window_manager.progress_end()
        self._show(context, scene, job.shown_result(scene, options))
        return {"FINISHED"}

    def invoke(self, context, _event):
        """Render in the background where there is a Blender program to do it."""
        blender = background.find_blender()
        if not blender:
            return self.execute(context)
        scene = context.scene
        try:
            options = _options(scene, animation=self.animation)
            cache, threads = preferences.cache_folder(), preferences.threads()
            render = background.BackgroundRender(
                scene, context.view_layer, options, cache, blender=blender, threads=threads
            )
        except (SSGIError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        background.start(render)
        self._timer = context.window_manager.event_timer_add(_TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        render = background.running()
        if render is None or (event.type == "ESC" and event.value == "PRESS"):
            self.cancel(context)
            self.report({"INFO"}, "Cancelled: results of finished frames stay, others are as they were")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        shown = render.fraction, render.text
        has_ended = render.update()
        if (render.fraction, render.text) != shown:
            redraw(context)
        if not has_ended:
            return {"PASS_THROUGH"}
        failure = render.failure()
        self.cancel(context)
        if failure is not None:
            self.report({"ERROR"}, f"The background render failed: {failure}")
            return {"CANCELLED"}
        return self._finish(context, render)

    def cancel(self, context):
        """End the background process; Blender calls this too, when a window closes or another file opens."""
        background.stop()
        context.window_manager.event_timer_remove(self._timer)
        redraw(context)

    def _finish(self, context, render):
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == render.scene_uid), None)
        if scene is None:
            self.report({"WARNING"}, f"Saved {render.result}; its scene is gone")
            return {"CANCELLED"}
        self._show(context, scene, render.result)
        bpy.ops.ed.undo_push(message=self.bl_label)
        return {"FINISHED"}

    def _show(self, context, scene: bpy.types.Scene, result: Path) -> None:
        """Show the result, and hand it to the compositor; where that is refused, the files are there."""
        scene.ssgi.result = str(result)
        self.report({"INFO"}, f"Saved {result}")
        viewer.show_result(context.window_manager, result)
        if not scene.ssgi.add_to_compositor:
            return
        try:
            compositor.publish_layers(scene, result)
        except SSGIError as error:
            self.report({"WARNING"}, str(error))
            return
        for warning in compositor.warnings(scene):
            self.report({"WARNING"}, warning)


class SSGI_OT_cancel_render(bpy.types.Operator):
    """Stop the render in the background (Esc); results of finished frames stay"""

    bl_idname = "ssgi.cancel_render"
    bl_label = "Cancel Render"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, _context):
        return background.running() is not None

    def execute(self, _context):
        background.stop()
        return {"FINISHED"}


def _options(scene: bpy.types.Scene, *, animation: bool) -> JobOptions:
    """Return what the scene says, with the threads of the preferences where it leaves them open."""
    options = job_options(scene.ssgi, _output_folder(scene.ssgi.output))
    if options.settings.threads is None:
        options = replace(options, settings=replace(options.settings, threads=preferences.threads()))
    frames = (scene.frame_current,)
    if animation:
        frames = tuple(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))
    return replace(options, frames=frames, resume=animation)


def _output_folder(path: str) -> Path:
    """Resolve a folder; what is relative to a file that was never saved lies in the temporary folder."""
    if path.startswith("//") and not bpy.data.filepath:
        return Path(bpy.app.tempdir, path.removeprefix("//"))
    return Path(bpy.path.abspath(path))


CLASSES = (SSGI_OT_render, SSGI_OT_cancel_render)
