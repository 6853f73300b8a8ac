# SPDX-License-Identifier: GPL-3.0-or-later
"""Kill a hundred runs at random moments: what they leave is old or new, and the next run finishes the rest.

python -m benchmarks.kills --output benchmarks/results/kills.json
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.record import store
from ssgi_addon.bpy_module import require_bpy
from tests.faults.fuzz_cli import large_passes
from tests.faults.kills import kill_applies, kill_renders, kill_windows

SEED = 20240229


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--renders", type=int, default=50)
    parser.add_argument("--applies", type=int, default=35)
    parser.add_argument("--windows", type=int, default=15, help="renders in the background of a window")
    parser.add_argument("--output", type=Path)
    arguments = parser.parse_args()
    rng = np.random.default_rng(SEED)
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        folder = Path(name)
        blend = _save_room(folder / "room.blend")
        kills = {
            "render": kill_renders(blend, folder / "render", arguments.renders, rng),
            "apply": kill_applies(large_passes(folder), folder / "apply", arguments.applies, rng),
            "window": kill_windows(blend, folder / "window", arguments.windows, rng),
        }
    for command, found in kills.items():
        print(f"{command}: {found.killed} killed, {found.finished} had ended before, faults: {found.faults}")
    parameters = {name: getattr(arguments, name) for name in ("renders", "applies", "windows")}
    if arguments.output:
        store(arguments.output, parameters, {name: asdict(found) for name, found in kills.items()})


def _save_room(path: Path) -> Path:
    """Save a room in which the camera moves, so that frames differ."""
    require_bpy()
    import bpy

    from tests.scenes import build_moving_room

    build_moving_room()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


if __name__ == "__main__":
    main()
