# SPDX-License-Identifier: GPL-3.0-or-later
"""How alive Blender's window is while a render runs in the background: gaps between ticks of a timer.

The demo scene is rendered as by the button (`ssgi.render`, invoked), and a timer of the window asks to be
called every 20 ms. A gap is the time from one call to the next: what a click has to wait for. Needs a Blender
with a window and with the extension installed, and the repository:

    blender --python benchmarks/window.py -- [--output FILE.json] [--preset NAME] [--resolution WxH]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # Blender runs this file by itself

from benchmarks import record
from ssgi_addon.arguments import resolution
from ssgi_addon.blender.demo_scene import build_demo_scene

_TICK, _POLL = 0.02, 0.1
# Until all is drawn for the first time; of the idle window
_SECONDS_FIRST, _SECONDS_IDLE = 10.0, 5.0
# The largest 95th percentile of the gaps, s, at which a window counts as alive
TARGET = 0.25


class Gaps:
    """Measures the gaps between ticks as long as it runs."""

    def __init__(self) -> None:
        self._gaps: list[float] = []
        self._last = 0.0
        bpy.app.timers.register(self._tick)

    def start(self) -> None:
        """Begin anew."""
        self._gaps, self._last = [], time.perf_counter()

    def summary(self) -> dict[str, float]:
        """Return the percentiles since the start, seconds."""
        values = np.percentile(self._gaps, (50, 95, 99, 100))
        names = ("median", "p95", "p99", "longest")
        return {"ticks": len(self._gaps), **{name: round(float(v), 4) for name, v in zip(names, values)}}

    def _tick(self) -> float:
        now = time.perf_counter()
        self._gaps.append(now - self._last)
        self._last = now
        return _TICK


def measure(arguments: argparse.Namespace) -> Iterator[float]:
    """Run the measurement; yields the seconds to wait for its next step."""
    window = bpy.context.window_manager.windows[0]
    scene = build_demo_scene()
    window.scene = scene
    scene.ssgi.preset = arguments.preset
    scene.render.resolution_x, scene.render.resolution_y = arguments.resolution
    scene.render.resolution_percentage = 100
    gaps = Gaps()
    yield _SECONDS_FIRST
    gaps.start()
    yield _SECONDS_IDLE
    results: dict[str, object] = {"idle": gaps.summary()}
    begun = time.perf_counter()
    with bpy.context.temp_override(window=window):
        bpy.ops.ssgi.render("INVOKE_DEFAULT")
    results["seconds_to_start"] = round(time.perf_counter() - begun, 3)
    gaps.start()
    while bpy.ops.ssgi.cancel_render.poll():
        yield _POLL
    results |= {"running": gaps.summary(), "seconds": round(time.perf_counter() - begun, 2)}
    results["result"] = Path(scene.ssgi.result).is_file()
    results["target_p95"] = TARGET
    options = {
        "preset": arguments.preset,
        "resolution": arguments.resolution,
        "blender": bpy.app.version_string,
    }
    record.store(arguments.output, options, results)


def main() -> None:
    """Measure, then end Blender."""
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    sys.argv = [__file__, *own]
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--output", metavar="FILE.json", type=Path, default=ROOT / "benchmarks" / "results" / "window.json"
    )
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--resolution", metavar="WxH", type=resolution, default=(480, 270))
    steps = measure(parser.parse_args())

    def step() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            bpy.ops.wm.quit_blender()
        return None

    bpy.app.timers.register(step, first_interval=1.0)


main()
