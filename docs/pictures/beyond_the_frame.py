# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures in ``docs/beyond_the_frame.md``: what views from elsewhere, and a fill, add to a frame.

Run from the repository's root, with the environment of `make env` and matplotlib (the extra ``bench``):

    python -m docs.pictures.beyond_the_frame [NAME ...]

Scenes are captured once and kept in ``.cache/pictures``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import bpy
import numpy as np

from benchmarks.beyond_frame import Configuration
from docs.pictures.onward_ray import draw_figure
from docs.pictures.reflection_scenes import build_hidden_light, build_mirror_room
from docs.pictures.reflections import CACHE, ROOT, Image
from docs.pictures.to_webp import convert
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.display import to_display
from ssgi_addon.blender.reference import ReferenceOptions, render_reference
from ssgi_addon.blender.sheet import write_contact_sheet
from ssgi_addon.core import IndirectLight, Settings, composite, render_indirect
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import read_passes, write_passes

OUTPUT = ROOT / "docs" / "images" / "beyond_the_frame"
_REFERENCE_SAMPLES = 256
_SURROUND = Configuration(("surround",))
_STATIONS = Configuration(("surround", "stations"), back_faces=True)


@dataclass(frozen=True)
class Picture:
    """A scene, how it is captured and computed, and which captures stand side by side.

    Attributes
    ----------
    build
        Makes the scene.
    options
        With all that any panel uses.
    preset
        Of the passes.
    panels
        What is used of the capture, by title; Cycles' global illumination follows.
    shows_diffuse
        Show the diffuse light alone, so many times as bright; None shows the picture.
    """

    build: Callable[[], bpy.types.Scene]
    options: CaptureOptions
    preset: str
    panels: Mapping[str, Configuration]
    shows_diffuse: float | None = None


PICTURES = {
    "mirror": Picture(
        build_mirror_room,
        CaptureOptions(
            samples=64, resolution=(400, 240), surround=256, stations=8, view_size=256, view_samples=16,
            back_faces=True,
        ),
        "final",
        {"frame alone": Configuration(), "surround and stations": _STATIONS},
    ),
    "hidden_light": Picture(
        build_hidden_light,
        CaptureOptions(samples=64, resolution=(320, 180), surround=128, stations=8, back_faces=True, fill=16),
        "balanced",
        {
            "frame alone": Configuration(),
            "surround": _SURROUND,
            "and stations": _STATIONS,
            "and fill": replace(_STATIONS, fill=True),
        },
        shows_diffuse=2.0,
    ),
}  # fmt: skip


def draw(name: str) -> None:
    """Write one picture."""
    picture = PICTURES[name]
    scene = picture.build()
    frame, combined, diffuse = _captured(name, scene, picture.options)
    shown = []
    for title, configuration in picture.panels.items():
        used = configuration.of(frame)
        light = render_indirect(
            used.gbuffer,
            used.camera,
            Settings.preset(picture.preset),
            used.environment,
            used.views,
            fill=used.fill,
        )
        shown.append((title, _image(picture, light, used)))
    truth = combined if picture.shows_diffuse is None else diffuse * picture.shows_diffuse
    shown.append(("Cycles GI", truth))
    path = OUTPUT / f"{name}.png"
    panels = [(title, to_display(scene, image.astype(np.float32))) for title, image in shown]
    write_contact_sheet(path, panels, legend=False)
    convert(path)


def _image(picture: Picture, light: IndirectLight, frame: CapturedFrame) -> Image:
    if picture.shows_diffuse is None:
        return composite(frame.gbuffer, light)
    return light.diffuse * picture.shows_diffuse


def _captured(
    name: str, scene: bpy.types.Scene, options: CaptureOptions
) -> tuple[CapturedFrame, Image, Image]:
    """Return a frame with its views, and Cycles' picture and diffuse light, captured where not kept yet."""
    path, reference = CACHE / f"{name}.exr", CACHE / f"{name}_cycles.npz"
    if not (path.with_suffix(".json").is_file() and reference.is_file()):
        CACHE.mkdir(parents=True, exist_ok=True)
        frame = capture_frame(scene, options)
        truth = render_reference(scene, ReferenceOptions(_REFERENCE_SAMPLES, resolution=options.resolution))
        np.savez(reference, combined=truth.combined, diffuse=truth.diffuse_indirect)
        write_passes(replace(frame, layers={}), CACHE, name)  # last: its JSON file says that all is there
    with np.load(reference) as truth:
        return read_passes(path), truth["combined"], truth["diffuse"]


def main() -> None:
    """Draw all pictures, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if there is none")
    names = parser.parse_args().names
    OUTPUT.mkdir(parents=True, exist_ok=True)
    for name in names or [*PICTURES, "onward_ray"]:
        if name == "onward_ray":
            draw_figure(OUTPUT / "onward_ray.png")
        else:
            draw(name)


if __name__ == "__main__":
    main()
