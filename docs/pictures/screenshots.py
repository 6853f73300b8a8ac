# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the extension's panels, made inside Blender's window.

Usage, with the extension installed and enabled: ``blender --python docs/pictures/screenshots.py -- FOLDER``.
The script renders the demo scene, arranges the editors, saves PNG files into the folder and quits Blender.
What is in FOLDER/results already, from an earlier run or from the command line, is not rendered again.
"""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np

FOLDER = Path(sys.argv[sys.argv.index("--") + 1]).resolve()
SIZE = (480, 270)
REFERENCE_SAMPLES = 64
# Seconds for Blender to draw what was changed
PATIENCE = 1.5
# Each picture of the render properties shows the main panel with these panels below it.
PANELS = {
    "panel": ("in_render", "beyond"),
    "panel_passes": ("diffuse", "reflections"),
    "panel_results": ("compositing", "output", "compare", "advanced"),
}
# Of the ordinary render
RENDER_SAMPLES = 64
# Seconds between two looks at a render that runs, and how much of it is done in its picture
GLANCE, DONE = 0.1, 0.4
# Of the right end of the status bar, pixels
STATUS_WIDTH = 352
# Share of the window that the render properties get in their pictures, about the width that they have at work
NARROW = 0.27


def steps() -> Iterator[float]:
    """Take all pictures; yields how many seconds Blender may draw before the next step."""
    bpy.context.preferences.view.show_splash = False
    _demo_scene()
    yield PATIENCE
    window = bpy.context.window_manager.windows[0]
    area = max(window.screen.areas, key=lambda area: area.width * area.height)
    with bpy.context.temp_override(window=window, area=area):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=NARROW)
    yield PATIENCE
    narrow, wide = sorted(window.screen.areas, key=lambda area: area.width * area.height)[-2:]
    yield from _panels(window, narrow)
    yield from _running(window, narrow)
    yield from _image_editor(window, wide)
    yield from _compositor(window, wide)
    yield from _in_render(window, wide)


def _panels(window: bpy.types.Window, area: bpy.types.Area) -> Iterator[float]:
    area.type = "PROPERTIES"
    for name, shown in PANELS.items():
        _show_only(("main", *shown))
        area.spaces.active.context = "RENDER"
        yield PATIENCE
        _save(window, area, name)


def _running(window: bpy.types.Window, area: bpy.types.Area) -> Iterator[float]:
    """Save the panel and the status bar while a render runs, and stop it."""
    background = importlib.import_module(f"{_module()}.ssgi_addon.blender.background")
    _show_only(("main", "sampling"))
    with bpy.context.temp_override(window=window, area=area):
        bpy.ops.ssgi.render("INVOKE_DEFAULT")
    while background.running() is not None and background.running().fraction < DONE:
        yield GLANCE
    _save(window, area, "running")
    height = min(area.y for area in window.screen.areas)
    status_bar = SimpleNamespace(x=window.width - STATUS_WIDTH, y=0, width=STATUS_WIDTH, height=height)
    _save(window, status_bar, "running_status")
    bpy.ops.ssgi.cancel_render()
    yield PATIENCE


def _image_editor(window: bpy.types.Window, area: bpy.types.Area) -> Iterator[float]:
    area.type = "IMAGE_EDITOR"
    area.spaces.active.show_region_ui = True
    yield PATIENCE
    _open_sidebar(area)
    with bpy.context.temp_override(window=window, area=area):
        bpy.ops.ssgi.preview()
    yield PATIENCE
    _save(window, area, "preview")
    for view in ("SPLIT", "ERROR"):
        window.scene.ssgi.compare_view = view
        with bpy.context.temp_override(window=window, area=area):
            bpy.ops.ssgi.show_comparison()
        yield PATIENCE
        _save(window, area, f"compare_{view.lower()}")


def _compositor(window: bpy.types.Window, area: bpy.types.Area) -> Iterator[float]:
    area.type, area.ui_type = "NODE_EDITOR", "CompositorNodeTree"
    area.spaces.active.show_region_ui = True
    if hasattr(area.spaces.active, "show_region_asset_shelf"):
        area.spaces.active.show_region_asset_shelf = False
    yield PATIENCE
    _open_sidebar(area)
    with bpy.context.temp_override(window=window, area=area, region=_region(area, "WINDOW")):
        bpy.ops.node.view_all()
    yield PATIENCE
    _save(window, area, "compositor")


def _in_render(window: bpy.types.Window, area: bpy.types.Area) -> Iterator[float]:
    """Render as F12 does, with the light switched on and nothing in the compositor."""
    scene = window.scene
    with bpy.context.temp_override(window=window, scene=scene):
        bpy.ops.ssgi.remove_layers()
    scene.ssgi.enabled, scene.cycles.samples = True, RENDER_SAMPLES
    bpy.context.preferences.view.render_display_type = "NONE"
    with bpy.context.temp_override(window=window, area=area, scene=scene):
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield PATIENCE
    while bpy.app.is_job_running("RENDER"):
        yield GLANCE
    area.type = "IMAGE_EDITOR"
    area.spaces.active.image = bpy.data.images["Render Result"]
    area.spaces.active.show_region_ui = False
    yield PATIENCE
    with bpy.context.temp_override(window=window, area=area, region=_region(area, "WINDOW")):
        bpy.ops.image.view_all(fit_view=True)
    yield PATIENCE
    _save(window, area, "in_render", shrink=2)


def _demo_scene() -> None:
    """Build the demo scene, render it and compare it."""
    demo = importlib.import_module(f"{_module()}.ssgi_addon.blender.demo_scene")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=False)
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene = demo.build_demo_scene()
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.ssgi.compare, scene.ssgi.reference_samples = True, REFERENCE_SAMPLES
    scene.ssgi.output = str(FOLDER / "results")
    # The light has to come from the layers alone.
    scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 0
    window = bpy.context.window_manager.windows[0]
    window.scene = scene
    result = Path(scene.ssgi.output, "untitled_0001.exr")
    with bpy.context.temp_override(window=window, scene=scene):
        if result.exists():
            scene.ssgi.result = str(result)
            bpy.ops.ssgi.add_layers(filepath=str(result))
        else:
            bpy.ops.ssgi.render()


def _open_sidebar(area: bpy.types.Area) -> None:
    """Show our tab of an editor's sidebar."""
    _region(area, "UI").active_panel_category = "SSGI"


def _region(area: bpy.types.Area, kind: str) -> bpy.types.Region:
    return next(region for region in area.regions if region.type == kind)


def _our_panels() -> list[type[bpy.types.Panel]]:
    """Return our panels of the render properties, in their order."""
    return list(importlib.import_module(f"{_module()}.ssgi_addon.ui.render_panels").CLASSES)


def _module() -> str:
    names = (addon.module for addon in bpy.context.preferences.addons)
    return next(name for name in names if name.rpartition(".")[2] == "ssgi")


def _show_only(shown: tuple[str, ...]) -> None:
    """Leave nothing but some panels in the render properties of this session, unfolded."""
    for cls in _subclasses(bpy.types.Panel):
        if getattr(cls, "bl_context", "") == "render":
            cls.poll = classmethod(lambda _cls, _context: False)
    ours = _our_panels()
    for cls in reversed(ours):
        bpy.utils.unregister_class(cls)
    for cls in ours:
        cls.bl_options = set(getattr(cls, "bl_options", ())) - {"DEFAULT_CLOSED"}
        cls.poll = classmethod(lambda _cls, _context: False)
        bpy.utils.register_class(cls)
        if cls.__name__.removeprefix("SSGI_PT_") in shown:
            cls.poll = classmethod(lambda _cls, _context: True)


def _subclasses(cls: type) -> Iterator[type]:
    for child in cls.__subclasses__():
        yield child
        yield from _subclasses(child)


def _save(
    window: bpy.types.Window, part: bpy.types.Area | SimpleNamespace, name: str, shrink: int = 1
) -> None:
    """Save what a part of the window shows: an editor, or whatever has its place and size.

    `shrink` is how many pixels each way become one.
    """
    height, width = part.height // shrink, part.width // shrink
    shown = _window_pixels(window)[part.y :, part.x :][: height * shrink, : width * shrink]
    shown = shown.reshape(height, shrink, width, shrink, 3).mean(axis=(1, 3))
    write_png = importlib.import_module(f"{_module()}.ssgi_addon.png").write_png
    write_png(FOLDER / f"{name}.png", np.rint(shown[::-1] * 255.0).astype(np.uint8))


def _window_pixels(window: bpy.types.Window) -> np.ndarray:
    """Return what the window shows, (H, W, 3) float32, bottom row first.

    Blender's own screenshots are black with some drivers, software OpenGL among them; where the program
    ``scrot`` is installed, it takes the picture of a screen that the window fills.
    """
    with tempfile.TemporaryDirectory() as folder:
        screen = Path(folder, "screen.png")
        if shutil.which("scrot") is None:
            with bpy.context.temp_override(window=window):
                bpy.ops.screen.screenshot(filepath=str(screen))
        else:
            subprocess.run(["scrot", str(screen)], check=True)
        image = bpy.data.images.load(str(screen))
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    if (width, height) != (window.width, window.height):
        raise RuntimeError("start Blender in a window that fills the screen (--window-geometry)")
    return pixels.reshape(height, width, 4)[..., :3]


def _run(pending: Iterator[float]) -> float | None:
    """Take the next step; quit after the last one, or at an error."""
    try:
        return next(pending)
    except StopIteration:
        pass
    except Exception:
        # A timer would swallow it.
        traceback.print_exc()
    bpy.ops.wm.quit_blender()
    return None


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    pending = steps()
    # A file that is opened ends all timers that are not persistent.
    bpy.app.timers.register(lambda: _run(pending), first_interval=PATIENCE, persistent=True)
