# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of one process over many frames, and over many registrations of the extension.

    python -m benchmarks.long_run --output benchmarks/results/long_run.json

Each case runs in a process of its own: a job of many small frames, the same frames rendered by Cycles alone,
and the extension registered and unregistered again and again.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.record import store
from ssgi_addon.bpy_module import require_bpy

ROOT = Path(__file__).resolve().parents[1]
SIZE = (64, 36)
# Frames, or registrations, before which everything has been loaded once
WARM = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--registrations", type=int, default=50)
    parser.add_argument("--case", choices=tuple(_CASES), help="run one case here, and print its numbers")
    parser.add_argument("--output", type=Path)
    arguments = parser.parse_args()
    counts = {"job": arguments.frames, "cycles": arguments.frames, "extension": arguments.registrations}
    if arguments.case:
        print(json.dumps(_CASES[arguments.case](counts[arguments.case])))
        return
    results = {}
    for case, count in counts.items():
        command = [sys.executable, "-m", "benchmarks.long_run", "--case", case]
        command += ["--frames", str(count), "--registrations", str(count)]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        resident = json.loads(done.stdout.splitlines()[-1])
        warm = resident[min(WARM, count // 2) - 1]
        results[case] = {"resident_mb": resident, "growth": resident[-1] / warm - 1.0}
        print(f"{case}: {warm:.1f} MB warm, {resident[-1]:.1f} MB at the end, {results[case]['growth']:+.1%}")
    if arguments.output:
        store(arguments.output, {"size": SIZE, "warm": WARM, **counts}, results)


def run_frames(count: int) -> list[float]:
    """Render frames by one job; return the resident memory after each, MB."""
    from ssgi_addon.blender.job import render_frames
    from ssgi_addon.job_options import JobOptions

    scene, resident = _moving_room(count), []

    def look(_fraction: float, text: str) -> None:
        if text == "Writing":
            resident.append(_resident_mb())

    with tempfile.TemporaryDirectory() as folder:
        options = JobOptions.preset("draft", Path(folder), resolution=SIZE, frames=tuple(range(1, count + 1)))
        render_frames(scene, options, look)
    return resident


def run_cycles(count: int) -> list[float]:
    """Render the same frames by Cycles alone."""
    import bpy

    scene, resident = _moving_room(count), []
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.use_persistent_data = True
    scene.cycles.samples = 1
    for frame in range(1, count + 1):
        scene.frame_set(frame)
        bpy.ops.render.render(scene=scene.name)
        resident.append(_resident_mb())
    return resident


def run_registrations(count: int) -> list[float]:
    """Register the extension and unregister it again; return the resident memory after each, MB."""
    require_bpy()
    spec = importlib.util.spec_from_file_location(
        "ssgi_extension", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
    )
    extension = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = extension
    spec.loader.exec_module(extension)
    resident = []
    for _ in range(count):
        extension.register()
        extension.unregister()
        resident.append(_resident_mb())
    return resident


def _moving_room(frames: int):
    require_bpy()
    import bpy

    from tests.scenes import build_moving_room

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return build_moving_room(frames)


def _resident_mb() -> float:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


_CASES: dict[str, Callable[[int], list[float]]] = {
    "job": run_frames,
    "cycles": run_cycles,
    "extension": run_registrations,
}

if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # how Blender ends as a module does not matter
