# SPDX-License-Identifier: GPL-3.0-or-later
"""Capture views beyond the frame, so that rays find there what the frame does not show."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import bpy
from mathutils import Matrix

from ..core import Camera, GBuffer
from .engines import Engine
from .gbuffer import GEOMETRY_PASSES, gbuffer_from_passes
from .render_settings import borrow_framing, borrow_passes, borrow_pixel_centers
from .restore import Restorer
from .roughness import borrow_roughness
from .volumes import borrow_clear_air

View = tuple[GBuffer, Camera]


def capture_views(
    engine: Engine,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    cameras: Sequence[Camera],
    *,
    samples: int,
    denoiser: str = "accurate",
    progress: Callable[[float], None],
) -> tuple[tuple[View, ...], float]:
    """Render what some cameras see, geometry and direct light in one render each.

    Volumes are left out, since samples that scatter in the air have no surface; light that crosses them is
    not dimmed then.

    Parameters
    ----------
    engine
        The one that `scene` is set up for: EEVEE moves no sample where it takes them at pixel centres, so one
        render a view is enough for it, too.
    scene
        Set up by `borrow_scene`; exactly as before afterwards, also after an error. Renders with
        `use_persistent_data` make all views but the first cost little more than their samples.
    view_layer
        The one that renders.
    cameras
        With square pixels.
    samples
        Of each pixel, all at its centre.
    denoiser
        Of the light, as in `CaptureOptions`.
    progress
        Called with a fraction before each view; an exception from it ends the capture.

    Returns
    -------
    views
        G-buffers and cameras, in that order.
    seconds
        Wall time.

    Raises
    ------
    SSGIError
        If a size cannot be rendered, or the render was cancelled.
    """
    start = time.perf_counter()
    views = []
    with Restorer() as restorer:
        aimed = borrow_cameras(restorer, scene, cameras)
        # Mirrors show single pixels of the faces, hence the denoiser.
        is_denoised = engine.borrow_light(restorer, scene, view_layer, samples, denoiser)
        borrow_clear_air(restorer, view_layer)
        roughness = borrow_roughness(restorer, view_layer)
        names = (*GEOMETRY_PASSES, *engine.light_passes, *roughness.passes)
        borrow_passes(restorer, view_layer, names)
        for index, _ in enumerate(aimed):
            progress(index / len(cameras))
            rendered = engine.render(scene, view_layer, names)
            gbuffer = gbuffer_from_passes(
                rendered.layers,
                roughness.read(rendered.layers),
                rendered.camera,
                is_denoised=is_denoised,
                emission=None if engine.emission_in_direct else rendered.layers["Emission"],
            )
            views.append((gbuffer, rendered.camera))
    return tuple(views), time.perf_counter() - start


def borrow_cameras(restorer: Restorer, scene: bpy.types.Scene, cameras: Sequence[Camera]) -> Iterator[None]:
    """Let renders show what one camera after the other sees, until `restorer` closes.

    Each step of the iterator goes on to the next of `cameras`, which have square pixels.

    Raises
    ------
    SSGIError
        If a size cannot be rendered; from the iterator.
    """
    thing = _borrow_camera(restorer, scene)
    restorer.change(scene.render, pixel_aspect_x=1.0, pixel_aspect_y=1.0, use_border=False)
    borrow_pixel_centers(restorer, scene)

    def aim() -> Iterator[None]:
        size = None
        for camera in cameras:
            if size != (camera.width, camera.height):
                size = (camera.width, camera.height)
                borrow_framing(restorer, scene, size)
            _aim(thing, camera)
            yield

    return aim()


def _borrow_camera(restorer: Restorer, scene: bpy.types.Scene) -> bpy.types.Object:
    """Give `scene` a camera that sees as near and as far as its own."""
    clip = scene.camera.data
    data = bpy.data.cameras.new("SSGI View")
    restorer.callback(bpy.data.cameras.remove, data)
    data.clip_start, data.clip_end = clip.clip_start, clip.clip_end
    data.sensor_fit = "HORIZONTAL"
    camera = bpy.data.objects.new(data.name, data)
    restorer.callback(bpy.data.objects.remove, camera)
    camera.rotation_mode = "QUATERNION"  # Euler angles lose digits where a view looks straight up
    # Markers of the timeline would put their own cameras back at each render.
    for marker in scene.timeline_markers:
        restorer.change(marker, camera=None)
    restorer.change(scene, camera=camera)
    return camera


def _aim(thing: bpy.types.Object, camera: Camera) -> None:
    """Make a camera of Blender, whose sensor fits horizontally, see what one of the core sees."""
    data = thing.data
    data.type = "ORTHO" if camera.is_orthographic else "PERSP"
    if camera.is_orthographic:
        data.ortho_scale = camera.width / camera.fx
    else:
        data.lens = data.sensor_width * camera.fx / camera.width
    # Shifts are fractions of the width, whichever way they go
    data.shift_x = (0.5 * camera.width - camera.cx) / camera.width
    data.shift_y = (camera.cy - 0.5 * camera.height) / camera.width
    thing.matrix_world = Matrix(camera.world_from_view)
