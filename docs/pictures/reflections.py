# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures in ``docs/reflections.md``: what each switch of the reflections does.

Run from the repository's root, with the environment of `make env`:

    python -m docs.pictures.reflections [NAME ...]

Scenes are captured once and kept in ``.cache/pictures``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from docs.pictures.panels import difference
from docs.pictures.reflection_list import DIFFERENCE_GAIN, PICTURES, Crop, Panel, Picture
from docs.pictures.reflection_scenes import (
    build_checks,
    build_corner,
    build_hidden,
    build_night_road,
    build_room,
    build_strips,
    build_varnished_strips,
)
from docs.pictures.to_webp import convert
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.display import to_display
from ssgi_addon.blender.reference import ReferenceOptions, render_reference
from ssgi_addon.blender.sheet import write_contact_sheet
from ssgi_addon.core import ReflectionSettings, Settings, composite, render_indirect
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import read_passes, write_passes

ROOT = Path(__file__).parents[2]
CACHE = ROOT / ".cache" / "pictures"
OUTPUT = ROOT / "docs" / "images" / "reflections"
SIZE = (400, 240)
_REFERENCE_SAMPLES = 128
_BUILDERS: dict[str, Callable[[], bpy.types.Scene]] = {
    "strips": build_strips,
    "varnished strips": build_varnished_strips,
    "road": build_night_road,
    "room": build_room,
    "checks": build_checks,
    "hidden": build_hidden,
    "corner": build_corner,
}

Image = npt.NDArray[np.float32]
Shown = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene with its captured frame, and what Cycles makes of it."""

    scene: bpy.types.Scene
    frame: CapturedFrame
    reference: Image

    @classmethod
    def of(cls, name: str) -> Stage:
        """Build a scene, and capture it where that was not done before."""
        scene = _BUILDERS[name]()
        path, reference = CACHE / f"{name}.exr", CACHE / f"{name}_cycles.npy"
        if not (path.with_suffix(".json").is_file() and reference.is_file()):
            CACHE.mkdir(parents=True, exist_ok=True)
            frame = capture_frame(scene, CaptureOptions(samples=64, resolution=SIZE))
            # What the reflection pass answers: direct light, and what one glossy bounce brings of it
            options = ReferenceOptions(
                _REFERENCE_SAMPLES, resolution=SIZE, diffuse_bounces=0, glossy_bounces=1
            )
            write_passes(replace(frame, layers={}), CACHE, name)
            np.save(reference, render_reference(scene, options).combined)
        return cls(scene, read_passes(path), np.load(reference))

    def picture(self, panel: Panel) -> Image:
        """Return the panel's picture, scene-linear."""
        if panel.kind == "cycles":
            return self.reference
        if panel.kind == "direct":
            return self.frame.gbuffer.direct
        settings = Settings(
            reflections=replace(ReflectionSettings(), **panel.options), max_steps=panel.max_steps
        )
        settings = replace(settings, diffuse=replace(settings.diffuse, enabled=panel.has_diffuse))
        light = render_indirect(self.frame.gbuffer, self.frame.camera, settings)
        return composite(self.frame.gbuffer, light)


def draw(picture: Picture, stage: Stage) -> Path:
    """Render a picture's panels and write them side by side."""
    shown: list[Shown] = []
    for panel in picture.panels:
        if panel.kind == "difference":
            shown.append(difference(*shown[-2:], DIFFERENCE_GAIN))
        else:
            shown.append(_cut(to_display(stage.scene, stage.picture(panel)), picture.crop))
    titles = [panel.title for panel in picture.panels]
    path = OUTPUT / f"{picture.name}.png"
    OUTPUT.mkdir(parents=True, exist_ok=True)
    write_contact_sheet(path, list(zip(titles, shown, strict=True)), legend=False)
    return convert(path)


def _cut(image: Shown, crop: Crop | None) -> Shown:
    """Return a part of a picture; what is small is enlarged by the sheet, pixel by pixel."""
    if crop is None:
        return image
    left, top, right, bottom = crop
    return image[top:bottom, left:right]


def main() -> None:
    """Draw all pictures, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if there is none")
    names = parser.parse_args().names
    chosen = [picture for picture in PICTURES if not names or picture.name in names]
    for scene in dict.fromkeys(picture.scene for picture in chosen):
        stage = Stage.of(scene)
        for picture in chosen:
            if picture.scene == scene:
                draw(picture, stage)


if __name__ == "__main__":
    main()
