# SPDX-License-Identifier: GPL-3.0-or-later
"""What a job renders and where it writes, declared once for Python, the command line and the panel."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .core import Settings
from .core.settings import option

DEFAULT_PRESET = "balanced"
# The denoiser that cleans the finished picture.
TOGETHER = "together"
_FRAME_ALONE = {"surround": 0, "stations": 0, "back_faces": False, "mirrors_only": True}
# What presets set beside the settings of the passes: what is rendered. The budget is the work for views
# beyond the frame, as a multiple of that of the direct light (ADR 21, 22, 24).
RENDERED: dict[str, dict[str, Any]] = {
    "draft": {
        "samples": 1,
        "denoiser": "fast",
        "own_geometry": False,
        "fill": 4,
        "budget": 1.5,
        **_FRAME_ALONE,
    },
    "balanced": {
        "samples": 4,
        "denoiser": "fast",
        "own_geometry": False,
        "fill": 16,
        "budget": 1.5,
        **_FRAME_ALONE,
    },
    "final": {
        "samples": 16,
        "denoiser": "fast",
        "own_geometry": True,
        "fill": 64,
        "budget": 6.0,
        **_FRAME_ALONE,
    },
}
PRESET_HELP = {
    "draft": "Look at the light while the scene changes: seconds",
    "balanced": "Most accuracy for its time: about as long as a few samples of the frame",
    "final": "Least error: some times as long as balanced",
}
# EEVEE renders no fill: what presets capture in its place, and what `final` does besides.
_WITHOUT_FILL = {"surround": 128, "mirrors_only": False}
_FINAL_WITHOUT_FILL = {**_WITHOUT_FILL, "stations": 8}
# What is captured beyond the frame, in the order of the panel.
BEYOND_FRAME = (
    "budget", "fill", "mirrors_only", "surround", "overscan", "stations", "light_views", "back_faces",
    "behind",
)  # fmt: skip
# Of these, what Cycles alone can capture.
CYCLES_ONLY = ("fill", "back_faces", "behind")
ENGINE_LABELS = {"cycles": "Cycles", "eevee": "EEVEE"}
ENGINES = tuple(ENGINE_LABELS)
_MOST_SAMPLES = 1 << 24  # of Cycles


_DEFAULT = RENDERED[DEFAULT_PRESET]


def rendered(preset: str, engine: str) -> dict[str, Any]:
    """Return the options of `JobOptions` that a preset sets, by name, for an engine."""
    if engine == ENGINES[0]:
        return RENDERED[preset]
    return {**RENDERED[preset], **(_FINAL_WITHOUT_FILL if preset == "final" else _WITHOUT_FILL)}


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
    resume
        Skip frames whose result is there already, made with the same settings, unless `overwrite` is on;
        without either, results that are there are refused.
    enable_autoexec
        Run the scripts and drivers of the .blend file.
    shot
        Folder of a prepared shot, whose captures the frames read; None renders each by itself.
    """

    output: Path
    settings: Settings = field(default_factory=lambda: Settings.preset(DEFAULT_PRESET))
    engine: str = ENGINES[0]
    resolution: tuple[int, int] | None = None
    frames: tuple[int, ...] | None = None
    overwrite: bool = False
    resume: bool = False
    enable_autoexec: bool = False
    shot: Path | None = None
    samples: int = option(
        _DEFAULT["samples"],
        "Samples per pixel of the direct light",
        label="Direct Samples",
        min=1,
        max=_MOST_SAMPLES,
        soft_max=1024,
    )
    denoiser: str = option(
        _DEFAULT["denoiser"],
        "Use of Cycles' denoiser, where this Blender has one",
        label="Denoiser",
        choices={
            "none": "Keep the noise of the direct light",
            "fast": "Clean the direct light at the denoiser's fastest setting",
            "accurate": "Clean the direct light at the denoiser's best setting",
            TOGETHER: "Clean direct and indirect light at once, in place of the passes' own filters. "
            "The layer of the direct light keeps its noise",
        },
    )
    own_geometry: bool = option(
        _DEFAULT["own_geometry"],
        "Render depth, normals and roughness by themselves, from one sample at each pixel's center. Off, "
        "Cycles takes them from the render of the light: one render less, and edges that are less exact. "
        "Volumes, and EEVEE, need the render of their own",
        label="Own Geometry",
    )
    budget: float = option(
        _DEFAULT["budget"],
        "Limit for all that is captured beyond the frame, as a multiple of the direct light's work, counted "
        "in samples: about its time, and the same on each machine. What rays would gain most by comes first, "
        "what they do not need is left out, and the report says why. Presets set it",
        label="Budget",
        min=0.0,
        max=1000.0,
        soft_max=10.0,
    )
    fill: int = option(
        _DEFAULT["fill"],
        "Light paths for every 4 x 4 pixels, with all bounces, in a small path-traced render: by Fill "
        "Mode it brings the light, or what rays cannot find. The denoiser cleans it unless that is off. 0 "
        "renders none. Costs about as much as one sample of the whole frame at 16. Through Cycles only",
        label="Fill Samples",
        unit="paths/16 pixels",
        min=0,
        max=_MOST_SAMPLES,
        soft_max=64,
    )
    mirrors_only: bool = option(
        _DEFAULT["mirrors_only"],
        "Capture views beyond the frame only where mirrors show them, if there is a fill: the light of "
        "rougher surfaces comes from the fill, in less time",
        label="Views for Mirrors Only",
    )
    surround: int = option(
        _DEFAULT["surround"],
        "Side of six small views around the camera, in which rays that leave the frame find what lies "
        "beyond it; 0 captures none. Costs six short renders, together a few seconds at 128",
        label="Surround",
        unit="pixels",
        min=0,
        max=4096,
        soft_max=512,
    )
    overscan: float = option(
        1.0,
        "Width and height of one wider view, relative to the frame's, with as many pixels: sharper than the "
        "surround for what lies just beyond the border. 1 captures none. Costs one render of the frame's "
        "size",
        label="Overscan",
        min=1.0,
        max=8.0,
        soft_max=2.0,
    )
    stations: int = option(
        _DEFAULT["stations"],
        "Largest number of views from elsewhere, placed where they see what rays lose sight of. "
        "0 captures none. Each costs a short render, a fraction of a second",
        label="Stations",
        unit="views",
        min=0,
        max=256,
        soft_max=32,
    )
    light_views: int = option(
        0,
        "Largest number of views from lamps, the strongest first: reflective shadow maps. 0 captures none. "
        "Each costs a short render",
        label="Light Views",
        unit="views",
        min=0,
        max=64,
        soft_max=8,
    )
    back_faces: bool = option(
        _DEFAULT["back_faces"],
        "Capture how thick things are, in all views, instead of guessing. Costs one more render of each view "
        "with a single sample, and compiles all materials once more. Through Cycles only",
        label="Back Faces",
    )
    behind: bool = option(
        False,
        "Capture the layer behind the visible surfaces with its direct light, in all views. Costs as much as "
        "the direct light of frame and views. Through Cycles only",
        label="Layer Behind",
    )
    keep_world: bool = option(
        False,
        "Go on with views of earlier frames and average their fills, until anything but the camera moves: "
        "less flicker where one process renders all frames. Off, each frame is the same whichever frames "
        "were rendered before it",
        label="Keep Between Frames",
    )
    save_passes: bool = option(
        False,
        "Keep the captured passes and the camera, too, to compute the light again without Blender",
        label="Save Passes",
    )
    compare: bool = option(
        False,
        "Render the scene with Cycles' own indirect light, too, and measure the error against it",
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

    @classmethod
    def preset(cls, name: str, output: Path, **changes: Any) -> JobOptions:
        """Return the options of a point between speed and accuracy.

        Parameters
        ----------
        name
            As in `Settings.preset`.
        output
            Folder for the results.
        **changes
            Options that the preset does not decide.

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        settings = Settings.preset(name)
        options = rendered(name, changes.get("engine", ENGINES[0]))
        return cls(**{"output": output, "settings": settings, **options, **changes})
