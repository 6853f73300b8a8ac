# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture in ``docs/shot_report.md``: the contact sheet of a short shot of the demo scene.

Run from the repository's root, with the environment of `make env` and the extra ``docs``; takes a minute:

    python -m docs.pictures.shot_report
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from PIL import Image as PillowImage

from docs.pictures.panels import IMAGES, write_webp
from ssgi_addon.blender.demo_scene import build_demo_scene
from ssgi_addon.blender.job import run_job
from ssgi_addon.core import Settings
from ssgi_addon.job_options import JobOptions
from ssgi_addon.manifest import manifest_path, read_manifest, write_failure
from ssgi_addon.shot.command import merge

_FRAMES = tuple(range(1, 13))
_SIZE = (240, 135)
_STEP = 0.03  # scene units a frame, to the right
# Made up, so that the picture shows how they look
_MISSING, _FAILED = (5, 6), 9
# In this frame the sun is brighter
_FLASH, _FLASH_FACTOR = 11, 1.6


def main() -> None:
    """Render the shot and draw its sheet."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = build_demo_scene()
    bpy.context.window.scene = scene
    _animate(scene)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        blend = folder / "demo.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
        options = JobOptions.preset("draft", folder / "out", settings=Settings.preset("draft"),
                                    resolution=_SIZE, frames=_FRAMES)  # fmt: skip
        run_job(blend, options)
        for frame in _MISSING:
            manifest_path(options.output, "demo", frame).unlink()
        path = manifest_path(options.output, "demo", _FAILED)
        told = read_manifest(path)
        path.unlink()
        write_failure(
            options.output, "demo", _FAILED, "not enough memory", told["settings"], told["versions"]
        )
        with PillowImage.open(merge(options.output, _FRAMES, None).picture) as sheet:
            write_webp(IMAGES / "shot_report.webp", np.asarray(sheet.convert("RGB")))


def _animate(scene: bpy.types.Scene) -> None:
    """Let the camera slide, and one frame flash."""
    camera = scene.camera
    start = camera.matrix_world.copy()
    lamps = [item.data for item in scene.objects if item.type == "LIGHT"]
    energies = [lamp.energy for lamp in lamps]
    for frame in _FRAMES:
        camera.matrix_world = start @ Matrix.Translation((_STEP * (frame - 1), 0.0, 0.0))
        camera.keyframe_insert("location", frame=frame)
        for lamp, energy in zip(lamps, energies):
            lamp.energy = energy * (_FLASH_FACTOR if frame == _FLASH else 1.0)
            lamp.keyframe_insert("energy", frame=frame)


if __name__ == "__main__":
    main()
