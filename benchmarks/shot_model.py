# SPDX-License-Identifier: GPL-3.0-or-later
"""What a shot costs on many machines, from what its parts cost on one."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

# Of a network link of one Gbit/s; protocols take a little of it, which is left out.
GIGABIT = 125e6


@dataclass(frozen=True)
class Cost:
    """What a part of a shot takes.

    Attributes
    ----------
    seconds
        Of a worker.
    read, written
        Bytes of the storage that workers share. A file counts once for each process that reads it.
    opened
        How often a path there is opened, or looked for in vain.
    """

    seconds: float = 0.0
    read: float = 0.0
    written: float = 0.0
    opened: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def __sub__(self, other: Cost) -> Cost:
        return self + -1.0 * other

    def __rmul__(self, count: float) -> Cost:
        return Cost(*(count * value for value in astuple(self)))


@dataclass(frozen=True)
class ShotParts:
    """What the parts of a shot take.

    Attributes
    ----------
    prepare
        The first step.
    task
        A process that renders a chunk, but for its frames: start, scene, what was prepared.
    frame
        A frame of it.
    merge, merged_frame
        The last step, and what it takes for each frame.
    """

    prepare: Cost
    task: Cost
    frame: Cost
    merge: Cost = Cost()
    merged_frame: Cost = Cost()


def fitted(few: Cost, few_frames: int, many: Cost, many_frames: int) -> tuple[Cost, Cost]:
    """Return what a process takes by itself, and for each frame, from two that differ in their frames."""
    each = 1.0 / (many_frames - few_frames) * (many - few)
    return few - few_frames * each, each


def tasks_cost(parts: ShotParts, frames: int, chunk: int) -> Cost:
    """Return what all tasks of the frames take together: of how many workers they are is all the same."""
    return math.ceil(frames / chunk) * parts.task + frames * parts.frame


def shot_cost(parts: ShotParts, frames: int, chunk: int) -> Cost:
    """Return what a shot takes, the first step and the last one with it."""
    return parts.prepare + tasks_cost(parts, frames, chunk) + parts.merge + frames * parts.merged_frame


def frames_seconds(parts: ShotParts, frames: int, chunk: int, workers: int) -> float:
    """Return how long equal workers render frames that a queue hands out in chunks."""
    rounds, last = divmod(math.ceil(frames / chunk), workers)
    whole = parts.task.seconds + min(chunk, frames) * parts.frame.seconds
    return (rounds + bool(last)) * whole


def shot_seconds(parts: ShotParts, frames: int, chunk: int, workers: int) -> float:
    """Return how long the whole shot takes; its first step and its last one run on one worker."""
    alone = parts.prepare + parts.merge + frames * parts.merged_frame
    return alone.seconds + frames_seconds(parts, frames, chunk, workers)


def storage_rate(parts: ShotParts, chunk: int, workers: int) -> Cost:
    """Return what workers take of the storage in each second while they render; `seconds` is 1."""
    own = parts.task + chunk * parts.frame
    taken = workers / own.seconds * own
    return Cost(1.0, taken.read, taken.written, taken.opened)


def workers_of_link(parts: ShotParts, chunk: int, bytes_per_second: float) -> int:
    """Return with how many workers a link to the storage is full, which carries so much each way."""
    one = storage_rate(parts, chunk, 1)
    return math.ceil(bytes_per_second / max(one.read, one.written))
