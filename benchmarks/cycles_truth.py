# SPDX-License-Identifier: GPL-3.0-or-later
"""Captured frames, and what Cycles finds for their indirect light, rendered once and kept.

Run ``python -m benchmarks.cycles_truth NAME WIDTHxHEIGHT [SAMPLES [BOUNCES]]`` to render one ahead; without
samples only the frame is captured, without bounces they are the scene's. A name is that of a real scene, or
``floor`` with a roughness: ``floor_0.4`` is the scene of `tests.scenes.glossy_floor`.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.inputs import CACHE, ROOT, SCENES, Size, kept_frame, parse_size, run_module
from ssgi_addon.core.types import FloatArray
from ssgi_addon.files import replacing
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import write_passes

if TYPE_CHECKING:
    import bpy

_FLOOR = "floor_"
_BUILDER = ROOT / "tests" / "scenes" / "glossy_floor.py"
# It has five walls, a box and a ball: the plain case, to look into by hand.
_PLAIN = "cornell_box"
_SURROUND_PX = 128
# Goes up where a capture changes: frames that were kept no longer count.
_FRAME_VERSION = 3
_SEEDS = (1, 2)


@dataclass(frozen=True, eq=False)
class CyclesTruth:
    """A captured frame and what its indirect light should be.

    Attributes
    ----------
    frame
        As a job captures it, with its surround.
    diffuse_halves, glossy_halves : (2, H, W, 3)
        Diffuse and Glossy Indirect, each of half the samples and with a seed of its own: the halves differ by
        noise alone.
    is_floor
        Light is reflected once, by the glossy floor; else as often as was asked for.
    """

    frame: CapturedFrame
    diffuse_halves: FloatArray
    glossy_halves: FloatArray
    is_floor: bool


def floor_name(roughness: float) -> str:
    """Return the name of the glossy floor with a roughness."""
    return f"{_FLOOR}{roughness:g}"


def real_scenes() -> list[str]:
    """Return the names of the real scenes that are here."""
    return sorted(path.stem for path in SCENES.glob("*.blend") if path.stem != _PLAIN)


def captured_frame(name: str, size: Size) -> CapturedFrame:
    """Return a frame as a job captures it, in a process of its own where it is not kept yet.

    Parameters
    ----------
    name
        Of the scene.
    size
        Width and height, pixels.
    """
    return kept_frame(frame_path(name, size), "benchmarks.cycles_truth", name, f"{size[0]}x{size[1]}")


def cycles_truth(name: str, size: Size, samples: int, bounces: int | None = None) -> CyclesTruth:
    """Return a frame and its truth, rendered in a process of its own where it is not kept yet.

    Parameters
    ----------
    name
        Of the scene.
    size
        Width and height, pixels.
    samples
        Of Cycles, per pixel.
    bounces
        Of light, of whatever kind, so that no lobe's rays are cut off before another's; None means as many of
        each kind as the scene has.
    """
    path = _light_path(name, size, samples, bounces)
    if not path.is_file():
        words = [str(samples)] if bounces is None else [str(samples), str(bounces)]
        run_module("benchmarks.cycles_truth", name, f"{size[0]}x{size[1]}", *words)
    diffuse, glossy = np.load(path)
    return CyclesTruth(captured_frame(name, size), diffuse, glossy, name.startswith(_FLOOR))


def frame_path(name: str, size: Size) -> Path:
    """Return where a captured frame is kept; another one has another name."""
    return CACHE / f"frame{_FRAME_VERSION}_{_key(name, size)}.exr"


def _light_path(name: str, size: Size, samples: int, bounces: int | None) -> Path:
    suffix = "" if bounces is None else f"_{bounces}"
    return CACHE / f"cycles_{_key(name, size)}_{samples}{suffix}.npy"


def _key(name: str, size: Size) -> str:
    """Return what tells frames apart; a scene that changed is another."""
    scene = _BUILDER if name.startswith(_FLOOR) else SCENES / f"{name}.blend"
    digest = hashlib.sha256(scene.read_bytes()).hexdigest()[:8]
    return f"{name}_{size[0]}x{size[1]}_{digest}"


def _keep_frame(name: str, size: Size) -> None:
    from ssgi_addon.blender.capture import CaptureOptions, capture_frame

    options = CaptureOptions(resolution=size, surround=_SURROUND_PX)
    if name.startswith(_FLOOR):
        # Its lamp is a point and its light paths start at pixel centres: one sample is free of noise
        options = replace(options, samples=1, denoiser="none", view_samples=1)
    # The compositor's layers are half of the file, and nothing here reads them
    frame = replace(capture_frame(open_scene(name), options), layers={})
    path = frame_path(name, size)
    print(write_passes(frame, path.parent, path.stem))


def _keep_light(name: str, size: Size, samples: int, bounces: int | None) -> None:
    from ssgi_addon.blender.reference import ReferenceOptions, render_reference

    options = ReferenceOptions(samples=samples // len(_SEEDS), denoiser="none", resolution=size)
    if name.startswith(_FLOOR):
        options = replace(options, diffuse_bounces=0, glossy_bounces=1)
    elif bounces is not None:
        options = replace(options, diffuse_bounces=bounces, glossy_bounces=bounces, max_bounces=bounces)
    scene = open_scene(name)
    halves = [render_reference(scene, replace(options, seed=seed)) for seed in _SEEDS]
    light = np.stack([[half.diffuse_indirect for half in halves], [half.glossy_indirect for half in halves]])
    path = _light_path(name, size, samples, bounces)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, light)
    print(path)


def open_scene(name: str) -> bpy.types.Scene:
    """Open a scene in this process's Blender."""
    import bpy

    from ssgi_addon.blender import scene_file
    from tests.scenes.glossy_floor import build_glossy_floor

    if not name.startswith(_FLOOR):
        scene_file.open_scene(SCENES / f"{name}.blend")
        return bpy.context.scene
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return build_glossy_floor(float(name.removeprefix(_FLOOR)))


def main() -> None:
    """Render one frame, and its truth where samples are given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("size", type=parse_size)
    parser.add_argument("samples", type=int, nargs="?")
    parser.add_argument("bounces", type=int, nargs="?")
    arguments = parser.parse_args()
    from ssgi_addon.bpy_module import require_bpy

    require_bpy()
    if not frame_path(arguments.name, arguments.size).with_suffix(".json").is_file():
        _keep_frame(arguments.name, arguments.size)
    if arguments.samples:
        _keep_light(arguments.name, arguments.size, arguments.samples, arguments.bounces)


if __name__ == "__main__":
    main()
