# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands that render: `render`, `prepare`, and the background process of the window."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

from .arguments import (
    add_autoexec,
    add_option,
    add_progress,
    frame_list,
    frame_text,
    integer,
    resolution,
    whole_number,
)
from .bpy_module import require_bpy
from .earlier_results import was_skipped
from .job_options import BEYOND_FRAME, DEFAULT_PRESET, ENGINES, RENDERED, JobOptions
from .prepared import FILE
from .progress import Progress, printable
from .render_task import COMMAND
from .settings_arguments import add_settings, given_settings

# Key frames of a shot
_DEFAULT_KEYS, _MOST_KEYS = 5, 16


def add_render(commands: Any, *, inside_blender: bool) -> None:
    """Add the command that renders frames, and the one for the window's background process."""
    parser = commands.add_parser(
        "render",
        help="render a scene's direct light and add the indirect light to it",
        description="Frames that are there already, of the same settings, versions and scene file, are "
        "skipped: a run that was stopped goes on by the same command. Of other ones nothing is touched, and "
        "the command fails, unless --overwrite is given.",
    )
    _add_scene(parser, inside_blender=inside_blender)
    _add_captures(parser)
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--frame", metavar="N", type=lambda text: (whole_number(text),), dest="frames", help="one frame"
    )
    _add_frames(frames, "the current one")
    world = parser.add_mutually_exclusive_group()
    world.add_argument(
        "--shot",
        metavar="SHOT",
        type=Path,
        default=argparse.SUPPRESS,
        help="folder that `prepare` wrote with the same settings: its captures serve all frames",
    )
    add_option(world, "--keep-world", JobOptions, "keep_world")
    add_option(parser, "--compare", JobOptions, "compare")
    add_option(parser, "--reference-samples", JobOptions, "reference_samples", metavar="N")
    add_option(parser, "--passes", JobOptions, "save_passes")
    _add_rest(parser)
    parser.set_defaults(run=_render, fail=parser.error)
    # For itself alone, so it stands in no help
    worker = commands.add_parser(COMMAND)
    worker.add_argument("task", type=Path)
    worker.set_defaults(run=_work)


def add_prepare(commands: Any, *, inside_blender: bool) -> None:
    """Add the command that captures what the frames of a shot share."""
    parser = commands.add_parser(
        "prepare",
        help="capture once what all frames of a shot share, for render --shot",
        description="Give the settings that the frames are rendered with. A shot that is there already, of "
        "the same settings, versions and scene file, is left as it is, whatever its key frames.",
    )
    _add_scene(parser, inside_blender=inside_blender)
    _add_captures(parser)
    _add_frames(parser, "all of the scene")
    parser.add_argument(
        "--keys",
        metavar="N",
        type=integer(1, _MOST_KEYS),
        default=_DEFAULT_KEYS,
        help="key frames to capture, spread evenly: more where the camera goes farther "
        f"(default: {_DEFAULT_KEYS})",
    )
    _add_rest(parser)
    parser.set_defaults(run=_prepare)


def _add_scene(parser: argparse.ArgumentParser, *, inside_blender: bool) -> None:
    scene_help = "the .blend file" + ("; without it, the open one" if inside_blender else "")
    parser.add_argument(
        "scene", metavar="SCENE.blend", type=Path, nargs="?" if inside_blender else None, help=scene_help
    )
    parser.add_argument("--output", metavar="DIR", type=Path, required=True, help="folder for the results")


def _add_captures(parser: argparse.ArgumentParser) -> None:
    """Add what decides how a frame is captured and computed."""
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default=ENGINES[0],
        help=f"renders the direct light (default: {ENGINES[0]})",
    )
    add_settings(parser, default=DEFAULT_PRESET)
    parser.add_argument(
        "--resolution", metavar="WxH", type=resolution, help="size in pixels (default: the scene's)"
    )
    of_presets = tuple(RENDERED[DEFAULT_PRESET])
    for name in dict.fromkeys((*of_presets, *BEYOND_FRAME)):
        default = "the preset's" if name in of_presets else None
        metavar = None if name == "denoiser" else "N"
        add_option(parser, "--" + name.replace("_", "-"), JobOptions, name, metavar=metavar, default=default)


def _add_frames(parser: Any, default: str) -> None:
    parser.add_argument(
        "--frames",
        metavar="LIST",
        type=frame_list,
        help=f"frames and ranges FIRST-LAST or FIRST-LAST:STEP, such as 1-4,7,10-48:2 (default: {default})",
    )


def _add_rest(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--overwrite", action="store_true", help="replace results that are there already")
    add_progress(parser)
    add_autoexec(parser)


def _options(arguments: argparse.Namespace) -> JobOptions:
    given = {
        item.name: getattr(arguments, item.name) for item in fields(JobOptions) if item.name in arguments
    }
    given["settings"] = given_settings(arguments)
    return JobOptions.preset(arguments.preset or DEFAULT_PRESET, resume=True, **given)


def _render(arguments: argparse.Namespace, progress: Progress) -> None:
    if "reference_samples" in arguments and "compare" not in arguments:
        arguments.fail("--reference-samples needs --compare")
    require_bpy()
    from .blender.job import run_job

    report = run_job(arguments.scene, _options(arguments), progress)
    progress.close()
    for frame in report["frames"]:
        if was_skipped(frame):
            print(f"frame {frame['frame']}: there already")
            continue
        print(f"frame {frame['frame']}: {frame['seconds']['total']:.1f} s")
        if frame.get("metrics"):
            print_metrics(frame["metrics"])
    for note in dict.fromkeys(note for frame in report["frames"] for note in frame.get("notes", ())):
        print(f"note: {printable(note)}")
    print(f"results: {printable(arguments.output)}")


def _prepare(arguments: argparse.Namespace, progress: Progress) -> None:
    require_bpy()
    from .blender.prepare import prepare_shot

    is_there = not arguments.overwrite and (arguments.output / FILE).exists()
    shot = prepare_shot(arguments.scene, _options(arguments), arguments.keys, progress)
    progress.close()
    print(f"key frames: {frame_text(shot.worlds)}{', there already' if is_there else ''}")
    share, covered = shot.tuned.fill_share, shot.tuned.covered
    print(
        f"each frame renders {share:.0%} of its fill: the key frames' fills bring {covered:.0%} of it or more"
    )
    print(f"shot: {printable(arguments.output)}")


def _work(arguments: argparse.Namespace, _: Progress) -> None:
    require_bpy()
    from .blender.render_worker import work

    work(arguments.task)


def print_metrics(rows: dict[str, dict[str, float | None]]) -> None:
    """Print a table of error figures, a row for each picture."""
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    print(f"{'':14}" + "".join(f"{name:>12}" for name in names))
    for title, row in rows.items():
        values = (row.get(name) for name in names)
        cells = ("-" if value is None else f"{value:.4g}" for value in values)
        print(f"{title:14}" + "".join(f"{cell:>12}" for cell in cells))
