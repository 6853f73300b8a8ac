# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's camera, as a running render sees it, to the camera of the core."""

from __future__ import annotations

import math

import bpy
import numpy as np

from ..core import Camera
from ..errors import SSGIError

# How far from a right angle the camera's axes may be (sine): beyond it pixels move visibly.
_LARGEST_SHEAR = 1e-4


def check_camera(scene: bpy.types.Scene) -> None:
    """Refuse cameras whose picture cannot be traced in.

    Raises
    ------
    SSGIError
        If there is no camera, or it is panoramic or defined by a script, or the scene is stereoscopic.
    """
    camera = scene.camera
    if camera is None:
        raise SSGIError(f"Scene '{scene.name}' has no camera: set one in Scene properties > Camera.")
    if camera.type != "CAMERA":
        raise SSGIError(
            f"'{camera.name}' is used as the camera of '{scene.name}' but is a "
            f"{camera.type.lower()} object: set a camera object in Scene properties > Camera."
        )
    if camera.data.type not in {"PERSP", "ORTHO"}:
        kind = "panoramic" if camera.data.type == "PANO" else camera.data.type.lower()
        raise SSGIError(
            f"Camera '{camera.name}' is {kind}: screen-space light needs a perspective or "
            "orthographic camera, set it in Camera properties > Lens > Type."
        )
    if scene.render.use_multiview:
        raise SSGIError(
            f"Scene '{scene.name}' renders stereoscopic views: switch off Output properties > Stereoscopy."
        )


def camera_obstacle(scene: bpy.types.Scene) -> str | None:
    """Return why the picture of the camera cannot be traced in, and what to do about it; None if it can."""
    try:
        check_camera(scene)
    except SSGIError as error:
        return str(error).removesuffix(".")
    return None


def camera_of_render(engine: bpy.types.RenderEngine | None, depsgraph: bpy.types.Depsgraph) -> Camera:
    """Describe the camera of the render that is being carried out.

    Parameters
    ----------
    engine
        The render engine, inside its ``render`` method: it knows the camera's pose without scale. None for
        EEVEE, which is no Python class.
    depsgraph
        The one that renders.

    Returns
    -------
    Camera
        Of the rendered region: with crop to border its optical axis lies off the image's centre
        accordingly.

    Raises
    ------
    SSGIError
        If the camera's axes are not at right angles.
    """
    scene = depsgraph.scene
    camera = scene.camera.evaluated_get(depsgraph)
    width, height = full_size(scene)
    left, top, region_width, region_height = rendered_region(scene)
    projection = np.array(
        camera.calc_matrix_camera(
            depsgraph,
            x=width,
            y=height,
            scale_x=scene.render.pixel_aspect_x,
            scale_y=scene.render.pixel_aspect_y,
        ),
        dtype=np.float64,
    )

    # Where the optical axis (0, 0, -1) meets the full frame, pixels from the top left corner.
    is_orthographic = camera.data.type == "ORTHO"
    axis_ndc = projection[:2, 3] if is_orthographic else -projection[:2, 2]
    axis_x_px = 0.5 * width * (1.0 + axis_ndc[0])
    axis_y_px = 0.5 * height * (1.0 - axis_ndc[1])
    shift_px = (axis_x_px - left - 0.5 * region_width, axis_y_px - top - 0.5 * region_height)

    fx = 0.5 * width * projection[0, 0]
    fy = 0.5 * height * projection[1, 1]
    common = {"shift_px": shift_px, "pixel_aspect": fy / fx, "world_from_view": _pose(engine, camera)}
    if is_orthographic:
        return Camera.orthographic(region_width, region_height, region_width / fx, **common)
    return Camera.perspective(region_width, region_height, 2.0 * math.atan(0.5 * region_width / fx), **common)


def full_size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height of the whole frame in pixels, rounded down as Blender does."""
    render = scene.render
    return (
        render.resolution_x * render.resolution_percentage // 100,
        render.resolution_y * render.resolution_percentage // 100,
    )


def rendered_region(scene: bpy.types.Scene) -> tuple[int, int, int, int]:
    """Left, top, width and height in pixels of the part of the frame that a render returns."""
    render = scene.render
    width, height = full_size(scene)
    if not (render.use_border and render.use_crop_to_border):
        return 0, 0, width, height
    # Blender multiplies in single precision and cuts off.
    edges_x = np.array((render.border_min_x, render.border_max_x), dtype=np.float32) * np.float32(width)
    edges_y = np.array((render.border_min_y, render.border_max_y), dtype=np.float32) * np.float32(height)
    left, right = (int(edge) for edge in edges_x)
    bottom, top = (int(edge) for edge in edges_y)
    return left, height - top, right - left, top - bottom


def _pose(engine: bpy.types.RenderEngine | None, camera: bpy.types.Object) -> np.ndarray:
    """World from view without scale, from the matrix that the engine itself places the camera with."""
    matrix = camera.matrix_world.normalized() if engine is None else engine.camera_model_matrix(camera)
    pose = np.array(matrix, dtype=np.float64)
    axes = pose[:3, :3] / np.linalg.norm(pose[:3, :3], axis=0)
    shear = np.abs(axes.T @ axes - np.eye(3)).max()
    if not shear < _LARGEST_SHEAR:
        raise SSGIError(
            f"Camera '{camera.name}' is sheared by the scale of its parents: apply their scale "
            "(Object > Apply > Scale)."
        )
    pose[:3, :3] = axes
    return pose
