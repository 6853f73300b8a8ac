# SPDX-License-Identifier: GPL-3.0-or-later
"""Add the indirect light to ordinary renders of scenes that have it switched on.

Before each frame a handler puts a method of ours before the one by which Cycles renders a view layer, and
after the render it takes it away again: with the switch off nothing here has a part in any render. The method
lets Cycles render, reads the passes that it left in memory, and fills those that the compositor, files and
windows get. What the render needs otherwise than the scene has it is set in the copy of the scene that
Blender made for this render, so that the scene itself never changes.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray

from ..core import Camera, Settings
from ..errors import SSGIError
from ..properties import core_settings
from ..results import Picture, compute_picture
from . import compat
from .camera import camera_of_render, check_camera, full_size
from .capture import assemble_frame
from .cycles_passes import (
    CYCLES,
    RenderedPasses,
    cycles_engine,
    is_capturing,
    read_alpha,
    read_result,
    write_result,
)
from .declared_passes import (
    BOUNCE_PASSES,
    DIFFUSE,
    GLOSSY,
    PICTURE,
    VISIBILITY,
    declare_passes,
    needed_passes,
)
from .engines import engine_named
from .render_settings import LARGEST_TILE_PX, refuse_more_than_a_tile
from .restore import Restorer
from .roughness import RoughnessSource, borrow_roughness

FloatArray = NDArray[np.float32]
Render = Callable[[Any, bpy.types.Depsgraph], None]


class _StoppedError(Exception):
    """The user has stopped the render."""


class _Hook:
    """Our method in the place of Cycles' own, from the first frame of a render to its end."""

    def __init__(self) -> None:
        self._restorer: Restorer | None = None
        self.edits_materials = False

    def install(self, scenes: list[bpy.types.Scene]) -> None:
        """Stand before Cycles, and let the passes of `scenes` tell the roughness."""
        if self._restorer is not None:
            return
        engine_class = cycles_engine()
        original = engine_class.render
        with Restorer() as restorer:
            roughness = {
                (scene.name, layer.name): borrow_roughness(restorer, layer)
                for scene in scenes
                for layer in scene.view_layers
            }

            def render(self: Any, depsgraph: bpy.types.Depsgraph) -> None:
                _render(original, self, depsgraph, roughness)

            self.edits_materials = not all(
                compat.has_roughness_pass(layer) for scene in scenes for layer in scene.view_layers
            )
            engine_class.render = render
            restorer.callback(setattr, engine_class, "render", original)
            self._restorer = restorer.pop_all()

    def remove(self) -> None:
        """Leave everything as it was."""
        restorer, self._restorer = self._restorer, None
        if restorer is not None:
            restorer.close()


_HOOK = _Hook()


def is_on(scene: bpy.types.Scene) -> bool:
    """Whether renders of `scene` get our light."""
    return scene.ssgi.enabled and scene.render.engine == CYCLES and hasattr(scene, "cycles")


@persistent
def _before_frame(_scene: bpy.types.Scene, *_: object) -> None:
    # The compositor may have Blender render other scenes, too, and no handler tells of those
    scenes = [scene for scene in bpy.data.scenes if is_on(scene)]
    if scenes and not is_capturing():
        for scene in scenes:
            declare_passes(scene)
        _HOOK.install(scenes)


@persistent
def _after_render(*_: object) -> None:
    _HOOK.remove()


@persistent
def _before_save(*_: object) -> None:
    # The file must hold none of the nodes that a render borrows; the next frame borrows them anew
    if _HOOK.edits_materials:
        _HOOK.remove()


_HANDLERS = {
    "render_pre": _before_frame,
    "render_complete": _after_render,
    "render_cancel": _after_render,
    "save_pre": _before_save,
    "load_pre": _after_render,
}


def register() -> None:
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    _HOOK.remove()
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)


@dataclass(frozen=True)
class _Plan:
    """What a view layer's light is computed with, all of it known before Cycles renders the layer.

    Afterwards Blender may have freed the scene that was rendered.
    """

    layer_name: str
    passes: tuple[str, ...]
    roughness: RoughnessSource
    camera: Camera
    settings: Settings
    replaces_gi: bool
    replaces_combined: bool


def _render(
    original: Render,
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    roughness: dict[tuple[str, str], RoughnessSource],
) -> None:
    """Render a view layer through Cycles and add our light; whatever fails leaves Cycles' picture.

    Where we refuse, Cycles renders with all of its own light, and a warning says so. A failure after that
    leaves a picture without indirect light: as an error it keeps Blender from saving it and from going on.
    """
    scene = depsgraph.scene
    if engine.is_preview or not is_on(scene):
        original(engine, depsgraph)
        return
    try:
        plan = _plan(engine, depsgraph, roughness)
    except Exception as error:
        original(engine, depsgraph)
        _report(engine, "WARNING", error)
        return
    start = time.perf_counter()
    with _borrowed_copy(engine, depsgraph, plan):
        original(engine, depsgraph)
    try:
        if not engine.test_break():
            _add_light(engine, scene, plan, time.perf_counter() - start)
    except _StoppedError:
        pass
    except Exception as error:
        _report(engine, "ERROR", error)


def _report(engine: bpy.types.RenderEngine, level: str, error: Exception) -> None:
    """Tell what went wrong; Blender would print it, and tell nobody."""
    text = str(error)
    if not isinstance(error, SSGIError):
        traceback.print_exception(error)
        text = f"{type(error).__name__}: {error} (see the console)"
    engine.report({level}, f"The render is without screen-space light. {text}")


def _plan(
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    roughness: dict[tuple[str, str], RoughnessSource],
) -> _Plan:
    scene, layer_name = depsgraph.scene, depsgraph.view_layer.name
    check_camera(scene)
    refuse_more_than_a_tile(full_size(scene))
    source = roughness.get((scene.name, layer_name))
    if source is None:
        raise SSGIError(f"View layer '{layer_name}' came in the middle of a render: start it again.")
    return _Plan(
        layer_name=layer_name,
        passes=tuple(dict.fromkeys((*needed_passes(scene), *source.passes))),
        roughness=source,
        camera=camera_of_render(engine, depsgraph),
        settings=core_settings(depsgraph.scene_eval.ssgi),
        replaces_gi=scene.ssgi.replace_gi,
        replaces_combined=scene.ssgi.replace_combined,
    )


@contextmanager
def _borrowed_copy(
    engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, plan: _Plan
) -> Iterator[None]:
    """Set up the copy of the scene that Blender made for this render.

    It is put back only where persistent data keeps it for the next render; else it may be gone afterwards.
    """
    cycles, is_kept = depsgraph.scene_eval.cycles, depsgraph.scene.render.use_persistent_data
    with Restorer() as restorer:
        if plan.replaces_gi:
            restorer.change(cycles, diffuse_bounces=0, glossy_bounces=0, use_fast_gi=False)
        if cycles.use_auto_tile and max(full_size(depsgraph.scene)) > cycles.tile_size:
            # Tiles go to a file, and the passes in memory stay empty
            restorer.change(cycles, use_auto_tile=False, tile_size=LARGEST_TILE_PX)
            engine.update(bpy.data, depsgraph)  # Cycles has looked at the tiles before
        if not is_kept:
            restorer.pop_all()
        yield


def _add_light(
    engine: bpy.types.RenderEngine, scene: bpy.types.Scene, plan: _Plan, render_seconds: float
) -> None:
    layers = read_result(engine, scene, plan.layer_name, plan.passes)
    if not plan.replaces_gi:
        layers["Combined"] = _without_bounces(layers)
    rendered = RenderedPasses(layers, plan.camera, render_seconds)
    frame = assemble_frame(engine_named("cycles"), None, plan.roughness.read(layers), rendered)
    picture = compute_picture(frame, plan.settings, _progress(engine))
    outputs = _outputs(picture, read_alpha(engine, plan.layer_name))
    if plan.replaces_combined:
        outputs["Combined"] = picture.combined
    write_result(engine, plan.layer_name, outputs)


def _without_bounces(layers: dict[str, FloatArray]) -> FloatArray:
    """Return the light that needs no bounce; where a denoiser has changed the sum, its error stays."""
    direct = layers["Combined"]
    for name in BOUNCE_PASSES:
        direct = direct - layers[name] * layers[name.replace("Indirect", "Color")]
    return np.maximum(direct, 0.0)


def _outputs(picture: Picture, alpha: FloatArray) -> dict[str, FloatArray]:
    light, opaque = picture.light, np.ones_like(alpha)
    return {
        PICTURE: np.dstack((picture.combined, alpha)),
        DIFFUSE: np.dstack((light.diffuse, opaque)),
        GLOSSY: np.dstack((light.glossy, opaque)),
        VISIBILITY: light.visibility,
    }


def _progress(engine: bpy.types.RenderEngine) -> Callable[[float, str], None]:
    """Return a callback that shows where we are, and ends the work when the user has stopped the render."""
    shown = ""

    def report(fraction: float, text: str) -> None:
        nonlocal shown
        if engine.test_break():
            raise _StoppedError
        engine.update_progress(fraction)
        if text != shown:
            shown = text
            engine.update_stats("", f"Screen-Space Light | {text}")

    return report
