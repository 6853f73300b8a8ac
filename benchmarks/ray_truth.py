# SPDX-License-Identifier: GPL-3.0-or-later
"""What some of the diffuse pass's own rays hit in the scene's true geometry, cast once and kept.

Run ``python -m benchmarks.ray_truth NAME WIDTHxHEIGHT [RAYS]`` to cast ahead; it prints how far the captured
depth and the geometry agree, and how long a ray takes.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.cycles_truth import captured_frame, frame_path, open_scene
from benchmarks.inputs import CACHE, Size, parse_size, run_module
from ssgi_addon.core import Camera, Settings
from ssgi_addon.core.frame_points import surface_points
from ssgi_addon.core.planner import is_colored
from ssgi_addon.core.sampling import cosine_directions, sample_square
from ssgi_addon.core.types import BoolArray, FloatArray, IntArray
from ssgi_addon.files import replacing
from ssgi_addon.frame import CapturedFrame

RAYS = 4000
# Goes up where frames or what is kept change.
_VERSION = 1
_SEED = 1
# Casts begin this far above the surface, relative to depth. Cycles' sample lies up to 0.005 pixels off the
# centre, which lifts or sinks the point by 2e-5 of its depth at 480 pixels width.
_LIFT = 1e-4
# Captured depth and geometry agree within this, relative.
DEPTH_AGREES = 1e-3


@dataclass(frozen=True, eq=False)
class RayTruth:
    """Diffuse rays of a frame and what they truly hit first; rows of vectors are components.

    Attributes
    ----------
    pixel, sample : (N,) int64
        Where each ray starts, and which of the pixel's rays it is.
    origin_vs, direction_vs : (3, N) float32
        As the diffuse pass traces it.
    distance : (N,) float64
        From the origin to the first hit; +inf for the sky.
    normal_vs : (3, N) float64
        Of the plane of the triangle that was hit, turned toward the ray; zero for the sky.
    is_cut_out : (N,) bool
        The triangle's material is transparent in places, so that the true hit may lie farther on.
    is_sound : (N,) bool
        The geometry under the pixel is what was captured, and the ray leaves its plane upward: the shading
        normal allows others, of which Cycles takes none.
    depth_agrees : (H, W) bool
        Pixels whose captured depth is that of the geometry under their centre, or both are sky.
    """

    pixel: IntArray
    sample: IntArray
    origin_vs: FloatArray
    direction_vs: FloatArray
    distance: FloatArray
    normal_vs: FloatArray
    is_cut_out: BoolArray
    is_sound: BoolArray
    depth_agrees: BoolArray

    @property
    def counts(self) -> BoolArray:
        """(N,) rays whose truth is certain."""
        return self.is_sound & ~self.is_cut_out


def ray_truth(name: str, size: Size, count: int = RAYS) -> RayTruth:
    """Return rays and what they hit, cast in a process of its own where they are not kept yet.

    Parameters
    ----------
    name
        Of a real scene.
    size
        Width and height of its frame, pixels.
    count
        Rays.
    """
    path = _path(name, size, count)
    if not path.is_file():
        # Blender stays out of this process, also where the frame has to be captured first
        captured_frame(name, size)
        run_module("benchmarks.ray_truth", name, f"{size[0]}x{size[1]}", str(count))
    with np.load(path) as kept:
        return RayTruth(**kept)


def draw_rays(frame: CapturedFrame, count: int) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return pixels, samples, origins and directions of a random part of the rays of the ``final`` preset.

    Parameters
    ----------
    frame
        Its surfaces with a diffuse colour send the rays.
    count
        How many; all of them where there are fewer.
    """
    settings = Settings.preset("final")
    rays, gbuffer = settings.diffuse.rays, frame.gbuffer
    sends = np.flatnonzero(~gbuffer.is_background & is_colored(gbuffer.albedo))
    random = np.random.default_rng(_SEED)
    # In the order of the pixels
    chosen = np.sort(random.choice(sends.size * rays, min(count, sends.size * rays), replace=False))
    pixel, sample = sends.take(chosen // rays), chosen % rays
    origin, normal = surface_points(gbuffer, frame.camera, pixel)
    u, v = sample_square(pixel, frame.camera.width, rays, settings.seed, gbuffer.depth.dtype)
    direction = cosine_directions(u, v, normal)[:, sample, np.arange(pixel.size)]
    return pixel, sample, origin, direction


def _path(name: str, size: Size, count: int) -> Path:
    return CACHE / f"rays{_VERSION}_{frame_path(name, size).stem}_{count}.npz"


def _keep(name: str, size: Size, count: int) -> None:
    from benchmarks.scene_geometry import show_as_rendered, world_triangles

    frame = captured_frame(name, size)
    camera, gbuffer = frame.camera, frame.gbuffer
    pose = camera.world_from_view
    scene = open_scene(name)
    show_as_rendered(scene)
    seen = world_triangles("camera")
    origin, direction = _camera_rays(camera, scene.camera.data.clip_start)
    distance, triangle = seen.first_hits(*_to_world(pose, origin, direction))
    depth_agrees = _agree(gbuffer.depth, scene.camera.data.clip_start + distance).reshape(-1)
    under_ws = seen.normals[triangle]

    pixel, sample, origin, direction = draw_rays(frame, count)
    _, normal = surface_points(gbuffer, camera, pixel)
    scale = camera.width / camera.fx if camera.is_orthographic else gbuffer.depth.reshape(-1).take(pixel)
    lifted_ws, direction_ws = _to_world(pose, origin + normal * (_LIFT * scale), direction)
    triangles = world_triangles("diffuse")
    distance, triangle = triangles.first_hits(lifted_ws, direction_ws)

    # A plane has two sides; the upper one is the camera's
    def turned(normal_ws: FloatArray, against_ws: FloatArray) -> FloatArray:
        return normal_ws * -np.sign((normal_ws * against_ws).sum(axis=1, keepdims=True))

    _, view_ws = _to_world(pose, *(rays[:, pixel] for rays in _camera_rays(camera, 1.0)))
    is_upward = (turned(under_ws[pixel], view_ws) * direction_ws).sum(axis=1) > 0.0
    truth = RayTruth(
        pixel=pixel,
        sample=sample,
        origin_vs=origin,
        direction_vs=direction,
        distance=distance,
        normal_vs=np.ascontiguousarray((turned(triangles.normals[triangle], direction_ws) @ pose[:3, :3]).T),
        is_cut_out=triangles.is_cut_out[triangle],
        is_sound=depth_agrees[pixel] & is_upward,
        depth_agrees=depth_agrees.reshape(gbuffer.shape),
    )
    with replacing(_path(name, size, count)) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **vars(truth))
    agree, counts = depth_agrees.mean(), truth.counts.mean()
    print(f"{name}: depth agrees at {agree:.2%} of the pixels, {counts:.1%} of the rays count")


def _camera_rays(camera: Camera, near: float) -> tuple[FloatArray, FloatArray]:
    """Return origins at depth `near` and directions (3, H*W) through the pixels' centres, one unit deep."""
    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    at, beyond = (
        camera.pixel_to_view(column + 0.5, row + 0.5, np.float64(depth)).T for depth in (near, near + 1.0)
    )
    return at, beyond - at


def _to_world(pose: FloatArray, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return world-space origins and directions (N, 3) of view-space ones (3, N)."""
    return origin.T @ pose[:3, :3].T + pose[:3, 3], direction.T @ pose[:3, :3].T


def _agree(captured: FloatArray, true: FloatArray) -> BoolArray:
    """Return (H, W) where two depths are near each other, or both are that of the sky."""
    captured, true = captured.astype(np.float64), true.reshape(captured.shape)
    with np.errstate(invalid="ignore"):
        return (np.abs(true - captured) <= DEPTH_AGREES * captured) | (true == captured)


def main() -> None:
    """Cast the rays of one frame."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("size", type=parse_size)
    parser.add_argument("rays", type=int, nargs="?", default=RAYS)
    arguments = parser.parse_args()
    from ssgi_addon.bpy_module import require_bpy

    require_bpy()
    _keep(arguments.name, arguments.size, arguments.rays)


if __name__ == "__main__":
    main()
