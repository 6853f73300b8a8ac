# SPDX-License-Identifier: GPL-3.0-or-later
"""How time and memory of the passes, and of a trace alone, grow with the number of pixels.

The reflection pass with one ray per pixel and no diffuse light, its trace alone, the diffuse pass as the
balanced preset has it with one bounce and with three, and no reflections. Each size runs in a process of its
own, so that no run finds memory that another one has left. Run from the repository's root:

    python -m benchmarks.scaling [--sizes 480x270 960x540 ...] [--threads 2] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import ctypes
import json
import re
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.inputs import NAMES, ROOT, Size, best_interior, glossy_rays, interior, parse_size
from ssgi_addon.core import DiffuseSettings, ReflectionSettings, Settings, parallel, render_indirect, tracer
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.frame import CapturedFrame

SIZES = ((480, 270), (960, 540), (1920, 1080), (3840, 2160))
WORK = ("trace", "pass", "diffuse", "3 bounces")


@dataclass(frozen=True)
class Sample:
    """What one size took.

    Attributes
    ----------
    width, height
        Pixels.
    seconds
        Best of all rounds.
    spread
        (slowest - fastest) / fastest round.
    resident_bytes, allocated_bytes
        Peak per pixel beyond the inputs: of the process, in the first round; and of what Python and numpy
        asked for. None where the system does not tell.
    """

    width: int
    height: int
    seconds: float
    spread: float
    resident_bytes: float | None
    allocated_bytes: float

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.width * self.height


def prepare(work: str, frame: CapturedFrame, threads: int) -> Callable[[], object]:
    """Return what is to be measured; its inputs are made by then."""
    settings = Settings(threads=threads)
    if work == "pass":
        only = {"reflections": ReflectionSettings(rays=1), "diffuse": DiffuseSettings(enabled=False)}
    else:
        diffuse = replace(Settings.preset("balanced").diffuse, bounces=1 if work == "diffuse" else 3)
        only = {"reflections": ReflectionSettings(enabled=False), "diffuse": diffuse}
    if work != "trace":
        return lambda: render_indirect(frame.gbuffer, frame.camera, replace(settings, **only))
    field = DepthField.build(frame.gbuffer, frame.camera, settings.thickness)
    rays = glossy_rays(frame.gbuffer, frame.camera)
    return lambda: tracer.trace_rays(field, rays.origin_vs, rays.direction_vs, threads=threads)


def measure(run: Callable[[], object], size: Size, rounds: int) -> Sample:
    """Run several times, the first time for resident memory, and once more for allocated memory."""
    resident, seconds = None, []
    before = _resident_size()
    for number in range(rounds):
        begun = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - begun)
        if number == 0 and before is not None:
            resident = (_peak_resident_size() - before) / (size[0] * size[1])
    tracemalloc.start()
    run()
    allocated = tracemalloc.get_traced_memory()[1] / (size[0] * size[1])
    tracemalloc.stop()
    return Sample(*size, min(seconds), max(seconds) / min(seconds) - 1.0, resident, allocated)


def fitted_exponent(samples: list[Sample]) -> float | None:
    """Return b of seconds = a pixels^b, by least squares of the logarithms."""
    if len(samples) < 2:
        return None
    pixels, seconds = zip(*((sample.pixels, sample.seconds) for sample in samples), strict=True)
    return float(np.polyfit(np.log(pixels), np.log(seconds), 1)[0])


def _resident_size() -> int | None:
    """Return the resident size in bytes and forget the peak so far; None where the system cannot do that."""
    if sys.platform != "linux":
        return None
    try:
        # Memory that was freed and kept would be used again unseen
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except (AttributeError, OSError):
        return None
    return _status_bytes("VmRSS")


def _peak_resident_size() -> int:
    return _status_bytes("VmHWM")


def _status_bytes(name: str) -> int:
    text = Path("/proc/self/status").read_text(encoding="ascii")
    found = re.search(rf"^{name}:\s+(\d+) kB$", text, re.MULTILINE)
    assert found is not None, f"/proc/self/status has no {name}"
    return int(found.group(1)) * 1024


def _sample_elsewhere(work: str, size: Size, arguments: argparse.Namespace) -> Sample:
    """Measure in a fresh process, which answers by a line of JSON."""
    command = [
        sys.executable, "-m", "benchmarks.scaling", "--only", work, "--sizes", f"{size[0]}x{size[1]}",
        "--scene", arguments.scene, "--threads", str(arguments.threads), "--rounds", str(arguments.rounds),
    ]  # fmt: skip
    answer = subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.PIPE, text=True).stdout
    return Sample(**json.loads(answer.splitlines()[-1]))


def _print_sample(work: str, sample: Sample) -> None:
    resident = "-" if sample.resident_bytes is None else f"{sample.resident_bytes:.0f}"
    print(
        f"{work:10}{sample.width:6}x{sample.height:<6}{sample.seconds:9.2f}{sample.spread:8.0%}"
        f"{sample.seconds / sample.pixels * 1e9:10.0f}{resident:>14}{sample.allocated_bytes:14.0f}",
        flush=True,
    )


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=parse_size, nargs="+", default=SIZES, metavar="WIDTHxHEIGHT")
    parser.add_argument("--scene", choices=NAMES, default=best_interior())
    parser.add_argument("--threads", type=int, default=parallel.thread_count(None))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--output", type=Path, help="JSON file for the results")
    parser.add_argument("--only", choices=WORK, help=argparse.SUPPRESS)  # what a fresh process measures
    arguments = parser.parse_args()
    if arguments.only is not None:
        (size,) = arguments.sizes
        run = prepare(arguments.only, interior(size, arguments.scene), arguments.threads)
        print(json.dumps(asdict(measure(run, size, arguments.rounds))))
        return
    print(f"{arguments.scene}, {arguments.threads} threads, best of {arguments.rounds}; ", end="")
    print("bytes per pixel beyond the inputs")
    print(f"{'':23}{'seconds':>9}{'spread':>8}{'ns/pixel':>10}{'resident':>14}{'allocated':>14}")
    results = {}
    for work in WORK:
        samples = []
        for size in arguments.sizes:
            interior(size, arguments.scene)
            samples.append(_sample_elsewhere(work, size, arguments))
            _print_sample(work, samples[-1])
        exponent = fitted_exponent(samples)
        if exponent is not None:
            print(f"{work}: seconds ~ pixels^{exponent:.3f}")
        results[work] = {"exponent": exponent, "sizes": [asdict(sample) for sample in samples]}
    if arguments.output is not None:
        parameters = {name: getattr(arguments, name) for name in ("scene", "threads", "rounds")}
        record.store(arguments.output, parameters, results)


if __name__ == "__main__":
    main()
