# SPDX-License-Identifier: GPL-3.0-or-later
"""Captured frames with Cycles' Glossy Indirect, rendered once and kept.

Run ``python -m benchmarks.glossy_truth NAME WIDTHxHEIGHT SAMPLES`` to render one ahead. A name is that of a
real scene, or ``floor`` with a roughness: ``floor_0.4`` is the scene of `tests.scenes.glossy_floor`.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.inputs import CACHE, ROOT, SCENES, Size, parse_size
from ssgi_addon.core.types import FloatArray
from ssgi_addon.files import replacing
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import read_passes, write_passes

if TYPE_CHECKING:
    import bpy

_FLOOR = "floor_"
_BUILDER = ROOT / "tests" / "scenes" / "glossy_floor.py"
_SURROUND_PX = 128


@dataclass(frozen=True, eq=False)
class GlossyTruth:
    """A captured frame and what its glossy light should be.

    Attributes
    ----------
    frame
        As a job captures it, with its surround.
    halves : (2, H, W, 3)
        Glossy Indirect, each of half the samples and with a seed of its own: they differ by noise alone.
    is_floor
        Light is reflected once, by the glossy floor; else as often as the scene says.
    """

    frame: CapturedFrame
    halves: FloatArray
    is_floor: bool

    @property
    def radiance(self) -> FloatArray:
        """(H, W, 3) the mean of both halves."""
        mean: FloatArray = self.halves.mean(axis=0)
        return mean


def floor_name(roughness: float) -> str:
    """Return the name of the glossy floor with a roughness."""
    return f"{_FLOOR}{roughness:g}"


def real_scenes() -> list[str]:
    """Return the names of the real scenes that are here."""
    return sorted(path.stem for path in SCENES.glob("*.blend"))


def glossy_truth(name: str, size: Size, samples: int) -> GlossyTruth:
    """Return a frame and its truth, rendered in a process of its own where it is not kept yet.

    Parameters
    ----------
    name
        Of the scene.
    size
        Width and height, pixels.
    samples
        Of Cycles, per pixel.
    """
    path = _path(name, size, samples)
    if not path.with_suffix(".npy").is_file():
        command = [
            sys.executable,
            "-m",
            "benchmarks.glossy_truth",
            name,
            f"{size[0]}x{size[1]}",
            str(samples),
        ]
        # No preferences and no extensions of the user
        environment = {"BLENDER_USER_RESOURCES": str(ROOT / ".cache" / "blender"), **os.environ}
        subprocess.run(command, check=True, cwd=ROOT, stdout=sys.stderr, env=environment)
    return GlossyTruth(read_passes(path), np.load(path.with_suffix(".npy")), name.startswith(_FLOOR))


def _path(name: str, size: Size, samples: int) -> Path:
    """Return where a frame is kept; a scene that changed has another place."""
    scene = _BUILDER if name.startswith(_FLOOR) else SCENES / f"{name}.blend"
    digest = hashlib.sha256(scene.read_bytes()).hexdigest()[:8]
    return CACHE / f"glossy_{name}_{size[0]}x{size[1]}_{samples}_{digest}.exr"


def _render(name: str, size: Size, samples: int) -> GlossyTruth:
    from ssgi_addon.bpy_module import require_bpy

    require_bpy()
    from ssgi_addon.blender.capture import CaptureOptions, capture_frame
    from ssgi_addon.blender.reference import ReferenceOptions, render_reference

    is_floor = name.startswith(_FLOOR)
    scene = _open(name)
    options = CaptureOptions(resolution=size, surround=_SURROUND_PX)
    reference = ReferenceOptions(samples=samples // 2, denoise=False, resolution=size)
    if is_floor:
        # Its lamp is a point and its light paths start at pixel centres: one sample is free of noise
        options = replace(options, samples=1, denoise=False, surround_samples=1)
        reference = replace(reference, diffuse_bounces=0, glossy_bounces=1)
    frame = replace(capture_frame(scene, options), layers={})
    halves = [render_reference(scene, replace(reference, seed=seed)).glossy_indirect for seed in (1, 2)]
    return GlossyTruth(frame, np.stack(halves), is_floor)


def _open(name: str) -> bpy.types.Scene:
    import bpy

    from ssgi_addon.blender import job
    from tests.scenes.glossy_floor import build_glossy_floor

    if not name.startswith(_FLOOR):
        job.open_scene(SCENES / f"{name}.blend")
        return bpy.context.scene
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return build_glossy_floor(float(name.removeprefix(_FLOOR)))


def main() -> None:
    """Render one frame and its truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("size", type=parse_size)
    parser.add_argument("samples", type=int)
    arguments = parser.parse_args()
    path = _path(arguments.name, arguments.size, arguments.samples)
    truth = _render(arguments.name, arguments.size, arguments.samples)
    write_passes(truth.frame, path.parent, path.stem)
    with replacing(path.with_suffix(".npy")) as temporary, temporary.open("wb") as file:
        np.save(file, truth.halves)
    print(path)


if __name__ == "__main__":
    main()
