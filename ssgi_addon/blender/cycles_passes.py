# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a view layer through Cycles and take its passes straight from memory."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import Camera
from ..errors import SSGIError
from ..exr import LONG_NAMES
from .camera import camera_of_render, rendered_region

CYCLES = "CYCLES"  # what `scene.render.engine` and the targets of shader outputs call it

# The switch of every pass that captures ask for; the second kind belongs to Cycles' own settings.
_VIEW_LAYER_SWITCHES = {
    "Depth": "use_pass_z",
    "Position": "use_pass_position",
    "Normal": "use_pass_normal",
    "Diffuse Direct": "use_pass_diffuse_direct",
    "Diffuse Indirect": "use_pass_diffuse_indirect",
    "Diffuse Color": "use_pass_diffuse_color",
    "Glossy Direct": "use_pass_glossy_direct",
    "Glossy Indirect": "use_pass_glossy_indirect",
    "Glossy Color": "use_pass_glossy_color",
    "Transmission Direct": "use_pass_transmission_direct",
    "Transmission Indirect": "use_pass_transmission_indirect",
    "Transmission Color": "use_pass_transmission_color",
    "Emission": "use_pass_emit",
    "Environment": "use_pass_environment",
}
_CYCLES_SWITCHES = {
    "Volume Direct": "use_pass_volume_direct",
    "Volume Indirect": "use_pass_volume_indirect",
}


@dataclass
class RenderedPasses:
    """What one render left in memory.

    Attributes
    ----------
    layers
        Passes by their long names, top row first: ``(H, W, 3)`` without alpha, or ``(H, W)``.
    camera
        Of the rendered region.
    seconds
        Wall time of the render.
    """

    layers: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    camera: Camera | None = None
    seconds: float = 0.0


def pass_switches(names: Iterable[str]) -> tuple[dict[str, bool], dict[str, bool]]:
    """Return the properties of the view layer, and of its Cycles settings, that turn passes on."""
    wanted = set(names)
    return (
        {switch: True for name, switch in _VIEW_LAYER_SWITCHES.items() if name in wanted},
        {switch: True for name, switch in _CYCLES_SWITCHES.items() if name in wanted},
    )


def cycles_device(scene: bpy.types.Scene) -> str:
    """Return what Cycles renders on, "CPU" or "GPU": the former, too, where the preferences name no card."""
    cycles = bpy.context.preferences.addons.get("cycles")
    has_card = cycles is not None and cycles.preferences.has_active_device()
    return "GPU" if scene.cycles.device == "GPU" and has_card else "CPU"


def cycles_engine() -> type[bpy.types.RenderEngine]:
    """Return the class of the Cycles engine.

    Raises
    ------
    SSGIError
        If Cycles is not there.
    """
    for engine in bpy.types.RenderEngine.__subclasses__():
        if getattr(engine, "bl_idname", None) == CYCLES and engine.is_registered:
            return engine
    raise SSGIError("The Cycles render engine is not available: enable it in Preferences > Add-ons.")


def is_capturing() -> bool:
    """Whether the render that goes on is one of `render_passes`."""
    return getattr(cycles_engine().render, "is_capture", False)


def render_passes(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, names: Iterable[str]
) -> RenderedPasses:
    """Render `scene` with the settings that it has and return passes of `view_layer`.

    The passes are read after Cycles has finished and before Blender goes on, which is the only moment
    at which a background Blender gives them away without a file.

    Parameters
    ----------
    scene
        Its engine is Cycles, and one tile holds the frame.
    view_layer
        The one to read; passes must be switched on.
    names
        Passes to read, by their long names.

    Raises
    ------
    SSGIError
        If Blender cannot render the scene, or the render was cancelled.
    """
    rendered = RenderedPasses()
    names = tuple(names)

    def read(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
        is_ours = depsgraph.scene.name == scene.name and depsgraph.view_layer.name == view_layer.name
        if is_ours and not engine.test_break():
            rendered.camera = camera_of_render(engine, depsgraph)
            rendered.layers = read_result(engine, scene, view_layer.name, names)

    start = time.perf_counter()
    _tag_settings(scene)
    with _after_render(cycles_engine(), read):
        try:
            bpy.ops.render.render(scene=scene.name)
        except RuntimeError as error:
            raise render_error(scene, error) from error
    rendered.seconds = time.perf_counter() - start
    if rendered.camera is None:
        raise SSGIError("The render was cancelled: nothing was written, start it again.")
    return rendered


def _tag_settings(scene: bpy.types.Scene) -> None:
    """Let a kept Cycles see its own settings: a change of them alone tags nothing, and it would not look."""
    scene.render.use_compositing = scene.render.use_compositing


@contextmanager
def _after_render(
    engine_class: type[bpy.types.RenderEngine],
    read: Callable[[bpy.types.RenderEngine, bpy.types.Depsgraph], None],
) -> Iterator[None]:
    """Call `read` whenever Cycles has finished a view layer; its exceptions surface here."""
    original = engine_class.render
    failures: list[BaseException] = []

    def render(self: Any, depsgraph: bpy.types.Depsgraph) -> None:
        try:
            original(self, depsgraph)
            read(self, depsgraph)
        except BaseException as error:  # also Ctrl-C: Blender would print it and go on
            # Its frames must not keep the engine alive beyond its render.
            traceback.clear_frames(error.__traceback__)
            failures.append(error)
        finally:
            del self, depsgraph

    render.is_capture = True
    engine_class.render = render
    try:
        yield
    finally:
        engine_class.render = original
    if failures:
        raise failures[0]


def read_result(
    engine: bpy.types.RenderEngine, scene: bpy.types.Scene, layer_name: str, names: tuple[str, ...]
) -> dict[str, NDArray[np.float32]]:
    """Return passes of a view layer that `engine` has just rendered, as in `RenderedPasses.layers`."""
    result = engine.get_result()
    width, height = result.resolution_x, result.resolution_y
    if (width, height) != rendered_region(scene)[2:]:
        raise RuntimeError(f"Cycles returned {width} x {height} pixels, not {rendered_region(scene)[2:]}")
    layers = {}
    for render_pass in result.layers[layer_name].passes:
        name = LONG_NAMES.get(render_pass.name, render_pass.name)
        if name in names:
            layers[name] = _top_first(_pixels(render_pass, height, width))
    missing = [name for name in names if name not in layers]
    if missing:
        raise RuntimeError(f"Cycles returned no pass {', '.join(missing)}")
    return layers


def read_alpha(engine: bpy.types.RenderEngine, layer_name: str) -> NDArray[np.float32]:
    """Return the opacity (H, W) of a view layer's picture, top row first."""
    result = engine.get_result()
    combined = result.layers[layer_name].passes["Combined"]
    return np.ascontiguousarray(_pixels(combined, result.resolution_y, result.resolution_x)[::-1, :, 3])


def write_result(
    engine: bpy.types.RenderEngine, layer_name: str, images: Mapping[str, NDArray[np.float32]]
) -> None:
    """Fill passes that `engine` has rendered, before Blender takes them from it.

    Parameters
    ----------
    engine
        Inside its ``render`` method.
    layer_name
        Of the view layer.
    images
        By the names of the passes, top row first: values ``(H, W)``, colours with alpha ``(H, W, 4)``, or
        without, ``(H, W, 3)``, where the pass keeps its own.

    Raises
    ------
    SSGIError
        If a pass is missing or has another number of channels, since a user's own has the name.
    """
    passes = {render_pass.name: render_pass for render_pass in engine.get_result().layers[layer_name].passes}
    for name, image in images.items():
        channels = 1 if image.ndim == 2 else 4
        if name not in passes or passes[name].channels != channels:
            kind = "value" if channels == 1 else "color"
            raise SSGIError(
                f"View layer '{layer_name}' has no {kind} output '{name}' to fill: rename other outputs of "
                "that name in View Layer properties > Passes > Shader AOV, and switch In Renders off and on."
            )
    for name, image in images.items():
        height, width = image.shape[:2]
        planes = _pixels(passes[name], height, width)
        bottom_first = image[::-1].reshape(height, width, -1)
        planes[..., : bottom_first.shape[2]] = bottom_first
        passes[name].rect.foreach_set(planes.reshape(-1))


def _pixels(render_pass: bpy.types.RenderPass, height: int, width: int) -> NDArray[np.float32]:
    """Return a pass as Blender has it, bottom row first, (H, W, channels)."""
    pixels = np.empty(width * height * render_pass.channels, dtype=np.float32)
    render_pass.rect.foreach_get(pixels)
    return pixels.reshape(height, width, render_pass.channels)


def _top_first(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Flip Cycles' bottom row to the end; drop alpha and the axis of single values."""
    flipped = pixels[::-1, :, 0] if pixels.shape[2] == 1 else pixels[::-1, :, :3]
    return np.ascontiguousarray(flipped)


def render_error(scene: bpy.types.Scene, error: RuntimeError) -> SSGIError:
    """Turn what Blender's render operator raised into one line."""
    reason = str(error).strip().removeprefix("Error: ").splitlines()[0]
    return SSGIError(f"Blender could not render scene '{scene.name}': {reason}")
