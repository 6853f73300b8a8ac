# SPDX-License-Identifier: GPL-3.0-or-later
"""The job: render frames of a scene, one after the other, and report them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy

from ..arguments import frame_text
from ..earlier_results import check_output, finished_frames
from ..errors import OutputError, SSGIError
from ..files import check_writable, write_json
from ..job_options import JobOptions
from ..manifest import write_failure
from ..memory import RENDER_BYTES, check_memory
from ..prepared import Shot
from ..recipe import Recipe
from ..results import OUT_OF_MEMORY
from . import demo_scene
from .camera import full_size
from .kept_world import KeptWorld
from .one_frame import (
    FrameResult,
    Report,
    frame_stems,
    made_with,
    part,
    render_one,
    scene_name,
    told_settings,
    versions,
)
from .prepare import shot_recipe
from .prepared_world import PreparedWorld
from .render_settings import borrow_kept_data, find_view_layer
from .restore import Restorer
from .scene_file import content_hash, opened_scene

Progress = Callable[[float, str], None]

_DEMO_SIZE = (640, 360)
_DEMO_REFERENCE_SAMPLES = 64


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
    scene = opened_scene(scene_path, enable_autoexec=options.enable_autoexec)
    report, _ = render_frames(scene, options, progress, content_hash())
    return report


def render_frames(
    scene: bpy.types.Scene,
    options: JobOptions,
    progress: Progress | None = None,
    scene_files: str | None = None,
) -> tuple[Report, list[FrameResult]]:
    """Render frames of an open scene; the report is written after each.

    A frame that fails does not keep the others from being rendered, unless results cannot be written.
    Parameters and errors are those of `run_job`.

    Parameters
    ----------
    scene_files
        As of `content_hash`, where the scene is what its files hold; None does not tell.
    """
    stems = frame_stems(scene, options)
    if not scene.render.use_border:
        check_memory(options.resolution or full_size(scene), RENDER_BYTES)
    shot = None
    if options.shot is not None:
        shot = Shot(options.shot)
        shot.refuse_others(shot_recipe(scene, options, scene_files))
    recipe = made_with(scene, find_view_layer(scene), options, scene_files, shot and shot.hash)
    check_output(options, stems, recipe)
    job = _Job(scene, options, recipe, finished_frames(options, stems, recipe), list(stems))
    frames = [frame for frame in stems if frame not in job.records]
    kept: KeptWorld | None = None
    if shot is not None:
        kept = PreparedWorld(shot)
    elif options.keep_world and len(frames) > 1:
        kept = KeptWorld()
    with Restorer() as restorer:
        borrow_kept_data(restorer, scene, options.engine)
        for index, frame in enumerate(frames):
            job.render(frame, part(progress, index / len(frames), 1.0 / len(frames)), kept)
    if not frames:
        job.write_report()
    job.raise_failures()
    return job.report, job.results


class _Job:
    """Frames that are rendered one after the other, and what is told of them."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        options: JobOptions,
        recipe: Recipe,
        records: dict[int, Report],
        frames: list[int],
    ) -> None:
        self.scene, self.options, self.recipe, self.records, self.frames = (
            scene, options, recipe, records, frames
        )  # fmt: skip
        self.results: list[FrameResult] = []
        self.failures: dict[int, str] = {}
        self.report: Report = {"versions": versions(), "settings": told_settings(options)}

    def render(self, frame: int, progress: Progress, kept: KeptWorld | None) -> None:
        """Render a frame, or note why it failed."""
        try:
            result = render_one(self.scene, frame, self.options, self.recipe, progress, kept)
        except OutputError:
            raise
        except SSGIError as error:
            self._note_failure(frame, error)
        except MemoryError:
            self._note_failure(frame, SSGIError(OUT_OF_MEMORY))
        else:
            self.results.append(result)
            self.records[frame] = result.record
            self.write_report()

    def _note_failure(self, frame: int, error: SSGIError) -> None:
        self.failures[frame] = str(error)
        if self.options.output.exists():  # what brought nothing makes no folder
            write_failure(self.options.output, scene_name(), frame, str(error), self.recipe, versions())
            self.write_report()

    def write_report(self) -> None:
        """Write what is known so far."""
        self.report["frames"] = [self.records[number] for number in self.frames if number in self.records]
        if self.failures:
            self.report["failures"] = [{"frame": frame, "why": why} for frame, why in self.failures.items()]
        write_json(self.options.output / "report.json", self.report)

    def raise_failures(self) -> None:
        """Raise the first failure, with the frames that failed where there were more."""
        if not self.failures:
            return
        reason = next(iter(self.failures.values()))
        if len(self.frames) > 1:
            reason = f"frames {frame_text(self.failures)} of {len(self.frames)} failed: {reason}"
        raise SSGIError(reason)


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
