# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one parser for ``ssgi``, ``python -m ssgi_addon`` and ``blender --command ssgi``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from . import __version__
from .bench.command import add_bench
from .bpy_module import leave, require_bpy
from .child import ERROR_MARK
from .core.metrics import KNOWN_ENOUGH, compare_images
from .errors import SSGIError
from .exr import FloatArray, Pixels, read_layers
from .files import check_writable
from .heatmap import error_map
from .passes import remembered_settings
from .png import write_png
from .progress import STYLES, Progress, printable
from .render_command import add_prepare, add_render, print_metrics
from .results import OUT_OF_MEMORY, apply_passes
from .settings_arguments import add_settings, given_settings
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
    progress = Progress()
    try:
        arguments = build_parser(inside_blender=inside_blender).parse_args(argv)
        progress = Progress(getattr(arguments, "progress", STYLES[0]))
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
    progress.fail(reason)
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
    add_render(commands, inside_blender=inside_blender)
    add_prepare(commands, inside_blender=inside_blender)
    add_merge(commands)
    _add_apply(commands)
    _add_compare(commands)
    add_bench(commands, inside_blender=inside_blender)
    _add_demo(commands)
    return parser


def _add_apply(commands: Any) -> None:
    parser = commands.add_parser("apply", help="add the indirect light to rendered passes; needs no Blender")
    parser.add_argument("passes", metavar="PASSES.exr", type=Path, help="multilayer EXR file with the passes")
    parser.add_argument("--output", metavar="FILE.exr", type=Path, required=True, help="the result")
    parser.add_argument(
        "--camera", metavar="FILE.json", type=Path, help="the camera (default: beside the passes, or solved)"
    )
    add_settings(parser, default=None)
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


def _apply(arguments: argparse.Namespace, progress: Progress) -> None:
    settings = given_settings(arguments, remembered_settings(arguments.passes))
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
    print_metrics(rows)
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
