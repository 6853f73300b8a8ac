# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the manifests that runs leave of their frames; a folder may hold anything, and may be still written.

A manifest that cannot be read is told with its reason and never stops the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from ..errors import SSGIError
from ..manifest import FOLDER, FORMAT, VERSION, stem
from .json_fields import field_of, items_of, number_of, optional_of, read_json, time_of

_LARGEST_FRAME = 10_000_000


@dataclass(frozen=True)
class Manifest:
    """What a run says of one frame.

    Attributes
    ----------
    name, frame
        Whose it is; `stem` is both, as in the names of the frame's files.
    machine
        Where it was rendered.
    finished
        When; None where the manifest does not tell.
    versions
        Of ssgi, Blender, Python and numpy.
    settings_hash, settings
        What decides the picture.
    shot
        Hash of the captures that the frames of a shot share; None where there were none.
    camera
        Of the small samples, as `camera_file.camera_to_json` gives it.
    process, started
        Which process rendered it, and since when that had been running.
    record
        The frame's entry in the report of its run; None where it failed.
    failure
        Why it failed.
    """

    name: str
    frame: int
    machine: str
    finished: datetime | None
    versions: Mapping[str, str]
    settings_hash: str
    settings: Mapping[str, Any]
    shot: str | None
    camera: Any
    process: str
    started: datetime | None
    record: Mapping[str, Any] | None
    failure: str | None

    @property
    def stem(self) -> str:
        """Name of the frame's files without their endings."""
        return stem(self.name, self.frame)

    @property
    def seconds(self) -> Mapping[str, float]:
        """Wall time of the frame's steps; empty where it failed."""
        return self.record["seconds"] if self.record else {}


@dataclass(frozen=True)
class Unread:
    """A file that tells nothing, and why; `counts` where it should have."""

    file: str
    why: str
    counts: bool = True


@dataclass
class Shot:
    """The frames of one scene in a folder, by number, and the files that could not be read."""

    folder: Path
    name: str
    manifests: dict[int, Manifest] = field(default_factory=dict)
    unread: list[Unread] = field(default_factory=list)


def read_shot(folder: Path, name: str | None = None) -> Shot:
    """Read all manifests of a shot.

    Parameters
    ----------
    folder
        Of the results; the manifests are in its ``frames``.
    name
        Of the scene; None means the only one that is there.

    Raises
    ------
    SSGIError
        If there is none, or `name` is None and there are several.
    """
    shots: dict[str, Shot] = {}
    foreign: list[Unread] = []
    for path in _candidates(folder, name):
        own_name = path.stem.rpartition("_")[0]
        try:
            manifest = read_manifest(path)
        except FileNotFoundError:
            continue  # it went away, as files do in a folder that others write to
        except _ForeignFileError as error:
            foreign.append(Unread(path.name, str(error), counts=False))
            continue
        except SSGIError as error:
            shots.setdefault(own_name, Shot(folder, own_name)).unread.append(Unread(path.name, str(error)))
            continue
        shots.setdefault(own_name, Shot(folder, own_name)).manifests[manifest.frame] = manifest
    shot = _only(shots, folder, name)
    shot.unread.extend(foreign)
    shot.manifests = dict(sorted(shot.manifests.items()))
    return shot


def read_manifest(path: Path) -> Manifest:
    """Read one manifest.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    SSGIError
        If it cannot be read, is no manifest, or one of another version, or does not say what one has to.
    """
    data = read_json(path)
    if not isinstance(data, Mapping) or data.get("format") != FORMAT:
        raise _ForeignFileError("it is not a frame's manifest")
    if data.get("version") != VERSION:
        told = str(data.get("version"))[:20]
        raise SSGIError(f"its format has version {told}, this is for {VERSION}: use the ssgi that wrote it")
    try:
        manifest = _manifest(data)
    except ValueError as error:
        raise SSGIError(f"it is damaged: {error}; render the frame again") from error
    if path.stem != manifest.stem:
        raise SSGIError(
            f"it is of {manifest.stem}, so it was renamed or copied: name it {manifest.stem}.json"
        )
    return manifest


class _ForeignFileError(SSGIError):
    """A file of somebody else."""


def _candidates(folder: Path, name: str | None) -> list[Path]:
    """Return the files whose names are those of manifests, of one scene or of all."""
    try:
        paths = sorted((folder / FOLDER).iterdir())
    except OSError:
        paths = []
    return [
        path
        for path in paths
        if re.search(r"_-?\d+\.json$", path.name)
        and not path.name.startswith(".")
        and name in (None, path.stem.rpartition("_")[0])
        and path.is_file()
    ]


def _only(shots: Mapping[str, Shot], folder: Path, name: str | None) -> Shot:
    """Return the one shot that is meant; files of others that tell nothing are told."""
    if not shots:
        whose = f"of {name}" if name else "of a shot"
        raise SSGIError(f"{folder} holds no frames {whose}: give the folder that ssgi render wrote to")
    told = [shot for shot in shots.values() if shot.manifests] or list(shots.values())
    if len(told) > 1:
        names = ", ".join(sorted(shot.name for shot in told))
        raise SSGIError(f"{folder} holds frames of several scenes ({names}): choose one with --name")
    (shot,) = told
    others = (entry for other in shots.values() if other is not shot for entry in other.unread)
    shot.unread += [replace(entry, counts=False) for entry in others]
    return shot


def _manifest(data: Mapping[str, Any]) -> Manifest:
    """Check what is used; raise ValueError where something is missing or of another kind."""
    process = field_of(data, "process", Mapping)
    failure = optional_of(data, "failure", str)
    record = optional_of(data, "record", Mapping)
    if failure is None and record is None:
        raise ValueError("it has neither a record nor a failure")
    frame = field_of(data, "frame", int)
    if isinstance(frame, bool) or abs(frame) > _LARGEST_FRAME:
        raise ValueError(f"frame {frame!r}")
    return Manifest(
        name=field_of(data, "name", str),
        frame=frame,
        machine=field_of(data, "machine", str),
        finished=time_of(data, "finished"),
        versions={str(key): str(value) for key, value in field_of(data, "versions", Mapping).items()},
        settings_hash=field_of(data, "settings_hash", str),
        settings=field_of(data, "settings", Mapping),
        shot=optional_of(data, "shot", str),
        camera=data.get("camera"),
        process=field_of(process, "id", str),
        started=time_of(process, "started"),
        record=None if failure is not None or record is None else _record(record),
        failure=failure,
    )


def _record(data: Mapping[str, Any]) -> Mapping[str, Any]:
    told = field_of(data, "seconds", Mapping)
    seconds = {name: number_of(told, name) for name in told}
    if None in seconds.values() or "total" not in seconds:
        raise ValueError("seconds: expected numbers, and a total")
    skipped = [
        {"what": field_of(entry, "what", str), "why": field_of(entry, "why", str)}
        for entry in items_of(data, "skipped", Mapping)
    ]
    metrics = optional_of(data, "metrics", Mapping)
    return {
        "seconds": seconds,
        "peak_memory_mb": number_of(data, "peak_memory_mb"),
        "known": number_of(data, "known"),
        "skipped": skipped,
        "notes": list(items_of(data, "notes", str)),
        "metrics": None if metrics is None else {str(k): dict(_metrics(metrics, k)) for k in metrics},
    }


def _metrics(metrics: Mapping[str, Any], name: str) -> Iterator[tuple[str, float | None]]:
    row = field_of(metrics, name, Mapping)
    return ((figure, number_of(row, figure)) for figure in row)
