# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a frame comes out the same, bit for bit, however it is rendered.

    python -m benchmarks.same_frame --output benchmarks/results/same_frame.json

One frame of a scene whose camera moves is rendered in a fresh process, and again in others: once more, after
other frames in the same process, with other numbers of threads, beside processes that keep the cores busy,
and with the instructions of other processors. All layers of the result files are compared.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inputs import ROOT, parse_size
from benchmarks.record import store
from benchmarks.shot_job import moving_scene
from ssgi_addon.bpy_module import require_bpy
from ssgi_addon.exr import read_layers
from ssgi_addon.job_options import RENDERED

NAMES = ("bridge_garden", "bathroom", "classroom")
SIZE = (320, 180)
FRAME, FRAMES = 3, (1, 2, 3)
# What presets leave out, so that what is planned, and rendered beside the frame, is compared, too
WITH_VIEWS = {"mirrors_only": False, "surround": 128, "stations": 4, "back_faces": True, "budget": 1000.0}
METHODS: dict[str, tuple[str, dict[str, Any]]] = {
    **{preset: (preset, {}) for preset in RENDERED},
    "balanced with views": ("balanced", WITH_VIEWS),
}
_BUSY = [sys.executable, "-c", "while True: pass"]
# Instructions of the numeric libraries that processors without AVX-512 lack; Cycles uses none of them.
_NO_AVX512 = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Haswell",
}
# How a frame is rendered: fields of `_render`, how many processes keep the cores busy meanwhile, environment.
CASES: dict[str, tuple[dict[str, Any], int, dict[str, str]]] = {
    "alone": ({}, 0, {}),
    "once more": ({}, 0, {}),
    "after other frames": ({"frames": FRAMES}, 0, {}),
    "1 thread": ({"threads": 1}, 0, {}),
    "2 threads": ({"threads": 2}, 0, {}),
    "8 threads": ({"threads": 8}, 0, {}),
    "busy machine": ({}, 4, {}),
    "numpy without AVX-512": ({}, 0, _NO_AVX512),
    "Cycles without AVX2": ({}, 0, {"CYCLES_CPU_NO_AVX2": "1"}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=NAMES)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=tuple(METHODS))
    parser.add_argument("--cases", nargs="+", choices=list(CASES)[1:], default=list(CASES)[1:])
    parser.add_argument("--size", type=parse_size, default=SIZE)
    parser.add_argument("--output", type=Path, help="written after each method; what it has else is kept")
    parser.add_argument("--step", help="do one step here, given as JSON")
    arguments = parser.parse_args()
    if arguments.step:
        _render(**json.loads(arguments.step))
        return
    parameters = {"size": arguments.size, "frame": FRAME, "after": FRAMES, "views": WITH_VIEWS}
    results: dict[str, dict[str, dict[str, Any]]] = {}
    if arguments.output and arguments.output.exists():
        results = json.loads(arguments.output.read_text())["results"]
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.scenes:
            blend = moving_scene(name, Path(folder), max(FRAMES), at=FRAME)
            for method in arguments.methods:
                found = _compared(blend, method, arguments.size, arguments.cases)
                results.setdefault(name, {})[method] = found
                if arguments.output:
                    store(arguments.output, parameters, results)


def differences(first: Mapping[str, np.ndarray], second: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return of each layer that differs the share of its pixels, and by how much at most.

    Relative differences are to the larger of two values, and to the layer's mean.
    """
    if first.keys() != second.keys():
        raise ValueError(f"expected the same layers, got {sorted(first)} and {sorted(second)}")
    found = {}
    for name, one in first.items():
        other = second[name]
        if np.array_equal(one, other):
            continue
        apart = np.abs(one.astype(np.float64) - other)
        larger = np.maximum(np.maximum(np.abs(one), np.abs(other)), np.finfo(np.float32).tiny)
        is_other = (one != other).reshape(*one.shape[:2], -1).any(axis=-1)
        found[name] = {
            "pixels": float(is_other.mean()),
            "largest_relative": float((apart / larger).max()),
            "largest_to_mean": float(apart.max() / np.abs(one).mean(dtype=np.float64)),
            "mean_to_mean": float(apart.mean() / np.abs(one).mean(dtype=np.float64)),
        }
    return found


def _compared(blend: Path, method: str, size: tuple[int, int], cases: list[str]) -> dict[str, Any]:
    """Render a frame in every way; return how each differs from the frame alone in a fresh process."""
    layers, found = {}, {}
    for case in ("alone", *cases):
        changes, busy, environment = CASES[case]
        with tempfile.TemporaryDirectory() as folder, _busy_cores(busy):
            step = {"blend": str(blend), "method": method, "size": size, "output": folder}
            _run({**step, **changes}, environment)
            layers[case] = read_layers(Path(folder) / f"{blend.stem}_{FRAME:04d}.exr")
        if case != "alone":
            found[case] = differences(layers["alone"], layers[case])
            print(f"{blend.stem}, {method}, {case}: {_told(found[case])}", flush=True)
    return found


def _told(found: Mapping[str, Mapping[str, float]]) -> str:
    told = [
        f"{name} {layer['pixels']:.2%} of the pixels, by {layer['largest_relative']:.1e} at most "
        f"({layer['largest_to_mean']:.1e} of the mean)"
        for name, layer in found.items()
    ]
    return "; ".join(told) or "the same"


@contextmanager
def _busy_cores(count: int) -> Iterator[None]:
    processes = [subprocess.Popen(_BUSY) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _run(step: Mapping[str, Any], environment: Mapping[str, str] | None = None) -> None:
    """Do a step in a process of its own."""
    # No preferences and no extensions of the user
    own = {"BLENDER_USER_RESOURCES": str(ROOT / ".cache" / "blender"), **os.environ, **(environment or {})}
    command = [sys.executable, "-m", "benchmarks.same_frame", "--step", json.dumps(step)]
    done = subprocess.run(command, cwd=ROOT, env=own, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if done.returncode:
        raise SystemExit(done.stdout.decode(errors="replace"))


def _render(
    blend: str,
    method: str,
    size: tuple[int, int],
    output: str,
    frames: tuple[int, ...] = (FRAME,),
    threads: int | None = None,
) -> None:
    """Render frames as `ssgi render --no-keep-world` does."""
    require_bpy()
    import bpy

    from ssgi_addon.blender.job import render_frames
    from ssgi_addon.blender.scene_file import open_scene
    from ssgi_addon.job_options import JobOptions

    preset, changes = METHODS[method]
    options = JobOptions.preset(
        preset, Path(output), resolution=tuple(size), frames=tuple(frames), keep_world=False
    )
    options = replace(options, **changes, settings=replace(options.settings, threads=threads))
    open_scene(Path(blend))
    scene = bpy.context.scene
    if threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", threads
    render_frames(scene, options)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # how Blender ends as a module does not matter
