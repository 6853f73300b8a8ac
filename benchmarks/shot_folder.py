# SPDX-License-Identifier: GPL-3.0-or-later
"""What a job of a shot has left in its folder, and what is wrong with it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from benchmarks.shot_job import ShotJob
from ssgi_addon.errors import SSGIError
from ssgi_addon.files import read_json
from ssgi_addon.manifest import FOLDER
from ssgi_addon.prepared import FILE
from tests.faults.kills import unfinished

PHASES = ("prepare", "frames", "report")

# Inode, time and size of files by name: what changes when a file is written again, be it with the same bytes
Stamps = Mapping[str, tuple[int, int, int]]


def phase(job: ShotJob) -> str:
    """Return what a job is at, by the files that are there."""
    if not (job.shot / FILE).exists():
        return PHASES[0]
    return PHASES[2] if len(finished(job)) == job.count else PHASES[1]


def finished(job: ShotJob) -> set[str]:
    """Return the names of the frames whose manifests are there."""
    try:
        names = os.listdir(job.output / FOLDER)
    except FileNotFoundError:
        return set()
    return {name.removesuffix(".json") for name in names if name.endswith(".json")}


def pictures(job: ShotJob) -> dict[str, bytes]:
    """Return the contents of the frames' files but for the manifests, which tell times."""
    return {path.relative_to(job.output).as_posix(): path.read_bytes() for path in _picture_paths(job)}


def has_begun_another(job: ShotJob) -> bool:
    """Whether files of a frame are there that is not finished."""
    return not {path.stem for path in _picture_paths(job)} <= finished(job)


def stamps(job: ShotJob) -> dict[str, tuple[int, int, int]]:
    """Return the stamps of all files of finished frames, and of the prepared shot where it is whole."""
    paths = [job.output / place for name in finished(job) for place in _files_of(name)]
    if (job.shot / FILE).exists():
        paths += [path for path in job.shot.iterdir() if not path.name.endswith(".tmp")]
    found = {}
    for path in paths:
        if path.is_file():
            state = path.stat()
            found[path.relative_to(job.output).as_posix()] = (state.st_ino, state.st_mtime_ns, state.st_size)
    return found


def stopped_faults(job: ShotJob, wanted: Mapping[str, bytes], before: Stamps) -> list[str]:
    """Say what is wrong with what a stopped job has left.

    Parameters
    ----------
    job
        It may have left temporary files.
    wanted
        As of `pictures`, without a stop.
    before
        Of an earlier stop: none of these files may have been touched since.
    """
    faults = [
        f"{name} is not as without a stop"
        for name, data in pictures(job).items()
        if data != wanted.get(name)
    ]  # fmt: skip
    for name in finished(job):
        faults += [f"{path} is missing" for path in _files_of(name) if not (job.output / path).is_file()]
    now = stamps(job)
    faults += [f"{name} was written again" for name, stamp in before.items() if now.get(name) != stamp]
    return faults + [f"{path.name} is no JSON" for path in job.output.rglob("*.json") if not _is_json(path)]


def final_faults(job: ShotJob, wanted: Mapping[str, bytes], before: Stamps, temporary: Path) -> list[str]:
    """Say what is wrong with what a job has left at its end, there and in the system's temporary folder."""
    faults = stopped_faults(job, wanted, before)
    if pictures(job).keys() != wanted.keys():
        faults.append("not all frames are there")
    faults += [f"{name} was left behind" for place in (job.output, temporary) for name in unfinished(place)]
    report = read_json(job.output / "shot_report.json")
    told = [frame["frame"] for frame in report["frames"]]
    if told != list(job.frames) or report["counts"]["finished"] != job.count:
        faults.append(f"the report has the frames {told}, {report['counts']}")
    return faults


def _picture_paths(job: ShotJob) -> list[Path]:
    folders = (job.output, job.output / FOLDER)
    paths = [path for folder in folders for path in sorted(folder.glob(f"{job.scene.stem}_*"))]
    return [path for path in paths if path.suffix in (".exr", ".png")]


def _files_of(name: str) -> Iterator[str]:
    yield from (f"{name}.exr", f"{name}.png")
    yield from (f"{FOLDER}/{name}{ending}" for ending in (".exr", ".png", ".json"))


def _is_json(path: Path) -> bool:
    try:
        read_json(path)
    except SSGIError:
        return False
    return True
