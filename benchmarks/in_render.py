# SPDX-License-Identifier: GPL-3.0-or-later
"""What the light in ordinary renders costs besides its passes: reading, preparing, writing back.

Two renders in turn, several rounds: Cycles alone, without diffuse and glossy bounces and with the passes that
the scene has, and the same with our light. What is not the passes' is the overhead, twice: as the difference
of the two renders, where the machine's moods count, too, and as the time that our method of the render takes
around Cycles and the passes. Seconds are wall time and processor time of all threads; the latter depends less
on what else the machine does. Run from the repository's root:

    python -m benchmarks.in_render [--scene classroom] [--size 1920x1080] [--samples 16] [--rounds 1]
        [--preset balanced] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import bpy

from benchmarks import record
from benchmarks.inputs import SCENES, parse_size
from ssgi_addon import properties
from ssgi_addon.blender import in_render
from ssgi_addon.blender.cycles_passes import cycles_engine
from ssgi_addon.blender.scene_file import open_scene
from ssgi_addon.core.settings import PRESETS


class Watch:
    """Adds up the time of calls."""

    def __init__(self) -> None:
        self.wall = self.processor = 0.0

    def timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return `function` with its time counted."""

        def call(*arguments: Any, **options: Any) -> Any:
            wall, processor = time.perf_counter(), time.process_time()
            try:
                return function(*arguments, **options)
            finally:
                self.wall += time.perf_counter() - wall
                self.processor += time.process_time() - processor

        return call


@dataclass(frozen=True)
class Costs:
    """Seconds of one round, of one kind of time.

    Attributes
    ----------
    plain, light
        Of the whole render without and with our light.
    passes
        Of `compute_picture`.
    around
        Of our method, without Cycles and without the passes.
    """

    plain: float
    light: float
    passes: float
    around: float

    @property
    def overhead(self) -> float:
        """Difference of the renders that is not the passes', relative to the plain one."""
        return (self.light - self.passes - self.plain) / self.plain

    @property
    def share_around(self) -> float:
        """`around`, relative to the plain render."""
        return self.around / self.plain


def measure(scene: bpy.types.Scene) -> dict[str, Costs]:
    """Render once without and once with our light; return the costs by kind of time."""
    whole, cycles, method, passes = {}, Watch(), Watch(), Watch()
    bounces = {"diffuse_bounces": 0, "glossy_bounces": 0, "use_fast_gi": False}
    for name, value in bounces.items():
        setattr(scene.cycles, name, value)
    engine_class = cycles_engine()
    timed_render = cycles.timed(engine_class.render)

    def render(self: Any, depsgraph: bpy.types.Depsgraph) -> None:  # Blender counts its arguments
        timed_render(self, depsgraph)

    for is_on in (False, True):
        scene.ssgi.enabled = is_on
        watch = whole[is_on] = Watch()
        with (
            mock.patch.object(engine_class, "render", render),
            mock.patch.object(in_render, "_render", method.timed(in_render._render)),
            mock.patch.object(in_render, "compute_picture", passes.timed(in_render.compute_picture)),
        ):
            cycles.wall = cycles.processor = 0.0
            watch.timed(bpy.ops.render.render)(scene=scene.name)
    return {
        kind: Costs(
            plain=getattr(whole[False], kind),
            light=getattr(whole[True], kind),
            passes=getattr(passes, kind),
            around=getattr(method, kind) - getattr(cycles, kind) - getattr(passes, kind),
        )
        for kind in ("wall", "processor")
    }


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="classroom", help="a real scene")
    parser.add_argument("--size", type=parse_size, default=(1920, 1080), metavar="WIDTHxHEIGHT")
    parser.add_argument("--samples", type=int, default=16, help="of Cycles, per pixel")
    parser.add_argument("--preset", choices=PRESETS, default="balanced")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    arguments = parser.parse_args()
    properties.register()
    in_render.register()
    open_scene(SCENES / f"{arguments.scene}.blend")
    scene = bpy.context.scene
    scene.ssgi.preset = arguments.preset
    render = scene.render
    render.engine, render.use_compositing, render.resolution_percentage = "CYCLES", False, 100
    render.resolution_x, render.resolution_y = arguments.size
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = arguments.samples, False
    scene.cycles.use_denoising = False

    rounds = []
    print(f"{'':12}{'plain':>9}{'light':>9}{'passes':>9}{'around':>9}{'overhead':>10}{'around':>9}")
    for _ in range(arguments.rounds):
        costs = measure(scene)
        rounds.append(costs)
        for kind, one in costs.items():
            print(
                f"{kind:12}{one.plain:9.2f}{one.light:9.2f}{one.passes:9.2f}{one.around:9.2f}"
                f"{one.overhead:10.1%}{one.share_around:9.1%}",
                flush=True,
            )
    if arguments.output:
        parameters = {
            name: getattr(arguments, name) for name in ("scene", "size", "samples", "preset", "rounds")
        }
        results = [
            {
                kind: {**asdict(one), "overhead": one.overhead, "share_around": one.share_around}
                for kind, one in costs.items()
            }
            for costs in rounds
        ]
        record.store(arguments.output, parameters, results)


if __name__ == "__main__":
    main()
