# SPDX-License-Identifier: GPL-3.0-or-later
"""What a process of the benchmark is asked to do."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ..files import read_json, write_json
from .methods import Method, all_methods, chosen
from .options import BenchOptions, SceneSource

COMMAND = "bench-worker"


@dataclass(frozen=True)
class Task:
    """Work for one process.

    Attributes
    ----------
    kind
        ``"measure"`` all methods of a scene, ``"cold"`` one method, ``"flicker"`` of the main methods.
    options, source
        Of the run.
    deadline
        `time.time` after which no measurement starts.
    method
        The name, for ``"cold"``.
    """

    kind: str
    options: BenchOptions
    source: SceneSource
    deadline: float
    method: str = ""

    def methods(self) -> list[Method]:
        """Return the methods of the run."""
        return chosen(all_methods(quick=self.options.quick), self.options.methods)


def write_task(task: Task, path: Path) -> None:
    """Write a task for `read_task`."""
    data = asdict(task)
    data["options"] = {name: _plain(value) for name, value in data["options"].items()}
    data["source"] = {name: _plain(value) for name, value in data["source"].items()}
    write_json(path, data)


def read_task(path: Path) -> Task:
    """Read what `write_task` wrote."""
    data = read_json(path)
    given = data.pop("options")
    options = BenchOptions(
        **{item.name: _typed(item.name, given[item.name]) for item in fields(BenchOptions)}
    )
    source = data.pop("source")
    path_ = None if source["path"] is None else Path(source["path"])
    return Task(options=options, source=SceneSource(source["name"], path_), **data)


def _plain(value: Any) -> Any:
    return str(value.absolute()) if isinstance(value, Path) else value


def _typed(name: str, value: Any) -> Any:
    if name in ("output", "cache"):
        return None if value is None else Path(value)
    return tuple(value) if isinstance(value, list) else value
