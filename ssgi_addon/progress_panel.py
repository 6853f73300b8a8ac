# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a render in the background is: below the button, and in the status bar."""

from __future__ import annotations

import bpy

from .blender import background


def draw_render_progress(layout):
    """Draw the progress of the running render with a button that stops it; nothing where none runs."""
    render = background.running()
    if render is None:
        return
    row = layout.row(align=True)
    row.progress(factor=render.fraction, text=f"{render.text} · {render.fraction:.0%}")
    row.operator("ssgi.cancel_render", text="", icon="X")


def redraw(context):
    """Have Blender draw again what shows the progress."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "PROPERTIES":
                area.tag_redraw()
    # Of the status bar, which is no area of a screen, this alone is the way
    context.workspace.status_text_set(None)


def _draw_in_status_bar(self, _context):
    draw_render_progress(self.layout)


def register():
    bpy.types.STATUSBAR_HT_header.append(_draw_in_status_bar)


def unregister():
    bpy.types.STATUSBAR_HT_header.remove(_draw_in_status_bar)
    background.stop()
