# SPDX-License-Identifier: GPL-3.0-or-later
"""One frame of a job: capture it, compute its indirect light, write the result, compare it with Cycles."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import __version__
from ..frame_samples import write_samples
from ..job_options import BEYOND_FRAME, TOGETHER, JobOptions
from ..manifest import manifest_of, stem, write_manifest
from ..passes import settings_to_json, write_passes
from ..png import write_png
from ..recipe import Recipe, recipe_hash
from ..results import Picture, compute_picture, peak_memory_mb, write_picture
from .camera import full_size
from .capture import CaptureOptions, capture_frame
from .comparison import compare_with_cycles
from .cycles_passes import cycles_device
from .denoise_picture import can_denoise_pictures, clean_layers, compute_denoised_picture
from .display import to_display
from .kept_world import KeptWorld
from .scene_file import denied_scripts

Progress = Callable[[float, str], None]
Report = dict[str, Any]

# Samples of the light in each view beyond the frame
VIEW_SAMPLES = 4


@dataclass(frozen=True)
class FrameResult:
    """The files of one frame, and its entry in the report."""

    exr_path: Path
    png_path: Path
    sheet_path: Path | None
    record: Report


def frame_stems(scene: bpy.types.Scene, options: JobOptions) -> dict[int, str]:
    """Return the frames that the options name, with the names of their files but for the endings."""
    return {frame: stem(scene_name(), frame) for frame in options.frames or (scene.frame_current,)}


def made_with(
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    options: JobOptions,
    scene_files: str | None = None,
    shot: str | None = None,
) -> Recipe:
    """Return what decides a frame's picture, as far as it is told; threads never do.

    Parameters
    ----------
    scene, view_layer, options
        What to render, and how.
    scene_files
        As of `content_hash`.
    shot
        Hash of the prepared shot that is read.
    """
    settings = {name: value for name, value in told_settings(options).items() if name != "threads"}
    return {
        "ssgi": __version__,
        "blender": ".".join(map(str, bpy.app.version[:2])),
        "scene_files": scene_files,
        "scripts_denied": bool(bpy.app.autoexec_fail),
        "device": cycles_device(scene) if options.engine == "cycles" else None,
        "shot": shot,
        "scene": scene.name,
        "view_layer": view_layer.name,
        "resolution": list(options.resolution or full_size(scene)),
        **settings,
    }


def render_one(
    scene: bpy.types.Scene,
    frame: int,
    options: JobOptions,
    recipe: Recipe,
    progress: Progress,
    kept: KeptWorld | None,
) -> FrameResult:
    """Run the whole job on one frame; the order of the steps is that of the data flow."""
    share = 0.5 if options.compare else 1.0
    name = stem(scene_name(), frame)
    begun = time.perf_counter()
    picture, seconds = make_picture(scene, options, frame, part(progress, 0.0, 0.95 * share), kept)
    writing = time.perf_counter()
    progress(0.96 * share, "Writing")
    if "denoise" in seconds:
        picture = clean_layers(scene, picture)
    if options.save_passes:
        write_passes(picture.frame, options.output / "passes", name, options.settings)
    exr_path, png_path = options.output / f"{name}.exr", options.output / f"{name}.png"
    shown = to_display(scene, picture.combined)
    write_png(png_path, shown)
    camera = write_samples(picture, shown, manifest_of(options.output, name))
    write_picture(picture, exr_path, recipe)
    seconds["write"] = time.perf_counter() - writing
    seconds["total"] = time.perf_counter() - begun
    record = _record(frame, picture, seconds) | {"settings_hash": recipe_hash(recipe)}
    sheet_path = None
    if options.compare:
        rest = part(progress, share, 0.9 * share)
        sheet_path = compare_with_cycles(scene, picture, record, options, name, rest)
    write_manifest(options.output, scene_name(), record, camera, recipe, versions())
    progress(1.0, "Done")
    return FrameResult(exr_path, png_path, sheet_path, record)


def make_picture(
    scene: bpy.types.Scene,
    options: JobOptions,
    frame: int | None = None,
    progress: Progress | None = None,
    kept: KeptWorld | None = None,
) -> tuple[Picture, dict[str, float]]:
    """Capture a frame and compute its indirect light; nothing is written.

    Parameters
    ----------
    scene
        Open; exactly as before afterwards, also after an error.
    options
        What to render; where to write does not matter here.
    frame
        Frame number; None means the current one.
    progress
        Called with a fraction and a text; may raise to stop.
    kept
        As in `capture_frame`.

    Returns
    -------
    picture
        The result.
    seconds
        Wall time of the capture, of the passes and of the denoiser that cleans the picture.

    Raises
    ------
    SSGIError
        If the scene cannot be captured.
    """
    begun = time.perf_counter()
    captured = capture_frame(scene, capture_options(scene, options, frame), part(progress, 0.0, 0.5), kept)
    computing = time.perf_counter()
    seconds = {"capture": computing - begun}
    rest = part(progress, 0.5, 0.5)
    together = options.denoiser == TOGETHER
    if together and can_denoise_pictures(scene):
        picture, spent = compute_denoised_picture(scene, captured, options.settings, rest)
        return picture, seconds | spent
    if together:
        note = "This Blender cannot denoise pictures: the filters of the passes clean the indirect light."
        captured = replace(captured, notes=(*captured.notes, note))
    picture = compute_picture(captured, options.settings, rest)
    return picture, {**seconds, "passes": time.perf_counter() - computing}


def capture_options(scene: bpy.types.Scene, options: JobOptions, frame: int | None) -> CaptureOptions:
    """Return what a job captures of a frame; None means the current one."""
    together = options.denoiser == TOGETHER
    has_clean_fill = options.fill > 0 and options.denoiser != "none" and can_denoise_pictures(scene)
    fill_denoiser = "fast" if together else options.denoiser
    return CaptureOptions(
        engine=options.engine,
        samples=options.samples,
        denoiser="none" if together else options.denoiser,
        # Mirrors show single pixels of them, which the picture's denoiser would take for detail
        view_denoiser="fast" if together else None,
        fill_denoiser=fill_denoiser if has_clean_fill else "none",
        own_geometry=options.own_geometry,
        splits_light=not (has_clean_fill and options.settings.fill_mode == "replace"),
        keep_passes=options.save_passes,
        resolution=options.resolution,
        frame=frame,
        view_samples=VIEW_SAMPLES,
        **_beyond(options),
    )


def told_settings(options: JobOptions) -> dict[str, Any]:
    """Return the settings as the report tells them."""
    return {
        **settings_to_json(options.settings),
        "engine": options.engine,
        "samples": options.samples,
        "denoiser": options.denoiser,
        "own_geometry": options.own_geometry,
        **_beyond(options),
        "keep_world": options.keep_world,
    }


def _beyond(options: JobOptions) -> dict[str, Any]:
    return {name: getattr(options, name) for name in BEYOND_FRAME}


def _record(frame: int, picture: Picture, seconds: dict[str, float]) -> Report:
    """Return a frame's entry in the report; `seconds` is filled up with the steps' own."""
    for name, value in {**picture.frame.seconds, **picture.light.seconds}.items():
        seconds.setdefault(name, value)
    return {
        "frame": frame,
        "seconds": seconds,
        "peak_memory_mb": peak_memory_mb(),
        "rays": dict(picture.light.rays),
        "known": float(np.mean(picture.light.known, dtype=np.float64)),
        "gains": dict(picture.frame.gains),
        "skipped": [
            {"what": what, "why": why} for what, why in (*picture.frame.skipped, *picture.light.skipped)
        ],
        "notes": [*picture.frame.notes, *denied_scripts()],
        "metrics": None,
    }


def scene_name() -> str:
    """Return what the open scene's files are called: as the scene file, or what an unsaved one is called."""
    return Path(bpy.data.filepath).stem or "untitled"


def versions() -> dict[str, str]:
    return {
        "ssgi": __version__,
        "blender": bpy.app.version_string,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def part(progress: Progress | None, begin: float, share: float) -> Progress:
    """Return a progress callback that fills a part of the whole."""

    def report(fraction: float, text: str) -> None:
        if progress is not None:
            progress(begin + share * fraction, text)

    return report
