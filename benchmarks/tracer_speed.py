# SPDX-License-Identifier: GPL-3.0-or-later
"""How long rays take by each walk: linear, nearest bound only, nearest and farthest bound, compiled scalar.

One glossy ray per pixel of an interior; projection and walk are timed, depth fields are built before. Run
from the repository's root:

    python -m benchmarks.tracer_speed [--size 1920x1080] [--threads 2] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks import compiled_tracer, record
from benchmarks.inputs import NAMES, Rays, best_interior, glossy_rays, interior, parse_size
from ssgi_addon.core import Settings, parallel, slabs, tracer, walk
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.frame import CapturedFrame

_STATUS_NAMES = {
    tracer.HIT: "hit",
    tracer.BLOCKED: "blocked",
    tracer.ESCAPED: "escaped",
    tracer.UNKNOWN: "unknown",
}
_LINEAR, _COMPILED = "linear", "compiled scalar"


@dataclass(frozen=True, eq=False)
class Method:
    """A way to trace all rays by a number of threads; `count` returns the cells that they look at."""

    name: str
    run: Callable[[int], tracer.TraceResult]
    count: Callable[[int], int]


@dataclass(frozen=True)
class Row:
    """What one method took and found.

    Attributes
    ----------
    seconds
        Best of all rounds.
    spread
        (slowest - fastest) / fastest round.
    ns_per_ray, cells_per_ray
        Time and cells of any level, over all rays.
    hit, blocked, escaped, unknown
        Shares of the rays.
    differ_from_linear
        Share of the rays with another status or pixel than by the linear walk.
    times_faster_than_linear, times_slower_than_compiled
        Medians over the rounds of ratios within one round.
    """

    method: str
    seconds: float
    spread: float
    ns_per_ray: float
    cells_per_ray: float
    hit: float
    blocked: float
    escaped: float
    unknown: float
    differ_from_linear: float
    times_faster_than_linear: float
    times_slower_than_compiled: float


def methods(frame: CapturedFrame, rays: Rays) -> list[Method]:
    """Return all methods, each with the depth field that it walks."""
    gbuffer, camera, thickness = frame.gbuffer, frame.camera, Settings().thickness
    fields = {
        _LINEAR: DepthField.build(gbuffer, camera, thickness, max_level=0),
        "nearest bound": DepthField.build(gbuffer, camera, thickness, bounds="nearest"),
        "nearest and farthest bound": DepthField.build(gbuffer, camera, thickness),
    }

    def walked(name: str, field: DepthField) -> Method:
        def run(threads: int) -> tracer.TraceResult:
            return tracer.trace_rays(field, rays.origin_vs, rays.direction_vs, threads=threads)

        def count(threads: int) -> int:
            with counted_steps() as steps:
                run(threads)
            return sum(steps)

        return Method(name, run, count)

    def compiled(threads: int) -> tuple[tracer.TraceResult, int]:
        field = fields["nearest and farthest bound"]
        return compiled_tracer.trace_rays(field, rays.origin_vs, rays.direction_vs, threads=threads)

    return [
        *(walked(name, field) for name, field in fields.items()),
        Method(_COMPILED, lambda threads: compiled(threads)[0], lambda threads: compiled(threads)[1]),
    ]


@contextmanager
def counted_steps() -> Iterator[list[int]]:
    """Record, for each step of each walk, how many rays are on their way."""
    steps: list[int] = []
    plain_step = walk.Walk._step

    def step(self: walk.Walk) -> None:
        steps.append(int(np.count_nonzero(~np.isnan(self.group.state[slabs.S_END]))))
        plain_step(self)

    walk.Walk._step = step
    try:
        yield steps
    finally:
        walk.Walk._step = plain_step


def measure(chosen: list[Method], threads: int, rounds: int, count: int) -> list[Row]:
    """Time all methods in turn, several rounds, and compare what they find.

    Parameters
    ----------
    chosen
        The linear walk first, the compiled one last.
    threads, rounds
        Worker threads, and how often to run each method.
    count
        Number of rays.
    """
    seconds: dict[str, list[float]] = {method.name: [] for method in chosen}
    found = {method.name: method.run(threads) for method in chosen[-1:]}  # compiles it
    for _ in range(rounds):
        for method in chosen:
            begun = time.perf_counter()
            found[method.name] = method.run(threads)
            seconds[method.name].append(time.perf_counter() - begun)
    return [_row(method, seconds, found, method.count(threads) / count) for method in chosen]


def _row(
    method: Method, seconds: dict[str, list[float]], found: dict[str, tracer.TraceResult], cells: float
) -> Row:
    own, result, linear = seconds[method.name], found[method.name], found[_LINEAR]
    shares = {name: float((result.status == status).mean()) for status, name in _STATUS_NAMES.items()}
    differs = (result.status != linear.status) | (result.pixel != linear.pixel)
    return Row(
        method=method.name,
        seconds=min(own),
        spread=max(own) / min(own) - 1.0,
        ns_per_ray=min(own) / result.status.size * 1e9,
        cells_per_ray=cells,
        **shares,
        differ_from_linear=float(differs.mean()),
        times_faster_than_linear=_median_ratio(seconds[_LINEAR], own),
        times_slower_than_compiled=_median_ratio(own, seconds[_COMPILED]),
    )


def _median_ratio(above: list[float], below: list[float]) -> float:
    return statistics.median(a / b for a, b in zip(above, below, strict=True))


def _print_rows(rows: list[Row]) -> None:
    print(
        f"{'':27}{'seconds':>8}{'spread':>8}{'ns/ray':>9}{'cells/ray':>11}{'x linear':>10}{'x compiled':>12}"
        f"{'hit':>7}{'blocked':>9}{'escaped':>9}{'unknown':>9}{'differ':>10}"
    )
    for row in rows:
        print(
            f"{row.method:27}{row.seconds:8.2f}{row.spread:8.0%}{row.ns_per_ray:9.0f}{row.cells_per_ray:11.1f}"
            f"{row.times_faster_than_linear:10.2f}{row.times_slower_than_compiled:12.2f}"
            f"{row.hit:7.1%}{row.blocked:9.1%}{row.escaped:9.1%}{row.unknown:9.1%}{row.differ_from_linear:10.4%}"
        )


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=parse_size, default=(1920, 1080), metavar="WIDTHxHEIGHT")
    parser.add_argument("--scene", choices=NAMES, default=best_interior())
    parser.add_argument("--threads", type=int, default=parallel.thread_count(None))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--output", type=Path, help="JSON file for the results")
    arguments = parser.parse_args()
    frame = interior(arguments.size, arguments.scene)
    rays = glossy_rays(frame.gbuffer, frame.camera)
    count = rays.pixel.size
    print(f"{arguments.scene}, {frame.camera.width}x{frame.camera.height}, {count} rays, ", end="")
    print(f"{arguments.threads} threads, best of {arguments.rounds}", flush=True)
    rows = measure(methods(frame, rays), arguments.threads, arguments.rounds, count)
    _print_rows(rows)
    if arguments.output is not None:
        parameters = {**vars(arguments), "rays": count}
        del parameters["output"]
        record.store(arguments.output, parameters, [asdict(row) for row in rows])


if __name__ == "__main__":
    main()
