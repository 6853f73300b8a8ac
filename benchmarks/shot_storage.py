# SPDX-License-Identifier: GPL-3.0-or-later
"""What the steps of a shot read, write and open on the storage that workers share, as the system sees it.

    python -m benchmarks.shot_storage --output benchmarks/results/shot_storage.json

A shot of a real scene whose camera moves is prepared, rendered by tasks of different lengths and gathered,
each under strace (Linux). Two tasks give what a process takes by itself and for each frame; others, of one
worker and of two at once, tell how well the model predicts. `shot_scaling` measures seconds, without strace.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path

from benchmarks.inputs import ROOT, parse_size
from benchmarks.record import store
from benchmarks.shot_job import ShotJob, moving_scene, worker_environment
from benchmarks.shot_model import Cost, ShotParts, fitted, tasks_cost

# Frames of the two tasks that the model is fitted to, and of those that it is checked by
_FEW, _MANY = 1, 3
# Of the two reports; flicker is told of three frames in a row at least
_FEW_MERGED, _MANY_MERGED = 3, 4
_CHECKED, _CHUNK = 4, 2
_READS = ("read", "pread64", "readv", "preadv")
_WRITES = ("write", "pwrite64", "writev")
_STRACE = [
    "strace", "-f", "-y", "-qq", "-s", "0", "--seccomp-bpf",
    "-e", ",".join(["trace=%file", "mmap", "fsync", *_READS, *_WRITES]),
]  # fmt: skip
_CALL = re.compile(r"(\d+) +(\w+)\((.*)\) += (-?\w+)")
_BROKEN = re.compile(r"(\d+) +(\w+)\((.*) <unfinished \.\.\.>")
_REST = re.compile(r"(\d+) +<\.\.\. \w+ resumed>(.*)")
_OPEN_FILE = re.compile(r"\d+<([^>]*)>")
_MAPPED = re.compile(r"\w+, (\d+), .*, \d+<([^>]*)>, \w+")


@dataclass
class Use:
    """What a process did with the storage.

    Attributes
    ----------
    opened, in_vain
        How often a file or folder was opened, or was not there.
    other
        Other calls that name a path: looks at its state, new names, deletions.
    flushed
        Files that were brought to the disk.
    asked, written
        Bytes of all reads, and of all writes.
    files
        Sizes of the files that were read: what has to come over a network once, where it is kept then.
    elsewhere
        Files that were opened elsewhere: of Python, Blender and the system.
    """

    opened: int = 0
    in_vain: int = 0
    other: int = 0
    flushed: int = 0
    asked: int = 0
    written: int = 0
    files: dict[str, int] = field(default_factory=dict)
    elsewhere: int = 0

    @property
    def cost(self) -> Cost:
        """As the model counts."""
        return Cost(0.0, sum(self.files.values()), self.written, self.opened + self.in_vain)

    @staticmethod
    def of(trace: Iterable[str], shared: Path) -> Use:
        """Return what the lines of a trace tell of a folder; sizes are those of its files now."""
        use, read = Use(), set()
        for name, arguments, result in _calls(trace):
            mapped = _MAPPED.match(arguments) if name == "mmap" else None
            path = _path(name, arguments)
            if mapped is not None:
                path = mapped[2]
            if not path.startswith(f"{shared}/"):
                use.elsewhere += name.startswith("open") and result >= 0
            elif name.startswith("open"):
                use.opened += result >= 0
                use.in_vain += result < 0
            elif name in _READS or mapped is not None:
                use.asked += int(mapped[1]) if mapped is not None else max(result, 0)
                read.add(path)
            elif name in _WRITES:
                use.written += max(result, 0)
            elif name == "fsync":
                use.flushed += 1
            else:
                use.other += 1
        use.files = {path: Path(path).stat().st_size for path in sorted(read) if Path(path).is_file()}
        return use


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=["living_room", "cornell_box"])
    parser.add_argument("--size", type=parse_size, default=(960, 540), metavar="WIDTHxHEIGHT")
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--frames", type=int, default=12, help="of the shot; not all are rendered")
    parser.add_argument("--output", type=Path)
    arguments = parser.parse_args()
    parameters = {key: value for key, value in vars(arguments).items() if key != "output"}
    results = {}
    for scene in arguments.scenes:
        with tempfile.TemporaryDirectory(prefix="shot-storage-") as name:
            # As strace tells paths
            results[scene] = _measure(scene, arguments, Path(name).resolve())
        if arguments.output:
            store(arguments.output, parameters, results)


def _measure(scene: str, arguments: argparse.Namespace, folder: Path) -> dict[str, object]:
    shared = folder / "shared"
    shared.mkdir()
    blend = moving_scene(scene, shared, arguments.frames)
    job = ShotJob(blend, shared / "out", arguments.frames, arguments.size, arguments.preset)
    uses = {"prepare": _trace([job.prepare()], folder)[0]}
    few, many = _consecutive(job, _FEW, _MANY)
    uses["few"], uses["many"] = (_trace([job.render(frames)], folder)[0] for frames in (few, many))
    uses["merge_few"] = _trace([replace(job, count=_FEW_MERGED).merge()], folder)[0]
    uses["merge_many"] = _trace([replace(job, count=_MANY_MERGED).merge()], folder)[0]
    costs = {name: use.cost for name, use in uses.items()}
    task, frame = fitted(costs["few"], _FEW, costs["many"], _MANY)
    merge, merged = fitted(costs["merge_few"], _FEW_MERGED, costs["merge_many"], _MANY_MERGED)
    parts = ShotParts(costs["prepare"], task, frame, merge, merged)
    print(scene)
    for item in fields(ShotParts):
        print(f"{item.name:13}" + _told(getattr(parts, item.name)))
    checks = {workers: _checked(job, parts, workers, folder) for workers in (1, 2)}
    return {
        "uses": {name: _stored(use, shared) for name, use in uses.items()},
        "parts": asdict(parts),
        "checks": checks,
        "sizes": _sizes(job),
    }


def _consecutive(job: ShotJob, *counts: int) -> Iterator[range]:
    first = 0
    for count in counts:
        yield job.frames[first : first + count]
        first += count


def _checked(job: ShotJob, parts: ShotParts, workers: int, folder: Path) -> dict[str, object]:
    """Render some frames by so many workers at once; return what they took, and what the model says."""
    part = replace(job, output=job.output.parent / f"workers{workers}", count=_CHECKED)
    commands = [part.render(frames, job.shot) for frames in part.chunks(_CHUNK)]
    uses = []
    for first in range(0, len(commands), workers):
        uses += _trace(commands[first : first + workers], folder)
    measured = sum((use.cost for use in uses), Cost())
    predicted = tasks_cost(parts, _CHECKED, _CHUNK)
    print(f"{workers} workers, measured " + _told(measured))
    print(f"{workers} workers, predicted" + _told(predicted), flush=True)
    return {"measured": asdict(measured), "predicted": asdict(predicted)}


def _trace(commands: Sequence[Sequence[str]], folder: Path) -> list[Use]:
    """Run commands at once, each under strace with an environment of its own."""
    traces = [folder / f"trace{index}" for index in range(len(commands))]
    processes = [
        subprocess.Popen(
            [*_STRACE, "-o", str(trace), *command], cwd=ROOT, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, env=worker_environment(folder / f"worker{index}"),
        )
        for index, (trace, command) in enumerate(zip(traces, commands, strict=True))
    ]  # fmt: skip
    if any([process.wait() for process in processes]):  # noqa: C419  all of them have to end
        raise SystemExit("a step failed")
    uses = []
    for trace in traces:
        with trace.open(encoding="utf-8", errors="replace") as lines:
            uses.append(Use.of(lines, folder / "shared"))
    return uses


def _calls(trace: Iterable[str]) -> Iterator[tuple[str, str, int]]:
    """Give name, arguments and result of each call; -1 stands for every failure."""
    broken: dict[str, tuple[str, str]] = {}
    for line in trace:
        if found := _BROKEN.match(line):
            broken[found[1]] = found[2], found[3]
            continue
        if (found := _REST.match(line)) and found[1] in broken:
            name, begin = broken.pop(found[1])
            line = f"{found[1]} {name}({begin}{found[2]}"
        if found := _CALL.match(line):
            yield found[2], found[3], int(found[4], 0) if found[4] != "-1" else -1


def _path(name: str, arguments: str) -> str:
    """Return the path that a call is about; empty where there is none."""
    found = _OPEN_FILE.match(arguments) if name in (*_READS, *_WRITES, "fsync") else None
    found = found or re.search(r'"(/[^"]*)"', arguments)
    return found[1] if found else ""


def _sizes(job: ShotJob) -> dict[str, int]:
    """Return the bytes of what a frame leaves, of the scene, and of what was prepared."""
    stem = f"{job.scene.stem}_0001"
    paths = [job.output / f"{stem}{ending}" for ending in (".exr", ".png")]
    paths += [job.output / "frames" / f"{stem}{ending}" for ending in (".exr", ".png", ".json")]
    of_frame = {path.relative_to(job.output).as_posix(): path.stat().st_size for path in paths}
    of_shot = sum(path.stat().st_size for path in job.shot.iterdir())
    return {"scene": job.scene.stat().st_size, "shot": of_shot, **of_frame}


def _stored(use: Use, shared: Path) -> dict[str, object]:
    files = {Path(path).relative_to(shared).as_posix(): size for path, size in use.files.items()}
    return {**asdict(use), "files": files}


def _told(cost: Cost) -> str:
    return f" {cost.read / 1e6:9.3f} MB read {cost.written / 1e6:9.3f} MB written {cost.opened:7.1f} opened"


if __name__ == "__main__":
    main()
