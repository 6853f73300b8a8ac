# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames per minute of one worker and of two, what a task takes beside its frames, and what many would take.

    python -m benchmarks.shot_scaling --output benchmarks/results/shot_scaling.json

A shot of a real scene whose camera moves is prepared and rendered by tasks of some frames, as a queue hands
them to workers, each with an environment of its own. A worker has one core (taskset), so that two of them
stand for two machines, or all cores. The model (`shot_model`) is checked by these runs; with the bytes that
`shot_storage` has stored, it tells what ten and a thousand workers take. Keep the machine quiet. Linux alone.
"""

from __future__ import annotations

import argparse
import math
import os
import queue
import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.inputs import ROOT, parse_size
from benchmarks.record import store
from benchmarks.shot_job import ShotJob, moving_scene, run, worker_environment
from benchmarks.shot_model import (
    GIGABIT,
    Cost,
    ShotParts,
    fitted,
    frames_seconds,
    shot_cost,
    shot_seconds,
    storage_rate,
    workers_of_link,
)
from ssgi_addon.files import read_json, write_json
from ssgi_addon.manifest import manifest_path

STORAGE = ROOT / "benchmarks" / "results" / "shot_storage.json"
# Runs: how many workers, with how many cores each (None: all), how many frames, in chunks of how many
RUNS: dict[str, tuple[int, int | None, int, int]] = {
    "1 worker, all cores, chunks of 12": (1, None, 12, 12),
    "1 worker, all cores, chunks of 4": (1, None, 8, 4),
    "1 worker, all cores, chunks of 1": (1, None, 3, 1),
    "1 worker, 1 core": (1, 1, 8, 4),
    "2 workers, 1 core each": (2, 1, 8, 4),
}
# The model takes farms from one run; from the second it predicts the third.
_ALL_CORES, _ONE, _TWO = "1 worker, all cores, chunks of 12", "1 worker, 1 core", "2 workers, 1 core each"
# What a task may take beside its frames, as a share of them
_AIM = 0.1
# How often a manifest is written to time that, and of how many frames the shorter report is
_MANIFESTS, _FEW_MERGED = 30, 3
# Workers, and frames of their shot; and of its tasks
_FARMS, _CHUNKS = ((10, 240), (1000, 4000)), (4, 12)


@dataclass(frozen=True)
class Task:
    """A process that rendered some frames.

    Attributes
    ----------
    seconds
        From its start to its end.
    totals, writes
        Seconds of each frame in the order of rendering, and what writing its files took of them.
    read, written
        Bytes that it asked the system for, of programs and libraries, too, and that it wrote.
    """

    seconds: float
    totals: list[float]
    writes: list[float]
    read: int
    written: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=["living_room", "cornell_box"])
    parser.add_argument("--size", type=parse_size, default=(960, 540), metavar="WIDTHxHEIGHT")
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--output", type=Path)
    arguments = parser.parse_args()
    parameters = {key: value for key, value in vars(arguments).items() if key != "output"}
    results = {}
    for scene in arguments.scenes:
        with tempfile.TemporaryDirectory(prefix="shot-scaling-") as name:
            results[scene] = _measure(scene, arguments, Path(name))
        if arguments.output:
            store(arguments.output, {**parameters, "runs": RUNS}, results)


def _measure(scene: str, arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    count = max(frames for _, _, frames, _ in RUNS.values())
    job = ShotJob(moving_scene(scene, folder, count), folder / "out", count, arguments.size, arguments.preset)
    env = worker_environment(folder / "worker0")
    prepare = _seconds(job.prepare(), env)
    print(f"{scene}: prepared in {prepare:.1f} s", flush=True)
    runs = {name: _run(name, job, folder, *how) for name, how in RUNS.items()}
    own = replace(job, output=folder / next(iter(RUNS)))
    merges = {frames: _seconds(replace(own, count=frames).merge(), env) for frames in (_FEW_MERGED, count)}
    seconds = {"prepare": prepare, **_task_parts(runs[_ALL_CORES])}
    seconds["merge"], seconds["merged_frame"] = (
        cost.seconds for cost in fitted(*(x for n, spent in merges.items() for x in (Cost(spent), n)))
    )
    parts = _parts(scene, seconds)
    return {
        "prepare_seconds": prepare,
        "merge_seconds": merges,
        "manifest_seconds": _manifest_seconds(own),
        "runs": runs,
        "chunk_for_the_aim": _chunk_for_the_aim(runs),
        "check": _check(runs),
        "parts": asdict(parts),
        "farms": [_farm(parts, *farm) for farm in _FARMS],
    }


def _run(
    name: str, job: ShotJob, folder: Path, workers: int, cores: int | None, frames: int, chunk: int
) -> dict[str, Any]:
    """Let workers take chunks out of a queue until there are no more."""
    part = replace(job, output=folder / name, count=frames)
    left: queue.SimpleQueue[list[int]] = queue.SimpleQueue()
    for numbers in part.chunks(chunk):
        left.put(numbers)
    tasks: list[Task] = []

    def work(worker: int) -> None:
        pinned = [] if cores is None else ["taskset", "-c", f"{worker * cores}-{(worker + 1) * cores - 1}"]
        env = worker_environment(folder / f"worker{worker}")
        while True:
            try:
                numbers = left.get_nowait()
            except queue.Empty:
                return
            tasks.append(_task(part, numbers, [*pinned, *part.render(numbers, job.shot)], env))

    begun = time.perf_counter()
    threads = [threading.Thread(target=work, args=(worker,)) for worker in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    spent = time.perf_counter() - begun
    if sum(len(task.totals) for task in tasks) != frames:
        raise SystemExit(f"{name}: a frame failed")
    found = {"workers": workers, "chunk": chunk, "frames": frames, "seconds": spent, **_told_of(tasks)}
    found["frames_per_minute"] = 60.0 * frames / spent
    print(
        f"{name}: {found['frames_per_minute']:.2f} frames a minute, {found['frame']:.2f} s a frame, a task's "
        f"first {found['first']:.2f} s, beside them {found['beside']:.2f} s a task",
        flush=True,
    )
    return {**found, "tasks": [asdict(task) for task in tasks]}


def _task(job: ShotJob, numbers: Sequence[int], command: Sequence[str], env: Mapping[str, str]) -> Task:
    """Run a task, and read what its frames' manifests and the system tell of it."""
    begun = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=ROOT, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    # The system forgets what a process has read once it is waited for
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    seconds = time.perf_counter() - begun
    lines = Path(f"/proc/{process.pid}/io").read_text(encoding="ascii").splitlines()
    counts = {name: int(value) for name, value in (line.split(":") for line in lines)}
    if process.wait():
        raise SystemExit(f"{command} failed")
    records = [read_json(manifest_path(job.output, job.scene.stem, frame))["record"] for frame in numbers]
    totals, writes = ([record["seconds"][name] for record in records] for name in ("total", "write"))
    return Task(seconds, totals, writes, counts["rchar"], counts["wchar"])


def _told_of(tasks: Sequence[Task]) -> dict[str, float]:
    """Return seconds of a frame, of a task's first one, and of a task beside its frames, with its share."""
    later = [total for task in tasks for total in task.totals[1:]]
    first = statistics.mean(task.totals[0] for task in tasks)
    beside = statistics.mean(task.seconds - sum(task.totals) for task in tasks)
    in_frames = statistics.mean(sum(task.totals) for task in tasks)
    return {
        "frame": statistics.median(later or [first]),
        "first": first,
        "beside": beside,
        "beside_share": beside / in_frames,
        "write": statistics.median(spent for task in tasks for spent in task.writes),
    }


def _task_parts(run: Mapping[str, Any]) -> dict[str, float]:
    """Return seconds of a task's parts as the model has them; what a first frame takes more is the task's."""
    return {"frame": run["frame"], "task": run["beside"] + run["first"] - run["frame"]}


def _chunk_for_the_aim(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, int]:
    """Return from which chunk on a task takes so little beside its frames; and with their first's surplus."""
    run = runs[_ALL_CORES]
    told = {"beside": run["beside"], "with_the_first_frames_surplus": _task_parts(run)["task"]}
    return {name: math.ceil(seconds / (_AIM * run["frame"])) for name, seconds in told.items()}


def _check(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Predict frames per minute of one worker of one core and of two, from what tasks of the one took."""
    seconds = _task_parts(runs[_ONE])
    parts = ShotParts(Cost(), Cost(seconds["task"]), Cost(seconds["frame"]))
    found = {}
    for name in (_ONE, _TWO):
        run = runs[name]
        predicted = 60.0 * run["frames"] / frames_seconds(parts, run["frames"], run["chunk"], run["workers"])
        found[name] = {"predicted": predicted, "measured": run["frames_per_minute"]}
        print(f"{name}: predicted {predicted:.2f}, measured {run['frames_per_minute']:.2f} frames a minute")
    return found


def _parts(scene: str, seconds: Mapping[str, float]) -> ShotParts:
    """Return the parts with these seconds, and with the bytes that were stored of a scene, if they were."""
    stored = read_json(STORAGE)["results"].get(scene, {}).get("parts", {}) if STORAGE.exists() else {}
    return ShotParts(
        **{name: Cost(**{**stored.get(name, {}), "seconds": spent}) for name, spent in seconds.items()}
    )


def _farm(parts: ShotParts, workers: int, frames: int) -> dict[str, Any]:
    """Tell what workers take of the storage, how long a shot takes, and the prepare step's share of it."""
    found: dict[str, Any] = {"workers": workers, "frames": frames}
    for chunk in _CHUNKS:
        rate, whole = storage_rate(parts, chunk, workers), shot_cost(parts, frames, chunk)
        seconds = shot_seconds(parts, frames, chunk, workers)
        found[f"chunks of {chunk}"] = {
            "read_mb_per_second": rate.read / 1e6,
            "written_mb_per_second": rate.written / 1e6,
            "opened_per_second": rate.opened,
            "workers_of_1_gbit": workers_of_link(parts, chunk, GIGABIT) if rate.read else None,
            "workers_of_10_gbit": workers_of_link(parts, chunk, 10 * GIGABIT) if rate.read else None,
            "seconds": seconds,
            "alone_seconds": shot_seconds(parts, frames, chunk, 1),
            "prepare_share_of_seconds": parts.prepare.seconds / seconds,
            "prepare_share_of_work": parts.prepare.seconds / whole.seconds,
            "merge_share_of_seconds": (parts.merge + frames * parts.merged_frame).seconds / seconds,
            "prepare_share_of_written": parts.prepare.written / whole.written if whole.written else None,
        }
    for name in list(found)[2:]:
        told = {key: value and float(f"{value:.3g}") for key, value in found[name].items()}
        print(f"{workers} workers, {frames} frames, {name}: {told}")
    return found


def _manifest_seconds(job: ShotJob) -> float:
    """Return the median time of writing a manifest, which the frames' own seconds leave out."""
    path = manifest_path(job.output, job.scene.stem, 1)
    data, spent = read_json(path), []
    for _ in range(_MANIFESTS):
        begun = time.perf_counter()
        write_json(path, data)
        spent.append(time.perf_counter() - begun)
    return statistics.median(spent)


def _seconds(command: Sequence[str], env: Mapping[str, str]) -> float:
    begun = time.perf_counter()
    run(command, env)
    return time.perf_counter() - begun


if __name__ == "__main__":
    main()
