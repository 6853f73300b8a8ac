# SPDX-License-Identifier: GPL-3.0-or-later
"""Does cost follow need? Frames that need less, timed in turn beside the same frames that need all.

Every frame alone, of a preset; seconds are the best of several rounds, in each of which all variants of all
frames are run one after the other. Run from the repository's root:

    python -m benchmarks.need [--scenes living_room ...] [--size 480x270] [--preset draft] [--rounds 5]
        [--output FILE.json]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.beyond_frame import CONFIGURATIONS
from benchmarks.inputs import parse_size
from benchmarks.wide_frame import wide_frame
from ssgi_addon.core import Camera, Environment, GBuffer, Settings, render_indirect
from ssgi_addon.core.planner import plan_passes
from ssgi_addon.core.settings import PRESETS

# A frame of surfaces that are alike everywhere, so that half of it is half of the work
EVEN = "even_frame"
_SCENES = (EVEN, "living_room", "classroom")
# What a frame that needs less may cost, as a share of one that needs all
TARGETS = {"reflections without gloss": 0.01, "upper half sky": 0.6, "planner": 0.02}


@dataclass(frozen=True)
class Need:
    """Times of one frame.

    Attributes
    ----------
    seconds
        Of the whole frame, and of its variants: all, no gloss, upper half sky, all black.
    rays
        Of the same, all kinds together.
    without_gloss
        Seconds of the reflections, where nothing is glossy, as a share of that frame's.
    planner
        Seconds of the planner.
    """

    scene: str
    seconds: Mapping[str, float]
    rays: Mapping[str, int]
    without_gloss: float
    planner: float

    @property
    def shares(self) -> dict[str, float]:
        """What `TARGETS` limits."""
        return {
            "reflections without gloss": self.without_gloss,
            "upper half sky": self.seconds["upper half sky"] / self.seconds["all"],
            "planner": self.planner / self.seconds["all"],
        }


def even_frame(size: tuple[int, int]) -> tuple[GBuffer, Camera]:
    """Return a frame of small boxes before a wall, the same all over, half glossy."""
    width, height = size
    y, x = np.mgrid[0:height, 0:width]
    is_box = ((x // 20 + y // 20) % 2).astype(np.float32)
    normal = np.zeros((height, width, 3), dtype=np.float32)
    normal[..., 0], normal[..., 2] = 0.6 * is_box, 1.0 - 0.2 * is_box
    grey = np.full((height, width, 3), 0.5, dtype=np.float32)
    gbuffer = GBuffer(4.0 - 0.2 * is_box, normal, grey, 0.5 * grey, 0.1 + 0.4 * is_box, grey)
    return gbuffer, Camera.perspective(width, height, 1.0)


def variants(gbuffer: GBuffer) -> dict[str, GBuffer]:
    """Return the frame, and what needs less."""
    black = np.zeros_like(gbuffer.albedo)
    depth = gbuffer.depth.copy()
    depth[: depth.shape[0] // 2] = np.inf
    return {
        "all": gbuffer,
        "no gloss": replace(gbuffer, specular=black),
        "upper half sky": replace(gbuffer, depth=depth),
        "black": replace(gbuffer, albedo=black, specular=black, reflectance=None),
    }


def measure(
    scene: str, gbuffer: GBuffer, camera: Camera, environment: Environment | None, preset: str, rounds: int
) -> Need:
    """Time all variants of a frame in turn."""
    settings, frames = Settings.preset(preset), variants(gbuffer)
    seconds: dict[str, list[float]] = {name: [] for name in frames}
    rays, shares, planner = {}, [], []
    for _ in range(rounds):
        for name, frame in frames.items():
            begin = time.perf_counter()
            light = render_indirect(frame, camera, settings, environment)
            seconds[name].append(time.perf_counter() - begin)
            rays[name] = sum(light.rays.values())
            if name == "no gloss":
                shares.append(light.seconds["reflections"] / seconds[name][-1])
        begin = time.perf_counter()
        plan_passes(gbuffer, settings, environment)
        planner.append(time.perf_counter() - begin)
    best = {name: min(times) for name, times in seconds.items()}
    return Need(scene, best, rays, min(shares), min(planner))


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=list(_SCENES), help=f"real scenes, or {EVEN}")
    parser.add_argument("--size", type=parse_size, default=(480, 270), metavar="WIDTHxHEIGHT")
    parser.add_argument("--preset", choices=sorted(PRESETS), default="draft")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    arguments = parser.parse_args()
    needs = []
    for scene in arguments.scenes:
        if scene == EVEN:
            gbuffer, camera = even_frame(arguments.size)
            environment = Environment.constant((0.5, 0.6, 0.7))
        else:
            frame = CONFIGURATIONS["frame"].of(wide_frame(scene, arguments.size))
            gbuffer, camera, environment = frame.gbuffer, frame.camera, frame.environment
        need = measure(scene, gbuffer, camera, environment, arguments.preset, arguments.rounds)
        needs.append(need)
        for name, value in need.seconds.items():
            print(f"{scene:20}{name:28}{value:9.3f} s{need.rays[name]:10,} rays", flush=True)
        for name, share in need.shares.items():
            verdict = "" if share <= TARGETS[name] else "  MISSED"
            print(f"{scene:20}{name:28}{share:9.2%} of {TARGETS[name]:.0%}{verdict}", flush=True)
    if arguments.output:
        parameters = {name: getattr(arguments, name) for name in ("scenes", "size", "preset", "rounds")}
        results = [{**asdict(need), "shares": need.shares} for need in needs]
        record.store(arguments.output, parameters, {"targets": TARGETS, "frames": results})


if __name__ == "__main__":
    main()
