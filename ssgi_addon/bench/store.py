# SPDX-License-Identifier: GPL-3.0-or-later
"""What is measured already, kept in files from run to run, and under which key it holds."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from ..files import read_json, write_json
from .machine import describe_machine
from .methods import Method
from .options import BenchOptions, SceneSource

_PACKAGE = Path(__file__).parents[1]
# Of the sources, what decides what our methods render; the rest of the package only measures and shows.
_RENDERING = ("core", "blender")


def digest(*parts: Any) -> str:
    """Return a short hash of plain data and of files."""
    state = hashlib.blake2b(digest_size=12)
    for part in parts:
        data = part.read_bytes() if isinstance(part, Path) else json.dumps(part, default=str).encode()
        state.update(len(data).to_bytes(8, "little") + data)
    return state.hexdigest()


def scene_key(source: SceneSource) -> str:
    """Return a hash of a scene's file; images and libraries beside it do not count."""
    if source.path is not None:
        return digest(source.path)
    return digest(*sorted(_PACKAGE.glob("blender/demo_*.py")), _PACKAGE / "blender" / "build.py")


@cache
def _rendering_code() -> str:
    """Return a hash of the sources that decide what our methods render, as they are at the first call."""
    files = (path for folder in _RENDERING for path in _PACKAGE.glob(f"{folder}/*.py"))
    return digest(*sorted(path for path in files if not path.name.startswith("bench_")))


def method_key(method: Method, scene: str, options: BenchOptions) -> str:
    """Return a hash of all that decides what a method renders, and where; of ours with the sources."""
    sources = _rendering_code() if method.kind == "ours" else ""
    identity = method.identity(options.resolution)
    return digest(scene, identity, options.resolution, options.reference_samples, describe_machine(), sources)


@dataclass
class Record:
    """What one method gave on one scene.

    Attributes
    ----------
    key
        Of `method_key`: other keys' records are measured anew.
    seconds
        Of each timed run, from the open scene to the finished picture.
    best
        What the fastest of them gave: ``seconds``, ``beyond_direct`` (ours: without the direct light's
        render), ``passes`` (ours), ``memory_mb``, ``scores`` by target, ``notes``.
    passes
        Scores of Cycles' own indirect passes, from a run that does not count.
    cold
        ``seconds`` and ``memory_mb`` of a process of its own; None where not measured.
    failure
        Why there is nothing.
    date
        When it was measured last.
    """

    key: str
    seconds: list[float] = field(default_factory=list)
    best: dict[str, Any] = field(default_factory=dict)
    passes: dict[str, Any] = field(default_factory=dict)
    cold: dict[str, Any] | None = None
    failure: str | None = None
    date: str = ""

    def add_run(self, seconds: float) -> bool:
        """Note a timed run and return whether it is the fastest so far."""
        self.seconds.append(seconds)
        self.date = datetime.now(UTC).isoformat(timespec="seconds")
        return seconds <= min(self.seconds)


@dataclass
class SceneState:
    """All that is known of one scene; `save` writes it, so that a run goes on where an earlier one ended.

    Attributes
    ----------
    name, key
        Of the scene.
    reference
        Key, samples, seconds and own errors.
    records
        By the method's name.
    running
        The method at hand: where a process ends without a word, this one is to blame.
    left_out
        By the method's name: why it was not measured.
    flicker
        By the method's name: ``rms``, ``seconds``.
    facts
        Of the scene: size, triangles and the like.
    failure
        Why nothing could be measured.
    """

    name: str
    key: str
    reference: dict[str, Any] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)
    running: str | None = None
    left_out: dict[str, str] = field(default_factory=dict)
    flicker: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    failure: str | None = None

    def record(self, method: Method, key: str) -> Record:
        """Return the method's record: an old one if its key still holds."""
        found = self.records.get(method.name)
        if found is None or found.key != key:
            found = self.records[method.name] = Record(key)
        return found

    def save(self, folder: Path) -> None:
        """Write ``scene.json``."""
        write_json(folder / "scene.json", asdict(self))


def load_scene(folder: Path, source: SceneSource) -> SceneState:
    """Return what is known of a scene; nothing where its file is another now."""
    key, path = scene_key(source), folder / "scene.json"
    if path.is_file():
        data = read_json(path)
        if data["key"] == key:
            records = {name: Record(**record) for name, record in data.pop("records").items()}
            return SceneState(**data, records=records)
    return SceneState(source.name, key)


def scene_folder(options: BenchOptions, name: str) -> Path:
    """Return where the files of a scene are."""
    return options.output / "scenes" / name


def picture_path(folder: Path, method: str, kind: str = "picture") -> Path:
    """Return where a method's picture is, or what else there is of that kind."""
    slug = re.sub(r"[^a-z0-9]+", "-", method.lower()).strip("-")
    return folder / f"{kind}-{slug}.png"
