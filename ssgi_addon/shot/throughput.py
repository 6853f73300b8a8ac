# SPDX-License-Identifier: GPL-3.0-or-later
"""How fast a shot was rendered, from when its processes began and its frames were finished."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from .manifests import Manifest

# Steps that are not part of a frame's total
_BESIDE_TOTAL = ("reference",)


@dataclass(frozen=True)
class _Work:
    """What a process did of a shot: from its start to its last frame, and the frames' own seconds."""

    begin: datetime
    end: datetime
    frames: int
    own_seconds: float

    @property
    def seconds(self) -> float:
        return (self.end - self.begin).total_seconds()


def throughput(finished: Sequence[Manifest]) -> dict[str, Any]:
    """Return how fast the frames of a shot came.

    Frames of processes that do not tell when they began or ended, or tell an impossible time (clocks that
    were set), do not count.

    Parameters
    ----------
    finished
        Manifests of the finished frames.

    Returns
    -------
    dict
        ``frames`` that count; ``processes``; ``begun`` and ``ended``, ISO times; ``wall_seconds`` in which at
        least one process worked; ``frames_per_minute`` of those; ``overhead_per_frame``, seconds of the
        processes beyond the frames' own: start, opening the scene, waiting for files. None for what cannot be
        told.
    """
    works = list(_works(finished))
    frames = sum(work.frames for work in works)
    wall = _covered_seconds((work.begin, work.end) for work in works)
    beyond = sum(work.seconds - work.own_seconds for work in works)
    return {
        "frames": frames,
        "processes": len(works),
        "begun": min(work.begin for work in works).isoformat() if works else None,
        "ended": max(work.end for work in works).isoformat() if works else None,
        "wall_seconds": wall if works else None,
        "frames_per_minute": 60.0 * frames / wall if wall > 0.0 else None,
        "overhead_per_frame": max(0.0, beyond / frames) if works else None,
    }


def _works(finished: Iterable[Manifest]) -> Iterable[_Work]:
    by_process: dict[str, list[Manifest]] = {}
    for manifest in finished:
        by_process.setdefault(manifest.process, []).append(manifest)
    for own in by_process.values():
        begins = [manifest.started for manifest in own if manifest.started]
        ends = [manifest.finished for manifest in own if manifest.finished]
        if len(begins) == len(ends) == len(own) and min(begins) < max(ends):
            steps = ("total", *_BESIDE_TOTAL)
            seconds = sum(manifest.seconds.get(step, 0.0) for manifest in own for step in steps)
            yield _Work(min(begins), max(ends), len(own), seconds)


def _covered_seconds(spans: Iterable[tuple[datetime, datetime]]) -> float:
    """Return how long at least one of the spans of time lasts."""
    covered, until = 0.0, None
    for begin, end in sorted(spans):
        if until is None or begin > until:
            until = begin
        if end > until:
            covered += (end - until).total_seconds()
            until = end
    return covered
