# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the benchmark: one Blender process for each scene, then one report of all."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from ..child import environment, printed_error, ssgi_command
from ..core import parallel
from ..errors import SSGIError
from ..files import check_writable, read_json
from ..progress import understand
from .methods import Method, all_methods, chosen
from .options import BenchOptions, SceneSource, find_scenes
from .plots import require_matplotlib
from .report import write_report
from .store import SceneState, load_scene, scene_folder
from .tasks import COMMAND, Task, write_task

Progress = Callable[[float, str], None]

# For the estimate alone, measured on two cores of a server: seconds of a sample with all bounces, a pixel
# and core; of a render before its first sample; of our passes and captures, a pixel and core
_SAMPLE_SECONDS, _RENDER_SECONDS, _OURS_SECONDS = 6e-6, 0.2, 4e-5
_LAST_LINES = 5
# Of a scene's time: the rest is left for what is measured cold, and for flicker
_MEASURE_SHARE = 0.8


def run_bench(options: BenchOptions, progress: Progress, *, blender: str = "") -> Path:
    """Measure all scenes and write the report; return its page.

    Parameters
    ----------
    options
        What to measure.
    progress
        Called with a fraction and a text; may raise to stop.
    blender
        The Blender that runs this, whose processes measure; empty: this Python.

    Raises
    ------
    SSGIError
        If something is missing, the folder cannot be written, or no scene could be measured.
    """
    require_matplotlib()
    check_writable(options.output)
    scenes = find_scenes(options)
    methods = chosen(all_methods(quick=options.quick), options.methods)
    if not methods:
        raise SSGIError(f"no method is called {' or '.join(options.methods)}: see docs/benchmarks/README.md")
    progress(0.0, estimate(options, methods, len(scenes)))
    begun = time.time()
    states = []
    with _private_resources(blender):
        for index, source in enumerate(scenes):
            left = len(scenes) - index
            deadline = float("inf")
            if options.minutes:
                deadline = time.time() + max(0.0, begun + 60.0 * options.minutes - time.time()) / left
            share = _part(progress, index / len(scenes), 0.98 / len(scenes), source.name)
            states.append(_measure(options, source, methods, min(deadline, 1e12), share, blender))
    progress(0.99, "Report")
    page = write_report(options, states, methods)
    if all(state.failure for state in states):
        raise SSGIError(f"no scene could be measured: {states[0].failure}; the report is {page}")
    return page


def estimate(options: BenchOptions, methods: Sequence[Method], scenes: int) -> str:
    """Return about how long a run takes, as a text: scenes differ by a factor of three."""
    pixels = options.resolution[0] * options.resolution[1] / parallel.thread_count(None)
    total = 4 * options.reference_samples * 0.8 * _SAMPLE_SECONDS * pixels
    for method in methods:
        share = {"cycles": 0.5 if method.light == "direct" else 1.0, "ours": 0.5}.get(method.kind, 2.0)
        seconds = _RENDER_SECONDS + method.samples * share * _SAMPLE_SECONDS * pixels
        if method.kind == "ours":
            seconds += 4 * _RENDER_SECONDS + _OURS_SECONDS * pixels
        total += seconds * (1 if seconds > 12.0 else 1.2 * (1 + options.repeats)) + 2.0
        total += 2.0 + seconds if method.headline and options.cold else 0.0
    minutes = total * scenes / 60.0
    limit = f", stopped after {options.minutes:g}" if options.minutes else ""
    return f"{len(methods)} methods, scenes: {scenes}; very roughly {minutes:.0f} minutes{limit}"


def _measure(
    options: BenchOptions,
    source: SceneSource,
    methods: Sequence[Method],
    deadline: float,
    progress: Progress,
    blender: str,
) -> SceneState:
    """Measure a scene in processes of its own, as many as crash, and return what is known then."""
    folder = scene_folder(options, source.name)
    state = load_scene(folder, source)
    if options.fresh:
        state.records, state.flicker = {}, {}
    # What failed once is tried again by each run
    state.records = {name: record for name, record in state.records.items() if record.failure is None}
    state.failure, state.running, state.left_out = None, None, {}
    state.save(folder)
    processes = _Processes(options, source, folder, deadline, progress, blender)
    share = _MEASURE_SHARE if options.cold or options.flicker else 1.0
    processes.deadline = time.time() + share * (deadline - time.time())
    for _ in range(len(methods) + 1):
        ended_badly = processes.run("measure")
        state = load_scene(folder, source)
        if ended_badly is None:
            break
        if state.running is None:
            state.failure = ended_badly
            state.save(folder)
            return state
        state.records[state.running].failure = f"Blender ended during it: {ended_badly}"
        state.running = None
        state.save(folder)
    processes.deadline = deadline
    if options.flicker:
        reason = processes.run("flicker")
        state = load_scene(folder, source)
        if reason is not None:
            state.left_out["flicker"] = reason
    if options.cold:
        _measure_cold(processes, state, methods)
    state.save(folder)
    return state


def _measure_cold(processes: _Processes, state: SceneState, methods: Sequence[Method]) -> None:
    for method in methods:
        record = state.records.get(method.name)
        is_wanted = method.headline and record is not None and record.seconds and record.cold is None
        if not is_wanted or time.time() > processes.deadline:
            continue
        processes.progress(1.0, f"{method.name}, cold")
        reason = processes.run("cold", method.name)
        path = processes.folder / "cold.json"
        record.cold = read_json(path) if reason is None else {"failure": reason}
        path.unlink(missing_ok=True)


@dataclass
class _Processes:
    """Starts Blender processes for a scene."""

    options: BenchOptions
    source: SceneSource
    folder: Path
    deadline: float
    progress: Progress
    blender: str

    def run(self, kind: str, method: str = "") -> str | None:
        """Run a task and relay its progress; return how it ended, None where it ended well."""
        path = self.folder / "task.json"
        write_task(Task(kind, self.options, self.source, self.deadline, method), path)
        command = ssgi_command(self.blender, COMMAND, str(path))
        last: deque[str] = deque(maxlen=_LAST_LINES)
        with (
            (self.folder / "log.txt").open("a", encoding="utf-8") as log,
            subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                errors="replace", env=environment(),
            ) as process,
        ):  # fmt: skip
            try:
                self._relay(process.stdout, log, last)
            except BaseException:
                process.kill()
                raise
        if process.returncode == 0:
            return None
        return printed_error(last) or f"exit status {process.returncode}; see {log.name}"

    def _relay(self, lines: Iterable[str], log: TextIO, last: deque[str]) -> None:
        """Pass progress on, and keep all else that a process prints."""
        for line in lines:
            told = understand(line)
            if told is not None:
                self.progress(*told)
                continue
            log.write(line)
            if line.strip():
                last.append(line.strip())


@contextmanager
def _private_resources(blender: str) -> Iterator[None]:
    """Keep the user's preferences out of Blender as a module; a Blender has this extension in its own."""
    if blender or "BLENDER_USER_RESOURCES" in os.environ:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="ssgi-bench-") as folder:
        os.environ["BLENDER_USER_RESOURCES"] = folder
        try:
            yield
        finally:
            del os.environ["BLENDER_USER_RESOURCES"]


def _part(progress: Progress, begin: float, share: float, name: str) -> Progress:
    return lambda fraction, text: progress(begin + share * fraction, f"{name}: {text}")
