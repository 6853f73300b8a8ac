# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture in ``docs/diffuse.md``: openness and diffuse light of one scene by each method.

Run from the repository's root, with the environment of `make env`:

    python -m docs.pictures.diffuse
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from docs.pictures.reflections import CACHE, ROOT, Shown, Stage
from docs.pictures.to_webp import convert
from ssgi_addon.blender.display import to_display
from ssgi_addon.blender.sheet import write_contact_sheet
from ssgi_addon.core import DiffuseSettings, Settings, render_indirect

OUTPUT = ROOT / "docs" / "images" / "diffuse_methods.png"
_VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "256 rays": {"rays": 256, "filter": False},
    "2 rays, filter": {"rays": 2},
    "bitmask": {"method": "bitmask"},
    "horizon": {"method": "horizon"},
    "ssao": {"method": "ssao", "rays": 16},
}
# The light that is added, alone, is darker than a picture.
_EXPOSURE = 3.0
_GAP = 4


def draw() -> None:
    """Write the picture: openness above, light below."""
    CACHE.mkdir(parents=True, exist_ok=True)
    stage = Stage.of("corner")
    off = replace(Settings().reflections, enabled=False)
    panels: list[tuple[str, Shown]] = []
    for title, options in _VARIANTS.items():
        settings = Settings(diffuse=replace(DiffuseSettings(), **options), reflections=off)
        light = render_indirect(stage.frame.gbuffer, stage.frame.camera, settings)
        # Linear grey: half is half open
        grey = np.repeat(np.rint(light.visibility * 255.0).astype(np.uint8)[..., None], 3, axis=2)
        shown = to_display(stage.scene, (light.diffuse * _EXPOSURE).astype(np.float32))
        gap = np.full((_GAP, *grey.shape[1:]), 26, dtype=np.uint8)
        panels.append((title, np.concatenate([grey, gap, shown])))
    write_contact_sheet(OUTPUT, panels, legend=False)
    convert(OUTPUT)


if __name__ == "__main__":
    draw()
