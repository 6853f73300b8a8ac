# SPDX-License-Identifier: GPL-3.0-or-later
"""Capture what surrounds the camera, so that rays which leave the frame find surfaces there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core import Camera, GBuffer
from .engines import Engine
from .gbuffer import GEOMETRY_PASSES, gbuffer_from_passes
from .render_settings import borrow_framing, borrow_passes, borrow_pixel_centers
from .restore import Restorer
from .roughness import borrow_roughness
from .volumes import borrow_clear_air

View = tuple[GBuffer, Camera]
FloatArray = NDArray[np.float64]

# Where each face looks and what is up in it, in the space of the view that it surrounds.
FACES = {
    "front": ((0, 0, -1), (0, 1, 0)),
    "right": ((1, 0, 0), (0, 1, 0)),
    "left": ((-1, 0, 0), (0, 1, 0)),
    "back": ((0, 0, 1), (0, 1, 0)),
    "up": ((0, 1, 0), (0, 0, 1)),
    "down": ((0, -1, 0), (0, 0, -1)),
}


def capture_surround(
    engine: Engine,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    world_from_view: FloatArray,
    *,
    size: int,
    samples: int,
    denoise: bool = True,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[tuple[View, ...], float]:
    """Render the six faces of a cube around a place, geometry and direct light in one render each.

    Volumes are left out, since samples that scatter in the air have no surface; light that crosses them is
    not dimmed then.

    Parameters
    ----------
    engine
        The one that `scene` is set up for: EEVEE moves no sample where it takes them at pixel centres, so one
        render a face is enough for it, too.
    scene
        Set up by `borrow_scene`; exactly as before afterwards, also after an error. Renders with
        `use_persistent_data` make all faces but the first cost little more than their samples.
    view_layer
        The one that renders.
    world_from_view : (4, 4)
        The cube's middle and orientation: its front face looks where a camera of this pose looks.
    size
        Width and height of a face, pixels.
    samples
        Of each pixel, all at its centre.
    denoise
        Denoise the light where this build of Blender has a denoiser.
    progress
        Called with a fraction and a text before each face; an exception from it ends the capture.

    Returns
    -------
    views
        G-buffer and camera of each of `FACES`, in that order.
    seconds
        Wall time.

    Raises
    ------
    SSGIError
        If `size` cannot be rendered, or the render was cancelled.
    """
    start = time.perf_counter()
    views = []
    with Restorer() as restorer:
        faces = borrow_faces(restorer, scene, world_from_view, size)
        # Mirrors show single pixels of the faces, hence the denoiser.
        is_denoised = engine.borrow_light(restorer, scene, view_layer, samples=samples, denoise=denoise)
        borrow_clear_air(restorer, view_layer)
        roughness = borrow_roughness(restorer, view_layer)
        names = tuple({*GEOMETRY_PASSES, *engine.light_passes, *roughness.passes})
        borrow_passes(restorer, view_layer, names)
        for index, _ in enumerate(faces):
            if progress is not None:
                progress(index / len(FACES), "Surround")
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


def borrow_faces(
    restorer: Restorer, scene: bpy.types.Scene, world_from_view: FloatArray, size: int
) -> Iterator[None]:
    """Let renders show one face after the other, `size` pixels wide, until `restorer` closes.

    Each step of the iterator turns the camera to the next of `FACES`.

    Raises
    ------
    SSGIError
        If `size` cannot be rendered.
    """
    camera = _borrow_camera(restorer, scene)
    restorer.change(scene.render, pixel_aspect_x=1.0, pixel_aspect_y=1.0, use_border=False)
    borrow_framing(restorer, scene, (size, size))
    borrow_pixel_centers(restorer, scene)

    def turn() -> Iterator[None]:
        for forward, up in FACES.values():
            camera.matrix_world = Matrix(world_from_view @ _turn(forward, up))
            yield

    return turn()


def surround_pose(camera: Camera, nearest_depth: float, clip_start: float) -> FloatArray:
    """Return the pose of the surround that answers for rays which leave a frame.

    A perspective frame is surrounded from its camera's place. An orthographic camera may stand anywhere on
    its axis, often far outside; there the surround goes to the middle of the frame, as far ahead as its
    front face still holds what the frame shows. Everything up to the nearest surface is empty space.

    Parameters
    ----------
    camera
        The frame's.
    nearest_depth
        Of the frame's surfaces, scene units; not finite where it shows none.
    clip_start
        Depth before which the frame shows nothing, scene units.
    """
    pose = camera.world_from_view.copy()
    if camera.is_orthographic:
        stand_off = 0.5 * max(camera.width / camera.fx, camera.height / camera.fy)
        ahead = max(clip_start, nearest_depth - stand_off) if np.isfinite(nearest_depth) else clip_start
        place_vs = camera.pixel_to_view(
            np.float64(0.5 * camera.width), np.float64(0.5 * camera.height), np.float64(ahead)
        )
        pose[:3, 3] += pose[:3, :3] @ place_vs
    return pose


def _borrow_camera(restorer: Restorer, scene: bpy.types.Scene) -> bpy.types.Object:
    """Give `scene` a camera of 90 degrees that sees as near and as far as its own."""
    clip = scene.camera.data
    data = bpy.data.cameras.new("SSGI Surround")
    restorer.callback(bpy.data.cameras.remove, data)
    data.clip_start, data.clip_end = clip.clip_start, clip.clip_end
    data.sensor_fit = "HORIZONTAL"
    data.lens = 0.5 * data.sensor_width
    camera = bpy.data.objects.new(data.name, data)
    restorer.callback(bpy.data.objects.remove, camera)
    camera.rotation_mode = "QUATERNION"  # Euler angles lose digits where a face looks straight up
    # Markers of the timeline would put their own cameras back at each render.
    for marker in scene.timeline_markers:
        restorer.change(marker, camera=None)
    restorer.change(scene, camera=camera)
    return camera


def _turn(forward: tuple[int, int, int], up: tuple[int, int, int]) -> FloatArray:
    """Return the (4, 4) rotation of a view that looks along `forward`."""
    turn = np.eye(4)
    turn[:3, :3] = np.column_stack([np.cross(forward, up), up, np.negative(forward)])
    return turn
