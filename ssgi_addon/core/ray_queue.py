# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays that wait for a walk, and those that one walk leaves to another."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .screen_rays import ScreenRays
from .slabs import ROWS, S_END
from .types import FloatArray, IntArray


@dataclass(eq=False)
class RayGroup:
    """Rays on their way.

    Attributes
    ----------
    id, field, slot, birth : (N,) int64
        Number of the ray, index of its field, its level together with its way to mirror and its field, and
        the step of its walk in which it came in.
    state : (ROWS, N) float32
        As `slabs` names the rows; NaN where no ray is.
    """

    id: IntArray
    field: IntArray
    slot: IntArray
    birth: IntArray
    state: FloatArray

    @classmethod
    def empty(cls, capacity: int, dtype: np.dtype) -> RayGroup:
        """Return a group with room for rays and none in it."""
        numbers, field, slot, birth = np.zeros((4, capacity), dtype=np.int64)
        return cls(numbers, field, slot, birth, np.full((ROWS, capacity), np.nan, dtype=dtype))

    @property
    def size(self) -> int:
        """Number of columns, with rays or without."""
        return int(self.id.shape[0])

    def put(self, place: IntArray, other: RayGroup) -> None:
        """Let the rays of another group stand in the given columns."""
        self.state[:, place] = other.state
        self.id[place], self.field[place] = other.id, other.field
        self.slot[place], self.birth[place] = other.slot, other.birth

    def alive(self) -> RayGroup:
        """Return the rays that have not ended."""
        kept = np.flatnonzero(~np.isnan(self.state[S_END]))
        return RayGroup(
            self.id.take(kept),
            self.field.take(kept),
            self.slot.take(kept),
            self.birth.take(kept),
            self.state.take(kept, axis=1),
        )

    def joined(self, other: RayGroup) -> RayGroup:
        """Return the rays of both."""
        return RayGroup(
            np.concatenate([self.id, other.id]),
            np.concatenate([self.field, other.field]),
            np.concatenate([self.slot, other.slot]),
            np.concatenate([self.birth, other.birth]),
            np.concatenate([self.state, other.state], axis=1),
        )


class RayQueue:
    """Rays that wait for several walks, which take a run of consecutive ones at a time.

    The last rays of a walk cost calls, not arithmetic, and calls hold the interpreter's lock: a walk that
    has few rays left, and no more to come, leaves them to the walk that ends last.

    Parameters
    ----------
    count
        Number of rays.
    rays_of
        Returns the rays of a run.
    walks
        Number of walks that share the queue.
    """

    def __init__(self, count: int, rays_of: Callable[[slice], ScreenRays], walks: int) -> None:
        self.count, self.rays_of, self.walks = count, rays_of, walks
        self.taken = 0
        self.stragglers: RayGroup | None = None
        self._lock = threading.Lock()

    def take(self, room: int) -> slice:
        """Return the numbers of the next rays, at most `room` of them."""
        with self._lock:
            begin, self.taken = self.taken, min(self.taken + room, self.count)
            return slice(begin, self.taken)

    def close(self) -> None:
        """Hand out no more rays."""
        with self._lock:
            self.count = self.taken

    def leave(self, group: RayGroup) -> RayGroup | None:
        """Leave a walk's last rays to another one; return all that were left to this one if it is the last.

        Births count from the moment that the group is left.
        """
        with self._lock:
            if self.stragglers is not None:
                group = group.joined(self.stragglers)
            self.walks -= 1
            self.stragglers = group if self.walks else None
            return None if self.walks else group
