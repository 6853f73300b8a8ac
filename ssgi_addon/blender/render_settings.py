# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings that every render of ours borrows from the user's scene."""

from __future__ import annotations

import bpy

from ..errors import SSGIError
from . import compat
from .camera import check_camera, full_size, rendered_region
from .cycles_passes import CYCLES, cycles_engine, pass_switches
from .restore import Restorer

# Cycles hands its passes over in memory only if one tile holds the frame, and its tiles end here.
LARGEST_TILE_PX = 8192
# What OpenImageDenoise cleans with: the filter's quality, and whether albedo and normals are cleaned before,
# or along with the picture ("FAST"). With "NONE" it takes them for clean, and keeps their noise.
_DENOISERS = {
    "fast": {"denoising_quality": "FAST", "denoising_prefilter": "FAST"},
    "accurate": {"denoising_quality": "HIGH", "denoising_prefilter": "ACCURATE"},
}
_SMALLEST_RESOLUTION_PX = 4  # of Blender's resolution property


def borrow_scene(
    restorer: Restorer,
    scene: bpy.types.Scene,
    *,
    resolution: tuple[int, int] | None = None,
    frame: int | None = None,
    view_layer: str | None = None,
    engine_id: str = CYCLES,
) -> bpy.types.ViewLayer:
    """Set `scene` up for renders whose passes are read, until `restorer` closes.

    Parameters
    ----------
    restorer
        Puts everything back.
    scene
        The scene to render; its own engine may be another one.
    resolution
        Width and height of the whole frame, pixels; None means the scene's.
    frame
        Frame number; None means the current one.
    view_layer
        Name; None means the active one, or the first that renders.
    engine_id
        What ``scene.render.engine`` calls the engine that renders.

    Returns
    -------
    bpy.types.ViewLayer
        The only one that renders now.

    Raises
    ------
    SSGIError
        If Cycles (where it renders), a usable camera, the view layer or a pixel to render is missing, or a
        render of Blender's runs.
    """
    obstacle = render_obstacle()
    if obstacle:
        raise SSGIError(f"{obstacle}.")
    if engine_id == CYCLES:
        cycles_engine()
    layer = find_view_layer(scene, view_layer)
    restorer.callback(compat.update_render_layers_nodes, layer)
    if frame is not None:
        _go_to_frame(restorer, scene, frame)
    check_camera(scene)
    restorer.change(
        scene.render,
        engine=engine_id,
        use_compositing=False,
        use_sequencer=False,
        use_freestyle=False,
    )
    borrow_framing(restorer, scene, resolution)
    for other in scene.view_layers:
        restorer.change(other, use=other == layer)
    if engine_id == CYCLES:
        restorer.change(
            scene.cycles,
            use_adaptive_sampling=False,
            use_layer_samples="IGNORE",
            use_sample_subset=False,
            time_limit=0.0,
            use_fast_gi=False,
            # What it has learned goes on from frame to frame where Cycles' scene is kept
            use_guiding=False,
        )
    return layer


def borrow_kept_data(restorer: Restorer, scene: bpy.types.Scene, engine: str) -> None:
    """Let Cycles build anew from frame to frame what has changed alone; `engine` as in `JobOptions`."""
    if engine == "cycles":
        restorer.change(scene.render, use_persistent_data=True)


def render_obstacle() -> str | None:
    """Return why no render of ours may begin in this process; None if it may."""
    if _is_rendering():
        # A second one in the same process crashes Blender
        return "Blender is rendering: wait for it, or stop it"
    return None


def _is_rendering() -> bool:
    return bool(bpy.app.is_job_running("RENDER"))


def borrow_bounces(restorer: Restorer, scene: bpy.types.Scene) -> None:
    """Let Cycles' light bounce where the scene has bounces switched off: it takes that light from us.

    Diffuse and glossy bounces of 0 become Cycles' own defaults; what the scene had before is not known.
    """
    for name in ("diffuse_bounces", "glossy_bounces"):
        if not getattr(scene.cycles, name):
            restorer.change(scene.cycles, **{name: scene.cycles.bl_rna.properties[name].default})


def borrow_framing(restorer: Restorer, scene: bpy.types.Scene, resolution: tuple[int, int] | None) -> None:
    """Let renders return the whole frame, or its cropped border; None keeps the resolution.

    Cycles renders it in one tile.

    Raises
    ------
    SSGIError
        If no pixel is left to render, or more than a tile holds.
    """
    if resolution is not None:
        width, height = resolution
        if width < 1 or height < 1:
            raise SSGIError(f"Resolution {width} x {height} has no pixels: give at least 1 x 1.")
        refuse_more_than_a_tile(resolution)  # the properties would cut it off without a word
        # Sizes below the smallest that the property takes are a percentage of larger ones.
        scale = 1 if min(width, height) >= _SMALLEST_RESOLUTION_PX else _SMALLEST_RESOLUTION_PX
        restorer.change(
            scene.render,
            resolution_x=width * scale,
            resolution_y=height * scale,
            resolution_percentage=100 // scale,
        )
    if not scene.render.use_crop_to_border:
        # Without crop Blender renders part of the frame and leaves the rest empty; rays need the whole.
        restorer.change(scene.render, use_border=False)
    width, height = rendered_region(scene)[2:]
    if width < 1 or height < 1:
        raise SSGIError(
            f"Scene '{scene.name}' renders {width} x {height} pixels: raise the resolution or its "
            "percentage, or widen the render border, in Output properties > Format."
        )
    refuse_more_than_a_tile(full_size(scene))
    if scene.render.engine == CYCLES:
        restorer.change(
            scene.cycles, tile_size=max(scene.cycles.tile_size, *full_size(scene)), use_auto_tile=False
        )


def borrow_pixel_centers(restorer: Restorer, scene: bpy.types.Scene) -> None:
    """Send every sample through the centre of its pixel, from one point and at one moment."""
    if scene.render.engine == CYCLES:
        # The narrowest filter; a box filter would ignore its width.
        restorer.change(scene.cycles, pixel_filter_type="BLACKMAN_HARRIS", filter_width=0.01)
    else:
        restorer.change(scene.render, filter_size=0.0)  # EEVEE then moves no sample at all
    restorer.change(scene.render, use_motion_blur=False)
    restorer.change(scene.camera.data.dof, use_dof=False)


def borrow_denoiser(
    restorer: Restorer, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, denoiser: str
) -> bool:
    """Switch Cycles' denoiser off ("none") or on; return whether it will run, since some builds have none."""
    denoises = denoiser != "none" and compat.has_denoiser(scene)
    restorer.change(scene.cycles, use_denoising=denoises)
    if denoises:
        restorer.change(view_layer.cycles, use_denoising=True)
        restorer.change(scene.cycles, **_DENOISERS[denoiser])
    return denoises


def borrow_passes(restorer: Restorer, view_layer: bpy.types.ViewLayer, names: tuple[str, ...]) -> None:
    """Switch passes of `view_layer` on. None is switched off, so that no link of a compositor is lost."""
    of_layer, of_cycles = pass_switches(names)
    restorer.change(view_layer, **of_layer)
    if of_cycles:
        restorer.change(view_layer.cycles, **of_cycles)


def refuse_more_than_a_tile(size: tuple[int, int]) -> None:
    """Raise SSGIError where a frame of that width and height is more than Cycles hands over in memory."""
    if max(size) > LARGEST_TILE_PX:
        raise SSGIError(
            f"{size[0]} x {size[1]} pixels are more than a render returns in one piece: "
            f"render at most {LARGEST_TILE_PX} pixels a side."
        )


def find_view_layer(scene: bpy.types.Scene, name: str | None = None) -> bpy.types.ViewLayer:
    """Return the view layer of that name; None means the active one, or the first that renders.

    Raises
    ------
    SSGIError
        If there is none of that name.
    """
    if name is not None:
        layer = scene.view_layers.get(name)
        if layer is None:
            known = ", ".join(f"'{other.name}'" for other in scene.view_layers)
            raise SSGIError(f"Scene '{scene.name}' has no view layer '{name}': choose one of {known}.")
        return layer
    active = bpy.context.view_layer
    if bpy.context.scene == scene and active is not None and active.use:
        return active
    return next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])


def _go_to_frame(restorer: Restorer, scene: bpy.types.Scene, frame: int) -> None:
    if (scene.frame_current, scene.frame_subframe) == (frame, 0.0):
        return
    # Markers may bind other cameras to other frames; undone last, when the frame is back.
    camera = scene.camera
    restorer.callback(lambda: setattr(scene, "camera", camera))
    restorer.callback(scene.frame_set, scene.frame_current, subframe=scene.frame_subframe)
    scene.frame_set(frame)
