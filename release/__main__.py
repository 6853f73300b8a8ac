# SPDX-License-Identifier: GPL-3.0-or-later
"""`make package`: build the extension's archive, validate it, and say what is in it."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from .contents import describe, files_that_ship, problems
from .extension import ROOT, BuildError, build, stage
from .wheels import PLATFORMS, WheelError, fetch_wheels

WHEELS = ROOT / ".cache" / "wheels"


def main() -> int:
    """Return 0 if all archives are as they should be."""
    parser = argparse.ArgumentParser(prog="make package ARGS=...", description=__doc__)
    parser.add_argument("--output", metavar="DIR", type=Path, default=ROOT / "dist", help="default: dist")
    parser.add_argument(
        "--no-wheels",
        action="store_true",
        help="for any Python and system: Blender's own OpenImageIO reads and writes the files",
    )
    parser.add_argument(
        "--split-platforms",
        action="store_true",
        help="an archive for each system, as repositories of extensions serve them",
    )
    arguments = parser.parse_args()
    if arguments.no_wheels and arguments.split_platforms:
        parser.error("without wheels the archive is the same for all systems")
    try:
        wheels = [] if arguments.no_wheels else fetch_wheels(WHEELS)
        with tempfile.TemporaryDirectory(prefix="ssgi-package-") as folder:
            source = Path(folder) / "ssgi"
            stage(source, wheels, tuple(PLATFORMS) if arguments.split_platforms else ())
            archives = build(source, arguments.output, split=arguments.split_platforms)
    except WheelError as error:
        print(f"ssgi: error: {error}\nARGS=--no-wheels builds the extension without them", file=sys.stderr)
        return 1
    except BuildError as error:
        print(f"ssgi: error: {error}", file=sys.stderr)
        return 1
    found = []
    for archive in archives:
        print(describe(archive))
        lines = problems(archive, files_that_ship(), has_wheels=bool(wheels))
        found += [f"{archive.name}: {line}" for line in lines]
    print(*found, sep="\n", end="\n" if found else "", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
