# SPDX-License-Identifier: GPL-3.0-or-later
"""What single precision changes: the passes in float32 beside the same code in float64, on real scenes.

Both runs get the same numbers and draw the same samples, so each ray has a twin. Where twins end differently
the light differs by a whole ray; everywhere else by rounding alone. Run from the repository's root:

    python -m benchmarks.stability [--scenes NAME ...] [--size 320x180] [--output FILE.json]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import record
from benchmarks.inputs import CACHE, SCENES, Size, kept_frame, parse_size
from ssgi_addon.core import Camera, Environment, GBuffer, Settings, render_indirect
from ssgi_addon.core.answers import Answers
from ssgi_addon.core.scene import TraceScene, View
from ssgi_addon.core.tracer import HIT
from ssgi_addon.passes import write_passes

NAMES = ("living_room", "classroom", "lamborghini", "bathroom")
IMAGES = ("diffuse", "glossy", "visibility", "known")
METHODS = ("hemisphere", "horizon", "bitmask", "ssao")
# Differences are relative to a pixel's value, or to this share of the image's mean where it is darker.
DARKEST = 0.01
# Twins whose distances differ by more than this part met something else; else they met it in another pixel.
SAME_DISTANCE = 0.01
PERCENTILE = 99.9
APART = 1e-2
# Pixels that a filter carries the light of a ray to, in each direction.
FILTER_REACH = 15
_SAMPLES = 8


@dataclass(frozen=True, eq=False)
class RayEnds:
    """How the rays of one call of `TraceScene.answer` ended, and the pixel of the frame that each left.

    `pixel` is None for rays that start on other views.
    """

    pixel: np.ndarray | None
    status: np.ndarray
    texel: np.ndarray
    distance: np.ndarray


def in_double(gbuffer: GBuffer) -> GBuffer:
    """Return the same numbers in float64, which the passes then compute in."""
    double = object.__new__(GBuffer)
    for item in fields(GBuffer):
        value = getattr(gbuffer, item.name)
        if isinstance(value, np.ndarray):
            value = value.astype(np.float64)
        elif isinstance(value, GBuffer):
            value = in_double(value)
        object.__setattr__(double, item.name, value)
    return double


@contextmanager
def recorded_rays() -> Iterator[list[RayEnds]]:
    """Keep how all rays end that are traced meanwhile, in this thread alone."""
    calls: list[RayEnds] = []
    answer = TraceScene.answer

    def recording(
        self: TraceScene, origin_vs: Any, direction_vs: Any, home: int = 0, *rest: Any, **named: Any
    ) -> Answers:
        found = answer(self, origin_vs, direction_vs, home, *rest, **named)
        pixel = None
        if home == 0:
            camera = self.views[0].camera
            x, y, _ = camera.view_to_pixel(np.asarray(origin_vs, dtype=np.float64).T)
            pixel = np.floor(y).astype(np.int64) * camera.width + np.floor(x).astype(np.int64)
        calls.append(RayEnds(pixel, found.status.copy(), found.texel.copy(), found.distance.copy()))
        return found

    TraceScene.answer = recording  # type: ignore[method-assign]
    try:
        yield calls
    finally:
        TraceScene.answer = answer  # type: ignore[method-assign]


def compare_precisions(
    gbuffer: GBuffer,
    camera: Camera,
    settings: Settings,
    environment: Environment | None = None,
    views: Sequence[View] = (),
) -> dict[str, Any]:
    """Return what float32 changes of a frame's light.

    Returns
    -------
    dict
        ``rays``; ``changed``, the share of rays that met something else, and ``moved``, of those that met
        another pixel or something else; ``images``: for each image its ``percentile`` of the relative
        difference, the ``largest``, and the share of those that are ``apart`` by more than 1e-2, over surface
        pixels near which no ray has moved (in the pixel itself, or within the filter's reach); and the
        relative difference of the ``mean`` of all pixels.
    """
    settings = replace(settings, threads=1)
    lights, ends = [], []
    for is_double in (False, True):
        convert = in_double if is_double else (lambda frame: frame)
        sky = environment
        if is_double and sky is not None:
            sky = replace(sky, image=sky.image.astype(np.float64))
        placed = [(convert(shown), view) for shown, view in views]
        with recorded_rays() as calls:
            lights.append(render_indirect(convert(gbuffer), camera, settings, sky, placed))
        ends.append(calls)
    is_surface = ~gbuffer.is_background
    is_moved, counts = _compare_rays(*ends, gbuffer.shape)
    if settings.diffuse.filter or settings.reflections.filter:
        is_moved = _around(is_moved, FILTER_REACH)
    images = {
        name: _compare_images(*(getattr(light, name) for light in lights), is_surface, is_moved)
        for name in IMAGES
    }
    return {**counts, "images": images}


def _compare_rays(
    single: list[RayEnds], double: list[RayEnds], shape: tuple[int, int]
) -> tuple[np.ndarray, dict[str, float]]:
    """Return the pixels (H, W) that have rays which moved, and the shares of those that moved or changed."""
    is_moved = np.zeros(shape, dtype=bool)
    rays = moved = changed = 0
    for one, other in zip(single, double, strict=True):
        is_other = (one.status != other.status) | (one.texel != other.texel)
        is_far = one.status != other.status
        both = np.flatnonzero((one.status == HIT) & (other.status == HIT))
        off = np.abs(one.distance.take(both) - other.distance.take(both))
        is_far[both] = off > SAME_DISTANCE * other.distance.take(both)
        rays, moved, changed = rays + is_other.size, moved + int(is_other.sum()), changed + int(is_far.sum())
        if one.pixel is not None:
            is_moved.reshape(-1)[one.pixel[is_other]] = True
    return is_moved, {"rays": rays, "changed": changed / max(rays, 1), "moved": moved / max(rays, 1)}


def _around(is_moved: np.ndarray, reach: int) -> np.ndarray:
    """Return the pixels (H, W) that are so near to one of some."""
    for axis in (0, 1):
        padding = [(reach + 1, reach) if axis == other else (0, 0) for other in (0, 1)]
        until = np.cumsum(np.pad(is_moved, padding), axis=axis)
        size, side = is_moved.shape[axis], 2 * reach + 1
        after, before = (np.take(until, np.arange(size) + shift, axis=axis) for shift in (side, 0))
        is_moved = after > before
    return is_moved


def _compare_images(
    single: np.ndarray, double: np.ndarray, is_surface: np.ndarray, is_moved: np.ndarray
) -> dict[str, float]:
    assert single.dtype == np.float32, single.dtype
    assert double.dtype == np.float64, double.dtype
    mean = float(double[is_surface].mean()) if is_surface.any() else 0.0
    if mean == 0.0:
        return dict.fromkeys(("percentile", "largest", "apart", "mean"), 0.0)
    off = np.abs(single - double) / np.maximum(double, DARKEST * mean)
    alike = off[is_surface & ~is_moved]
    return {
        "percentile": float(np.percentile(alike, PERCENTILE)),
        "largest": float(alike.max()),
        "apart": float((alike > APART).mean()),
        "mean": abs(float(single[is_surface].mean(dtype=np.float64)) - mean) / mean,
    }


def settings_by_name() -> dict[str, Settings]:
    """Return what is compared: each method with rays of its own alone, and the passes as they are used.

    One bounce and no filter keep a changed ray in its pixel.
    """
    base = Settings()
    lines = replace(base.reflections, rays=2, reuse=0, filter=False, color_pyramid=False)
    found = {}
    for method in METHODS:
        options = {"method": method, "bounces": 1, "filter": False, "rays": 4, "slices": 2}
        found[method] = replace(base, diffuse=replace(base.diffuse, **options), reflections=lines)
    found["cones"] = replace(found["hemisphere"], reflections=replace(lines, color_pyramid=True))
    found["balanced"] = Settings.preset("balanced")
    return found


def frame_of(size: Size, name: str) -> Any:
    """Return a scene's frame, captured once in a process of its own and kept."""
    words = ("--capture", name, "--size", f"{size[0]}x{size[1]}")
    return kept_frame(_path(size, name), "benchmarks.stability", *words)


def _path(size: Size, name: str) -> Path:
    return CACHE / f"lit_{name}_{size[0]}x{size[1]}.exr"


def _capture(size: Size, name: str) -> None:
    from ssgi_addon.bpy_module import require_bpy

    require_bpy()
    import bpy

    from ssgi_addon.blender import scene_file
    from ssgi_addon.blender.capture import CaptureOptions, capture_frame

    scene_file.open_scene(SCENES / f"{name}.blend")
    options = CaptureOptions(samples=_SAMPLES, denoiser="fast", resolution=size)
    frame = capture_frame(bpy.context.scene, options)
    path = _path(size, name)
    print(write_passes(replace(frame, layers={}), path.parent, path.stem))


def table(results: dict[str, Any]) -> str:
    """Return the table of `docs/stability.md`."""
    head = (
        "scene",
        "passes",
        "rays",
        "changed",
        "moved",
        "diffuse",
        "glossy",
        "visibility",
        "mean of diffuse",
    )
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for scene, by_settings in results.items():
        for name, found in by_settings.items():
            images = found["images"]
            cells = [
                scene, name, f"{found['rays']:,}", f"{found['changed']:.4%}", f"{found['moved']:.4%}",
                *(
                    f"{images[image]['percentile']:.0e}, {images[image]['largest']:.0e}"
                    for image in IMAGES[:3]
                ),
                f"{images['diffuse']['mean']:.0e}",
            ]  # fmt: skip
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Compare, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=NAMES, metavar="NAME")
    parser.add_argument("--size", type=parse_size, default=(320, 180), metavar="WIDTHxHEIGHT")
    parser.add_argument("--output", type=Path, help="JSON file for the results")
    parser.add_argument("--capture", metavar="NAME", help=argparse.SUPPRESS)  # what a fresh process does
    arguments = parser.parse_args()
    if arguments.capture is not None:
        _capture(arguments.size, arguments.capture)
        return
    results: dict[str, Any] = {}
    for scene in arguments.scenes:
        frame = frame_of(arguments.size, scene)
        results[scene] = {
            name: compare_precisions(frame.gbuffer, frame.camera, settings, frame.environment, frame.views)
            for name, settings in settings_by_name().items()
        }
        print(table({scene: results[scene]}), flush=True)
    if arguments.output is not None:
        record.store(arguments.output, {"size": arguments.size, "scenes": arguments.scenes}, results)


if __name__ == "__main__":
    main()
