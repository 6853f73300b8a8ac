# SPDX-License-Identifier: GPL-3.0-or-later
"""The command ``bench`` of the command line, and the one that its processes run."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..arguments import add_autoexec, add_option, resolution
from ..bpy_module import require_bpy
from ..progress import Progress, printable
from .options import QUICK_MINUTES, QUICK_REFERENCE_SAMPLES, QUICK_REPEATS, BenchOptions
from .tasks import COMMAND


def add_bench(commands: Any, *, inside_blender: bool) -> None:
    """Add the commands to the subparsers of the command line; ``run`` of the result does the work."""
    parser = commands.add_parser(
        "bench", help="measure error against time: Cycles, its denoisers and shortcuts, EEVEE, and ours"
    )
    parser.add_argument("--output", metavar="DIR", type=Path, required=True, help="folder for the report")
    parser.add_argument(
        "--scenes",
        metavar="NAME",
        nargs="+",
        default=(),
        help="the demo, .blend files, or names in the folder that SSGI_SCENES names (default: all of those, "
        "else the demo)",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="one scene unless some are named, fewer methods, repeats and samples, "
        f"{QUICK_MINUTES:g} minutes a scene",
    )
    parser.add_argument(
        "--methods", metavar="WORD", nargs="+", default=(), help="only methods whose name holds one of these"
    )
    default = BenchOptions.resolution
    parser.add_argument(
        "--resolution",
        metavar="WxH",
        type=resolution,
        default=default,
        help=f"size in pixels (default: {default[0]}x{default[1]})",
    )
    for name, metavar in (("repeats", "N"), ("reference_samples", "N"), ("minutes", "MINUTES")):
        flag = "--budget" if name == "minutes" else "--" + name.replace("_", "-")
        add_option(parser, flag, BenchOptions, name, metavar=metavar)
    add_option(parser, "--cold", BenchOptions, "cold")
    add_option(parser, "--flicker", BenchOptions, "flicker")
    parser.add_argument(
        "--cache",
        metavar="DIR",
        type=Path,
        help="keeps the references (default: .cache/references beside DIR)",
    )
    parser.add_argument("--fresh", action="store_true", help="measure again what is measured already")
    add_autoexec(parser)
    parser.set_defaults(run=_bench, fail=parser.error, inside_blender=inside_blender)
    # One process of a run; for itself alone, so it stands in no help
    worker = commands.add_parser(COMMAND)
    worker.add_argument("task", type=Path)
    worker.set_defaults(run=_work)


def _bench(arguments: argparse.Namespace, progress: Progress) -> None:
    given = {
        item.name: getattr(arguments, item.name) for item in fields(BenchOptions) if item.name in arguments
    }
    if arguments.quick:
        quick = {
            "repeats": QUICK_REPEATS,
            "reference_samples": QUICK_REFERENCE_SAMPLES,
            "minutes": QUICK_MINUTES * max(1, len(arguments.scenes)),
        }
        given = {**quick, **given}
        if "flicker" in given:
            arguments.fail("--quick leaves out --flicker")
    given |= {name: tuple(given[name]) for name in ("scenes", "methods")}
    blender = ""
    require_bpy()
    if arguments.inside_blender:
        import bpy

        blender = bpy.app.binary_path
    from .run import run_bench

    page = run_bench(BenchOptions(**given), progress, blender=blender)
    progress.close()
    print(f"report: {printable(page)}")


def _work(arguments: argparse.Namespace, _: Progress) -> None:
    require_bpy()
    from ..blender.bench_worker import work

    work(arguments.task)
