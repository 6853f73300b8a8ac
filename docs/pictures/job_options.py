# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures in ``docs/job_settings.md``: what options of the capture do, in Blender's demo scene.

Run from the repository's root, with the environment of `make env` and the extra ``docs``; takes minutes:

    python -m docs.pictures.job_options [NAME ...]
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy

from docs.pictures.panels import IMAGES, Shown, write_panels
from ssgi_addon.blender.demo_scene import build_demo_scene
from ssgi_addon.blender.display import to_display
from ssgi_addon.blender.one_frame import make_picture
from ssgi_addon.blender.reference import ReferenceOptions, render_reference
from ssgi_addon.heatmap import error_map
from ssgi_addon.job_options import JobOptions

SIZE = (240, 135)
_REFERENCE_SAMPLES = 64
# Of each picture: what differs from the default preset, panel by panel.
PICTURES: Mapping[str, Sequence[tuple[str, Mapping[str, Any]]]] = {
    "samples": (
        ("samples 1", {"samples": 1, "denoiser": "none"}),
        ("samples 32", {"samples": 32, "denoiser": "none"}),
    ),
    "denoiser": (
        ("denoiser none", {"samples": 1, "denoiser": "none"}),
        ("denoiser fast", {"samples": 1, "denoiser": "fast"}),
    ),
    "own_geometry": (
        ("own_geometry off", {"own_geometry": False, "fill": 0}),
        ("own_geometry on", {"own_geometry": True, "fill": 0}),
    ),
    "compare": (),
    "reference_samples": (),
}


def main(names: Sequence[str] = ()) -> None:
    """Draw all pictures, or those that are named."""
    scene = build_demo_scene()
    for name in names or PICTURES:
        panels = _panels_of_reference(name, scene) or [
            (title, to_display(scene, _picture(scene, changes).combined)) for title, changes in PICTURES[name]
        ]
        write_panels(IMAGES / "job" / f"{name}.webp", panels)


def _panels_of_reference(name: str, scene: bpy.types.Scene) -> list[tuple[str, Shown]]:
    if name == "compare":
        truth = _reference(scene, _REFERENCE_SAMPLES)
        ours = _picture(scene, {})
        return [
            ("Cycles' own indirect light", to_display(scene, truth)),
            ("error of ours", error_map(ours.combined, truth)),
        ]
    if name == "reference_samples":
        return [
            (f"reference_samples {samples}", to_display(scene, _reference(scene, samples)))
            for samples in (4, 256)
        ]
    return []


def _reference(scene: bpy.types.Scene, samples: int) -> Any:
    return render_reference(scene, ReferenceOptions(samples, resolution=SIZE)).combined


def _picture(scene: bpy.types.Scene, changes: Mapping[str, Any]) -> Any:
    options = JobOptions.preset("balanced", Path(), resolution=SIZE, **changes)
    return make_picture(scene, options)[0]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if there is none")
    main(parser.parse_args().names)
