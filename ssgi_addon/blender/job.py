# SPDX-License-Identifier: GPL-3.0-or-later
"""The job: capture a frame, compute its indirect light, write the result, compare it with Cycles."""

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
from ..earlier_results import Recipe, check_output, finished_frames, recipe_hash
from ..errors import SSGIError
from ..files import check_writable, write_json
from ..job_options import BEYOND_FRAME, TOGETHER, JobOptions
from ..memory import RENDER_BYTES, check_memory
from ..passes import settings_to_json, write_passes
from ..results import OUT_OF_MEMORY, Picture, compute_picture, peak_memory_mb, write_picture
from . import demo_scene
from .camera import full_size
from .capture import CaptureOptions, capture_frame
from .comparison import compare_with_cycles
from .denoise_picture import can_denoise_pictures, clean_layers, compute_denoised_picture
from .display import write_display_png
from .kept_world import KeptWorld
from .render_settings import find_view_layer
from .restore import Restorer
from .scene_file import denied_scripts, open_scene, refuse_unread_file

Progress = Callable[[float, str], None]
Report = dict[str, Any]

# Samples of the light in each view beyond the frame
VIEW_SAMPLES = 4
_DEMO_SIZE = (640, 360)
_DEMO_REFERENCE_SAMPLES = 64


@dataclass(frozen=True)
class FrameResult:
    """The files of one frame, and its entry in the report."""

    exr_path: Path
    png_path: Path
    sheet_path: Path | None
    record: Report


def run_job(scene_path: Path | None, options: JobOptions, progress: Progress | None = None) -> Report:
    """Render frames of a scene and write results and ``report.json``.

    Parameters
    ----------
    scene_path
        The .blend file; None means the open scene.
    options
        What to render.
    progress
        Called with a fraction and a text; may raise to stop.

    Returns
    -------
    dict
        The report.

    Raises
    ------
    SSGIError
        If the scene cannot be opened or captured, or a result cannot be written.
    """
    check_writable(options.output)
    if scene_path is None:
        refuse_unread_file()
    else:
        open_scene(scene_path, enable_autoexec=options.enable_autoexec)
    report, _ = render_frames(bpy.context.scene, options, progress)
    return report


def render_frames(
    scene: bpy.types.Scene, options: JobOptions, progress: Progress | None = None
) -> tuple[Report, list[FrameResult]]:
    """Render frames of an open scene; the report is written after each.

    Parameters and errors are those of `run_job`.
    """
    stems = frame_stems(scene, options)
    if not scene.render.use_border:
        check_memory(options.resolution or full_size(scene), RENDER_BYTES)
    recipe = made_with(scene, find_view_layer(scene), options)
    check_output(options, stems, recipe)
    records = finished_frames(options, stems, recipe)
    report: Report = {"versions": _versions(), "settings": _told_settings(options), "frames": []}
    results = []
    frames = [frame for frame in stems if frame not in records]
    kept = KeptWorld() if options.keep_world and len(frames) > 1 else None
    with Restorer() as restorer:
        if options.engine == "cycles":
            # From frame to frame Cycles then builds anew what has changed alone
            restorer.change(scene.render, use_persistent_data=True)
        for index, frame in enumerate(frames):
            part = _part(progress, index / len(frames), 1.0 / len(frames))
            try:
                result = _render_one(scene, frame, options, recipe, part, kept)
            except MemoryError as error:
                raise SSGIError(OUT_OF_MEMORY) from error
            results.append(result)
            records[frame] = result.record
            report["frames"] = [records[number] for number in stems if number in records]
            write_json(options.output / "report.json", report)
    if not frames:
        report["frames"] = list(records.values())
        write_json(options.output / "report.json", report)
    return report, results


def frame_stems(scene: bpy.types.Scene, options: JobOptions) -> dict[int, str]:
    """Return the frames that the options name, with the names of their files but for the endings."""
    return {frame: _stem(frame) for frame in options.frames or (scene.frame_current,)}


def made_with(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, options: JobOptions) -> Recipe:
    """Return what decides a frame's picture beside the content of the scene; threads never do."""
    settings = {name: value for name, value in _told_settings(options).items() if name != "threads"}
    return {
        "ssgi": __version__,
        "blender": ".".join(map(str, bpy.app.version[:2])),
        "scene": scene.name,
        "view_layer": view_layer.name,
        "resolution": list(options.resolution or full_size(scene)),
        **settings,
    }


def shown_result(scene: bpy.types.Scene, options: JobOptions) -> Path:
    """Return the result file that a user looks for: of the scene's current frame, else of the last one."""
    stems = frame_stems(scene, options)
    return options.output / f"{stems.get(scene.frame_current) or list(stems.values())[-1]}.exr"


def render_frame(
    scene: bpy.types.Scene, options: JobOptions, progress: Progress | None = None
) -> FrameResult:
    """Render the first frame that the options name; parameters and errors are those of `run_job`."""
    return render_frames(scene, options, progress)[1][0]


def run_demo(output: Path, progress: Progress | None = None) -> Path:
    """Build the demo scene in an empty file, run the whole job on it, and return the picture that shows it.

    Raises
    ------
    SSGIError
        If a result cannot be written.
    """
    check_writable(output)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = demo_scene.build_demo_scene()
    options = JobOptions(
        output=output,
        resolution=_DEMO_SIZE,
        compare=True,
        reference_samples=_DEMO_REFERENCE_SAMPLES,
        save_passes=True,
        overwrite=True,
    )
    sheet = render_frame(scene, options, progress).sheet_path
    assert sheet is not None  # compare is on
    return sheet


def _render_one(
    scene: bpy.types.Scene,
    frame: int,
    options: JobOptions,
    recipe: Recipe,
    progress: Progress,
    kept: KeptWorld | None,
) -> FrameResult:
    """Run the whole job on one frame; the order of the steps is that of the data flow."""
    share = 0.5 if options.compare else 1.0
    stem = _stem(frame)
    begun = time.perf_counter()
    picture, seconds = make_picture(scene, options, frame, _part(progress, 0.0, 0.95 * share), kept)
    writing = time.perf_counter()
    progress(0.96 * share, "Writing")
    if "denoise" in seconds:
        picture = clean_layers(scene, picture)
    if options.save_passes:
        write_passes(picture.frame, options.output / "passes", stem, options.settings)
    exr_path, png_path = options.output / f"{stem}.exr", options.output / f"{stem}.png"
    write_display_png(scene, picture.combined, png_path)
    write_picture(picture, exr_path, recipe)
    seconds["write"] = time.perf_counter() - writing
    seconds["total"] = time.perf_counter() - begun
    record = _record(frame, picture, seconds) | {"settings_hash": recipe_hash(recipe)}
    sheet_path = None
    if options.compare:
        rest = _part(progress, share, 0.9 * share)
        sheet_path = compare_with_cycles(scene, picture, record, options, stem, rest)
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
    together = options.denoiser == TOGETHER
    has_clean_fill = options.fill > 0 and options.denoiser != "none" and can_denoise_pictures(scene)
    fill_denoiser = "fast" if together else options.denoiser
    captured = capture_frame(
        scene,
        CaptureOptions(
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
        ),
        _part(progress, 0.0, 0.5),
        kept,
    )
    computing = time.perf_counter()
    seconds = {"capture": computing - begun}
    rest = _part(progress, 0.5, 0.5)
    if together and can_denoise_pictures(scene):
        picture, spent = compute_denoised_picture(scene, captured, options.settings, rest)
        return picture, seconds | spent
    if together:
        note = "This Blender cannot denoise pictures: the filters of the passes clean the indirect light."
        captured = replace(captured, notes=(*captured.notes, note))
    picture = compute_picture(captured, options.settings, rest)
    return picture, {**seconds, "passes": time.perf_counter() - computing}


def _told_settings(options: JobOptions) -> dict[str, Any]:
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


def _stem(frame: int) -> str:
    """Return the name of a frame's files: the scene file's, or what an unsaved one is called."""
    return f"{Path(bpy.data.filepath).stem or 'untitled'}_{frame:04d}"


def _versions() -> dict[str, str]:
    return {
        "ssgi": __version__,
        "blender": bpy.app.version_string,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _part(progress: Progress | None, begin: float, share: float) -> Progress:
    """Return a progress callback that fills a part of the whole."""

    def report(fraction: float, text: str) -> None:
        if progress is not None:
            progress(begin + share * fraction, text)

    return report
