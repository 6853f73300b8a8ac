# SPDX-License-Identifier: GPL-3.0-or-later
"""What a job renders and where it writes, declared once for Python, the command line and the panel."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from .core import Settings
from .core.settings import option

DEFAULT_PRESET = "balanced"
ENGINE_LABELS = {"cycles": "Cycles", "eevee": "EEVEE"}
ENGINES = tuple(ENGINE_LABELS)
_MOST_SAMPLES = 1 << 24  # of Cycles


@dataclass(frozen=True)
class JobOptions:
    """What to render and where to write it.

    Options with a help text are also properties of the scene, in the panel; what the rest means to the
    command line and to the panel differs.

    Attributes
    ----------
    output
        Folder for the results; it is made when the first one is written.
    settings
        Of the passes.
    engine
        Renders the direct light.
    resolution
        Width and height, pixels; None means the scene's.
    frames
        Frame numbers; None means the current one.
    overwrite
        Replace results that are there already.
    """

    output: Path
    settings: Settings = field(default_factory=lambda: Settings.preset(DEFAULT_PRESET))
    engine: str = ENGINES[0]
    resolution: tuple[int, int] | None = None
    frames: tuple[int, ...] | None = None
    overwrite: bool = False
    samples: int = option(
        16,
        "Samples per pixel of the direct light",
        label="Direct Samples",
        min=1,
        max=_MOST_SAMPLES,
        soft_max=1024,
    )
    denoise: bool = option(
        True, "Denoise the direct light, where this Blender has a denoiser", label="Denoise"
    )
    surround: int = option(
        128,
        "Side of six small views around the camera, in which rays that leave the frame find what lies "
        "beyond it; 0 captures none. Costs six short renders, together a few seconds at 128",
        label="Surround",
        unit="pixels",
        min=0,
        max=4096,
        soft_max=512,
    )
    fill: int = option(
        0,
        "Samples per pixel of a path-traced render of a quarter of the size each way, with all bounces: it "
        "brings the light that rays in these views cannot find. 0 renders none. Costs about a tenth of the "
        "direct light's time at 16. Through Cycles only",
        label="Fill",
        unit="samples/pixel",
        min=0,
        max=_MOST_SAMPLES,
        soft_max=64,
    )
    save_passes: bool = option(
        False,
        "Also keep the captured passes and the camera, to compute the light again without Blender",
        label="Save Passes",
    )
    compare: bool = option(
        False,
        "Also render the scene with Cycles' own indirect light, and measure the error against it",
        label="Compare",
    )
    reference_samples: int = option(
        64,
        "Samples per pixel of the render to compare with",
        label="Reference Samples",
        min=1,
        max=_MOST_SAMPLES,
        soft_max=4096,
    )
