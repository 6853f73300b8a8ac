# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one parser for ``ssgi``, ``python -m ssgi_addon`` and ``blender --command ssgi``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NoReturn

from . import __version__
from .arguments import add_autoexec, add_option, frame_range, integer, resolution, whole_number
from .bench.command import add_bench
from .bpy_module import leave, require_bpy
from .child import ERROR_MARK
from .core import Settings
from .core.metrics import KNOWN_ENOUGH, compare_images
from .core.settings import PRESETS, DiffuseSettings, ReflectionSettings
from .earlier_results import was_skipped
from .errors import SSGIError
from .exr import FloatArray, Pixels, read_layers
from .files import check_writable
from .heatmap import error_map
from .job_options import BEYOND_FRAME, DEFAULT_PRESET, ENGINES, RENDERED, JobOptions
from .passes import remembered_settings
from .png import write_png
from .progress import Progress, printable
from .render_task import COMMAND
from .results import OUT_OF_MEMORY, apply_passes
from .shot.command import add_merge

DONE, FAILED, BAD_USAGE = 0, 1, 2


def main(argv: Sequence[str] | None = None, *, inside_blender: bool = False) -> int:
    """Run one command.

    Parameters
    ----------
    argv
        Arguments without the program's name; None means those of the process.
    inside_blender
        A scene is open already, so `render` may be given none.

    Returns
    -------
    int
        0: done, 1: the work failed (one line on standard error says why), 2: bad usage.
    """
    parser = build_parser(inside_blender=inside_blender)
    progress = Progress()
    try:
        arguments = parser.parse_args(argv)
        arguments.run(arguments, progress)
    except SystemExit as exit_:  # argparse: 0 after --help, 2 after bad usage
        return exit_.code if isinstance(exit_.code, int) else BAD_USAGE
    except SSGIError as error:
        return _fail(progress, str(error))
    except MemoryError:
        return _fail(progress, OUT_OF_MEMORY)
    except KeyboardInterrupt:
        return _fail(progress, "stopped")
    finally:
        progress.close()
    return DONE


def _fail(progress: Progress, reason: str) -> int:
    progress.close()
    print(f"{ERROR_MARK}{printable(reason)}", file=sys.stderr)
    return FAILED


def console() -> None:
    """Entry point of the installed ``ssgi`` command."""
    leave(main())


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; the usage is a `--help` away."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_USAGE, f"{ERROR_MARK}{printable(message)} (see {self.prog} --help)\n")


def build_parser(*, inside_blender: bool = False) -> argparse.ArgumentParser:
    """Return the parser; each command's function stands in ``run`` of its result."""
    parser = _Parser(
        prog="blender --command ssgi" if inside_blender else "ssgi",
        description="Screen-space global illumination for Blender.",
        epilog="Exit codes: 0 done, 1 the work failed, 2 bad usage.",
    )
    parser.add_argument("--version", action="version", version=f"ssgi {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_render(commands, inside_blender=inside_blender)
    add_merge(commands)
    _add_apply(commands)
    _add_compare(commands)
    add_bench(commands, inside_blender=inside_blender)
    _add_demo(commands)
    return parser


def _add_render(commands: Any, *, inside_blender: bool) -> None:
    parser = commands.add_parser(
        "render", help="render a scene's direct light and add the indirect light to it"
    )
    scene_help = "the .blend file" + ("; without it, the open one" if inside_blender else "")
    parser.add_argument(
        "scene", metavar="SCENE.blend", type=Path, nargs="?" if inside_blender else None, help=scene_help
    )
    parser.add_argument("--output", metavar="DIR", type=Path, required=True, help="folder for the results")
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default=ENGINES[0],
        help=f"renders the direct light (default: {ENGINES[0]})",
    )
    _add_settings(parser, default=DEFAULT_PRESET)
    parser.add_argument(
        "--resolution", metavar="WxH", type=resolution, help="size in pixels (default: the scene's)"
    )
    of_presets = tuple(RENDERED[DEFAULT_PRESET])
    for name in dict.fromkeys((*of_presets, *BEYOND_FRAME)):
        default = "the preset's" if name in of_presets else None
        metavar = None if name == "denoiser" else "N"
        add_option(parser, "--" + name.replace("_", "-"), JobOptions, name, metavar=metavar, default=default)
    add_option(parser, "--keep-world", JobOptions, "keep_world")
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--frame", metavar="N", type=lambda text: (whole_number(text),), dest="frames", help="one frame"
    )
    frames.add_argument("--frames", metavar="A-B[:STEP]", type=frame_range, help="a range of frames")
    add_option(parser, "--compare", JobOptions, "compare")
    add_option(parser, "--reference-samples", JobOptions, "reference_samples", metavar="N")
    add_option(parser, "--passes", JobOptions, "save_passes")
    earlier = parser.add_mutually_exclusive_group()
    earlier.add_argument("--overwrite", action="store_true", help="replace results that are there already")
    earlier.add_argument(
        "--resume",
        action="store_true",
        help="skip frames whose result is there already; to go on after a stop. Refused where they were "
        "rendered with other settings",
    )
    add_autoexec(parser)
    parser.set_defaults(run=_render, fail=parser.error)
    # The background process of the window; for itself alone, so it stands in no help
    worker = commands.add_parser(COMMAND)
    worker.add_argument("task", type=Path)
    worker.set_defaults(run=_work)


def _add_apply(commands: Any) -> None:
    parser = commands.add_parser("apply", help="add the indirect light to rendered passes; needs no Blender")
    parser.add_argument("passes", metavar="PASSES.exr", type=Path, help="multilayer EXR file with the passes")
    parser.add_argument("--output", metavar="FILE.exr", type=Path, required=True, help="the result")
    parser.add_argument(
        "--camera", metavar="FILE.json", type=Path, help="the camera (default: beside the passes, or solved)"
    )
    _add_settings(parser, default=None)
    parser.set_defaults(run=_apply)


def _add_compare(commands: Any) -> None:
    parser = commands.add_parser("compare", help="measure a picture's error; needs no Blender")
    parser.add_argument("image", metavar="IMAGE.exr", type=Path, help="the picture")
    parser.add_argument("reference", metavar="REFERENCE.exr", type=Path, help="what it should look like")
    parser.add_argument("--heatmap", metavar="FILE.png", type=Path, help="write a picture of the error")
    parser.set_defaults(run=_compare)


def _add_demo(commands: Any) -> None:
    parser = commands.add_parser(
        "demo", help="build the demo scene, run the whole job on it, show it beside the truth"
    )
    parser.add_argument(
        "--output",
        metavar="DIR",
        type=Path,
        default=Path("demo"),
        help="folder for the results (default: demo)",
    )
    parser.set_defaults(run=_demo)


def _add_settings(parser: argparse.ArgumentParser, *, default: str | None) -> None:
    """Add what the command line offers of the settings, with ranges and texts from their one declaration."""
    otherwise = default or f"as the passes were rendered with, else {DEFAULT_PRESET}"
    parser.add_argument(
        "--preset", choices=tuple(PRESETS), help=f"point between speed and accuracy (default: {otherwise})"
    )
    rules = [
        next(item.metadata for item in fields(kind) if item.name == "rays")
        for kind in (DiffuseSettings, ReflectionSettings)
    ]
    lowest, highest = max(rule["min"] for rule in rules), min(rule["max"] for rule in rules)
    parser.add_argument(
        "--rays",
        metavar="N",
        type=integer(int(lowest), int(highest)),
        help=f"{rules[0]['unit']}, diffuse and glossy each (default: the preset's); a fill then only sets "
        "their level, unless --fill-mode says otherwise",
    )
    add_option(parser, "--fill-mode", Settings, "fill_mode", default="the preset's")


def _settings(arguments: argparse.Namespace, base: Settings | None = None) -> Settings:
    """Settings by preset, or `base` where none is named, with the number of rays where it is."""
    settings = base if base and not arguments.preset else Settings.preset(arguments.preset or DEFAULT_PRESET)
    fill_mode = getattr(arguments, "fill_mode", settings.fill_mode if arguments.rays is None else "level")
    settings = replace(settings, fill_mode=fill_mode)
    if arguments.rays is None:
        return settings
    return replace(
        settings,
        diffuse=replace(settings.diffuse, rays=arguments.rays),
        reflections=replace(settings.reflections, rays=arguments.rays),
    )


def _render(arguments: argparse.Namespace, progress: Progress) -> None:
    given = {
        item.name: getattr(arguments, item.name) for item in fields(JobOptions) if item.name in arguments
    }
    if "reference_samples" in given and "compare" not in given:
        arguments.fail("--reference-samples needs --compare")
    require_bpy()
    from .blender.job import run_job

    given["settings"] = _settings(arguments)
    options = JobOptions.preset(arguments.preset or DEFAULT_PRESET, **given)
    report = run_job(arguments.scene, options, progress)
    progress.close()
    for frame in report["frames"]:
        if was_skipped(frame):
            print(f"frame {frame['frame']}: there already")
            continue
        print(f"frame {frame['frame']}: {frame['seconds']['total']:.1f} s")
        if frame.get("metrics"):
            _print_metrics(frame["metrics"])
    for note in dict.fromkeys(note for frame in report["frames"] for note in frame.get("notes", ())):
        print(f"note: {printable(note)}")
    print(f"results: {printable(arguments.output)}")


def _work(arguments: argparse.Namespace, _: Progress) -> None:
    require_bpy()
    from .blender.render_worker import work

    work(arguments.task)


def _apply(arguments: argparse.Namespace, progress: Progress) -> None:
    settings = _settings(arguments, remembered_settings(arguments.passes))
    apply_passes(arguments.passes, arguments.output, arguments.camera, settings, progress)
    progress.close()
    print(f"result: {printable(arguments.output)}")


def _compare(arguments: argparse.Namespace, progress: Progress) -> None:
    if arguments.heatmap is not None:
        check_writable(arguments.heatmap.parent)
        if arguments.heatmap.suffix.lower() != ".png":
            raise SSGIError(f"{arguments.heatmap} should end in .png: the error map is a PNG file")
    layers = read_layers(arguments.image)
    image = _picture(arguments.image, layers)
    reference = _picture(arguments.reference, read_layers(arguments.reference))
    if image.shape != reference.shape:
        sizes = " and ".join(f"{picture.shape[1]} x {picture.shape[0]}" for picture in (image, reference))
        raise SSGIError(f"the pictures differ in size ({sizes} pixels): render them alike")
    try:
        rows = {"combined": compare_images(image, reference)}
        known = layers.get("known")
        if known is not None and known.shape == image.shape[:2]:
            is_known = known >= KNOWN_ENOUGH
            rows[f"known >= {KNOWN_ENOUGH}"] = compare_images(image, reference, mask=is_known)
    except ValueError as error:
        raise SSGIError(f"cannot compare {arguments.image} with {arguments.reference}: {error}") from error
    if arguments.heatmap is not None:
        write_png(arguments.heatmap, error_map(image, reference))
    _print_metrics(rows)
    if arguments.heatmap is not None:
        print(f"error map: {printable(arguments.heatmap)}")


def _demo(arguments: argparse.Namespace, progress: Progress) -> None:
    require_bpy()
    from .blender.job import run_demo

    picture = run_demo(arguments.output, progress)
    progress.close()
    print(f"picture: {printable(picture)}")


def _picture(path: Path, layers: Pixels) -> FloatArray:
    """The finished picture of a file: ours, Blender's, or the only one that it holds."""
    pictures = {name: values for name, values in layers.items() if values.ndim == 3 and values.shape[2] == 3}
    for wanted in ("combined", "Combined"):
        for name, values in pictures.items():
            if name.rpartition(".")[2] == wanted:
                return values
    if len(pictures) == 1:
        return next(iter(pictures.values()))
    held = ", ".join(layers) or "nothing"
    raise SSGIError(f"{path} has no combined picture (it holds {held}): give the finished picture")


def _print_metrics(rows: dict[str, dict[str, float | None]]) -> None:
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    print(f"{'':14}" + "".join(f"{name:>12}" for name in names))
    for title, row in rows.items():
        values = (row.get(name) for name in names)
        cells = ("-" if value is None else f"{value:.4g}" for value in values)
        print(f"{title:14}" + "".join(f"{cell:>12}" for cell in cells))
