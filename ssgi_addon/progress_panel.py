# SPDX-License-Identifier: GPL-3.0-or-later
"""The buttons that render, and how far a render in the background is: below them and in the status bar."""

from __future__ import annotations

import bpy

from .blender import background


def draw_render_buttons(layout):
    """Draw the buttons; while a render runs, its progress takes the place of the second."""
    layout.operator("ssgi.render", icon="RENDER_STILL")
    render = background.running()
    if render is None:
        layout.operator("ssgi.render", text="Render Animation", icon="RENDER_ANIMATION").animation = True
    else:
        _draw_progress(layout, render)


def redraw(context):
    """Have Blender draw again what shows the progress."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "PROPERTIES":
                area.tag_redraw()
    # The status bar is no area of a screen; this alone has it drawn again
    if context.workspace is not None:
        context.workspace.status_text_set(None)


def _draw_progress(layout, render):
    row = layout.row(align=True)
    row.progress(factor=render.fraction, text=f"{render.text} · {render.fraction:.0%}")
    row.operator("ssgi.cancel_render", text="", icon="X")


def _draw_in_status_bar(self, _context):
    render = background.running()
    if render is not None:
        _draw_progress(self.layout, render)


def register():
    bpy.types.STATUSBAR_HT_header.append(_draw_in_status_bar)


def unregister():
    bpy.types.STATUSBAR_HT_header.remove(_draw_in_status_bar)
    background.stop()
