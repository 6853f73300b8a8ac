# SPDX-License-Identifier: GPL-3.0-or-later
"""Kill the jobs of a shot at random moments, and fill up their disk: the frames stay the same, bit for bit.

    python -m benchmarks.shot_kills --output benchmarks/results/shot_kills.json

A shot of a real scene whose camera moves goes through the Open Job Description template (prepare, frames in
chunks, report), and its frames once more through one process. Then jobs of the same shot are killed, with all
that they have started, and started again by the same command, until each has been killed so many times; then
it goes on to its end. Every other job is run by ``openjd``, the rest by a shell over the same commands. It
needs the command ``openjd`` (pip install openjd-cli); the disk needs a user who may mount one.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.inputs import ROOT, parse_size
from benchmarks.record import store
from benchmarks.shot_folder import (
    PHASES,
    final_faults,
    finished,
    has_begun_another,
    phase,
    pictures,
    stamps,
    stopped_faults,
)
from benchmarks.shot_job import ShotJob, moving_scene, run, worker_environment
from benchmarks.shot_processes import kill_tree
from tests.faults.kills import unfinished

SEED = 20261127
# How often each phase is hit: most of a job's time goes into frames.
_SHARES = (0.25, 0.6, 0.15)
# Seconds: how often the folder is looked at, and within which a kill follows a file that is being written.
_LOOK, _WRITING = 0.003, 0.1
# Of the shot's bytes, what its disk holds at first, and then
_SMALL, _LARGE = 0.45, 4.0


@dataclass(frozen=True)
class Kill:
    """One kill.

    Attributes
    ----------
    way
        What ran the job.
    aim, phase
        Phase in which it was to strike, and did; None if the job had ended before.
    seconds
        From the start of the job, or from the last one.
    finished
        Frames that were finished then.
    has_begun_another
        Whether files of a frame were there that was not finished.
    half_written
        Temporary files of ours that it left.
    """

    way: str
    aim: str
    phase: str | None
    seconds: float
    finished: int
    has_begun_another: bool
    half_written: int


@dataclass
class Stops:
    """What stops did to the jobs of a shot.

    Attributes
    ----------
    jobs
        How many were stopped, and went on to their ends.
    kept
        Frames that were finished at a stop, summed over the stops: what came after must not touch them.
    rendered
        Frames that were rendered after the first stop of their job.
    kills
        Each kill.
    faults
        A text each.
    """

    jobs: int = 0
    kept: int = 0
    rendered: int = 0
    kills: list[Kill] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def add(self, kill: Kill, there: int | None) -> None:
        """Count a kill; so many frames were finished at the stop before it, None where there was none."""
        self.kills.append(kill)
        self.kept += kill.finished
        self.rendered += 0 if there is None else kill.finished - there


@dataclass(frozen=True)
class Whole:
    """The shot without a stop: contents of its pictures, and the seconds of its phases."""

    pictures: Mapping[str, bytes]
    seconds: Mapping[str, float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="living_room")
    parser.add_argument("--size", type=parse_size, default=(192, 108), metavar="WIDTHxHEIGHT")
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--chunk", type=int, default=6, help="frames of a task")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--per-job", type=int, default=2, help="how many times each job is killed")
    parser.add_argument("--output", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="shot-kills-") as name:
        results = _measure(arguments, Path(name))
    parameters = {key: value for key, value in vars(arguments).items() if key != "output"}
    if arguments.output:
        store(arguments.output, {**parameters, "seed": SEED}, results)


def _measure(arguments: argparse.Namespace, folder: Path) -> dict[str, object]:
    blend = moving_scene(arguments.scene, folder, arguments.frames)
    job = ShotJob(blend, folder / "openjd", arguments.frames, arguments.size, arguments.preset)
    env = worker_environment(folder / "worker")
    whole = _without_a_stop(job, arguments.chunk, env)
    alone = replace(job, output=folder / "alone")
    run(alone.render(alone.frames, job.shot), env)
    of_one = pictures(alone)
    same = sum(of_one.get(name) == data for name, data in whole.pictures.items())
    print(f"one process: {same} of {len(whole.pictures)} pictures are the same", flush=True)
    stops = _killed_jobs(job, arguments, whole, env)
    disk = _full_disk(job, arguments.chunk, whole, env)
    return {
        "seconds": dict(whole.seconds),
        "pictures": len(whole.pictures),
        "same_by_one_process": same,
        "kills": asdict(stops),
        "full_disk": disk and asdict(disk),
    }


def _without_a_stop(job: ShotJob, chunk: int, env: Mapping[str, str]) -> Whole:
    """Run the job by the template, and look when its phases end."""
    process, seconds = _start(job.by_openjd(chunk), env), {}
    current, since = PHASES[0], time.monotonic()
    while process.poll() is None:
        time.sleep(_LOOK)
        if (now := phase(job)) != current:
            seconds[current] = time.monotonic() - since
            current, since = now, time.monotonic()
    seconds[current] = time.monotonic() - since
    if process.returncode:
        raise SystemExit("the job failed by itself")
    print("openjd: " + ", ".join(f"{name} {spent:.1f} s" for name, spent in seconds.items()), flush=True)
    return Whole(pictures(job), seconds)


def _killed_jobs(job: ShotJob, arguments: argparse.Namespace, whole: Whole, env: Mapping[str, str]) -> Stops:
    """Kill jobs, and let them go on."""
    rng, stops = np.random.default_rng(SEED), Stops()
    aims = [str(aim) for aim in rng.permutation(_aims(arguments.kills))]
    for first in range(0, len(aims), arguments.per_job):
        # A job cannot be killed in a phase that is behind it
        own = sorted(aims[first : first + arguments.per_job], key=PHASES.index)
        way = ("shell", "openjd")[stops.jobs % 2]
        killed = replace(job, output=job.output.parent / f"killed{stops.jobs}")
        command = {"shell": killed.by_shell, "openjd": killed.by_openjd}[way](arguments.chunk)
        faults, before, there = [], {}, None
        for aim in own:
            kill = _kill(killed, command, aim, whole, rng, env, way)
            print(f"job {stops.jobs}: {kill}", flush=True)
            faults += stopped_faults(killed, whole.pictures, before)
            before = stamps(killed)
            stops.add(kill, there)
            there = kill.finished
        run(command, env)
        faults += final_faults(killed, whole.pictures, before, Path(env["TMPDIR"]))
        stops.rendered += killed.count - there
        stops.faults += [f"job {stops.jobs}: {fault}" for fault in faults]
        stops.jobs += 1
    hit = {name: sum(kill.phase == name for kill in stops.kills) for name in PHASES}
    print(f"killed: {hit}; {stops.kept} frames kept, {stops.rendered} rendered; faults: {stops.faults}")
    return stops


def _aims(count: int) -> list[str]:
    """Return a phase for each kill, by their shares."""
    ends = np.round(np.cumsum(_SHARES) * count)
    return [PHASES[int(np.searchsorted(ends, index, side="right"))] for index in range(count)]


def _kill(
    job: ShotJob, command: list[str], aim: str, whole: Whole, rng: np.random.Generator,
    env: Mapping[str, str], way: str,
) -> Kill:  # fmt: skip
    """Start a job, and kill it in a phase: at any moment, or where it writes a file."""
    there = len(finished(job))
    is_frames = aim == "frames" and there < job.count
    awaited = there + int(rng.integers(job.count - there)) if is_frames else 0
    is_writing, chance = bool(rng.integers(2)), rng.random()
    begun = time.monotonic()
    process = _start(command, env)

    def wait_until(condition: Callable[[], bool]) -> None:
        while process.poll() is None and not condition():
            time.sleep(_LOOK)

    wait_until(lambda: PHASES.index(phase(job)) >= PHASES.index(aim) and len(finished(job)) >= awaited)
    if is_writing:
        wait_until(lambda: unfinished(job.output) or phase(job) != aim)
        time.sleep(chance * _WRITING)
    else:
        time.sleep(chance * whole.seconds[aim] / (job.count if is_frames else 1))
    current = phase(job)
    is_running = kill_tree(process)
    return Kill(
        way=way,
        aim=aim,
        phase=current if is_running else None,
        seconds=round(time.monotonic() - begun, 2),
        finished=len(finished(job)),
        has_begun_another=has_begun_another(job),
        half_written=len(unfinished(job.output)),
    )


def _full_disk(job: ShotJob, chunk: int, whole: Whole, env: Mapping[str, str]) -> Stops | None:
    """Let the disk of a job's results fill up, make it larger, and let the job go on."""
    total = sum(path.stat().st_size for path in job.output.rglob("*") if path.is_file())
    with _disk(job.output.parent / "disk", int(_SMALL * total)) as enlarge:
        if enlarge is None:
            print("full disk: not tried, for this user may not mount one")
            return None
        full, stops = replace(job, output=job.output.parent / "disk" / "out"), Stops(jobs=1)
        if _start(full.by_openjd(chunk), env).wait() == 0:
            stops.faults.append("the job did not notice")
        before = stamps(full)
        stops.faults += stopped_faults(full, whole.pictures, {})
        stops.faults += [f"{name} was left behind on the full disk" for name in unfinished(full.output)]
        stops.kept = len(finished(full))
        enlarge(int(_LARGE * total))
        run(full.by_openjd(chunk), env)
        stops.rendered = full.count - stops.kept
        stops.faults += final_faults(full, whole.pictures, before, Path(env["TMPDIR"]))
    print(f"full disk: {stops.kept} frames kept, {stops.rendered} rendered; faults: {stops.faults}")
    return stops


@contextmanager
def _disk(folder: Path, size: int) -> Iterator[Callable[[int], None] | None]:
    """Mount a disk of so many bytes in memory; give what changes its size, None where that is not allowed."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        yield None
        return
    try:
        yield lambda size: _remount(folder, size)
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def _remount(folder: Path, size: int) -> None:
    subprocess.run(["mount", "-o", f"remount,size={size}", str(folder)], check=True)


def _start(command: list[str], env: Mapping[str, str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        command, cwd=ROOT, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip


if __name__ == "__main__":
    main()
