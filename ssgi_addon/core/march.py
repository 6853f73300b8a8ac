# SPDX-License-Identifier: GPL-3.0-or-later
"""The linear march: samples of the depth buffer at even steps along each ray.

After McGuire and Mara 2014, "Efficient GPU Screen-Space Ray Tracing": even steps along the longer screen
axis, with a depth that is correct in perspective because q is linear there. It deviates: a pixel is the patch
and the slab of `depth_field`, not one depth with a thickness; a sample is a point, not the depths between two
samples; bisection refines what is found; and what a ray cannot see is unknown.

With h = q_ray - q_front, as in `tracer`, a sample is inside the slab of the pixel under it where
-slab <= h <= 0. Between the last sample and the first one inside, bisection finds an earlier point inside.
There the ray meets the pixel, and `slabs.SlabTest.judge` decides as for a walk, by the height above the
pixel's front that the ray had at the last point outside: from in front, or from no deeper than the step
between two pixels, it is a HIT on a surface that faces the ray; from deeper, or on a surface that faces away,
BLOCKED.

It misses what lies between two samples: a ray that passes through a whole slab from one sample to the next
goes on, and so does one through a thing narrower than a step. What it finds lies behind the front by at most
the length of the last bisected step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .field_stack import FieldStack
from .ray_queue import RayQueue
from .screen_rays import TraceResult
from .slabs import CELL, MEETING, S_END, SIGN, SPEED, START, S
from .types import BoolArray, FloatArray, IntArray
from .walk import Walk

# Shorter steps show nothing new, and a slip to a millionth of a pixel would never end.
_SHORTEST_STEP = 1.0 / 32.0


@dataclass(frozen=True)
class MarchOptions:
    """How finely a march samples.

    Attributes
    ----------
    step
        Distance of the samples along the longer screen axis, pixels; at least 1/32.
    bisections
        Times that the interval which holds a crossing is halved.
    """

    step: float
    bisections: int


class March(Walk):
    """Rays that sample level 0 at even steps; all else is as in a walk, and one step is one sample.

    The first sample lies half a step beyond the origin's own cell: a ray along a row or column then samples
    pixels at their centres, not on their borders. Samples of a bisection do not count as steps.

    Parameters
    ----------
    stack, queue, direction_vs, starts_on_surface, max_steps, result
        As in `Walk`.
    options
        How finely to sample.
    """

    def __init__(
        self,
        stack: FieldStack,
        queue: RayQueue,
        direction_vs: FloatArray,
        starts_on_surface: bool,
        max_steps: int | None,
        result: TraceResult,
        options: MarchOptions,
    ) -> None:
        super().__init__(stack, queue, direction_vs, starts_on_surface, max_steps, result)
        self.options = options
        self.frame = np.array([[stack.width], [stack.height]], dtype=direction_vs.dtype)

    def _step(self) -> None:
        """Test every ray at its next sample."""
        self.steps += 1
        group, state = self.group, self.group.state
        length = max(self.options.step, _SHORTEST_STEP) / np.maximum(*state[SPEED])
        length *= np.where(group.birth == self.steps - 1, 0.5, 1.0)
        # A step too short for the last digit of s still moves
        s = np.maximum(state[S] + length, np.nextafter(state[S], np.inf))
        np.minimum(s, state[S_END], out=s)
        found = np.flatnonzero(self._is_inside(state, group.field, s))
        if found.size:
            self._retire(found.take(self._meet(found, s.take(found))), s)
        over = np.flatnonzero(s >= state[S_END])
        if over.size:
            self._finish(group, over)
            self._retire(over, s)
        state[S] = s

    def _is_inside(self, state: FloatArray, field: IntArray, s: FloatArray) -> BoolArray:
        """Set each ray's cell to the one under it at s; return whether it is inside that cell's slab."""
        ahead = np.where(state[SIGN] < 0.0, self.padded, self.frame)  # the frame's border, (2, N)
        np.minimum(np.floor(state[START] + state[SPEED] * s), ahead - 1.0, out=state[CELL])
        _, h0, dh, slab = self.slabs.heights(state, field)
        h = h0 + dh * s
        is_inside: BoolArray = (h <= 0.0) & (h >= -slab)
        if self.starts_on_surface:
            is_inside &= (state[CELL] != np.floor(state[START])).any(axis=0)
        return is_inside

    def _meet(self, found: IntArray, s: FloatArray) -> IntArray:
        """Write what the found rays, inside at s, meet after their last samples; return those that stop."""
        state, ids = self.group.state[MEETING].take(found, axis=1), self.group.id.take(found)
        field, outside, inside = self.group.field.take(found), state[S].copy(), s
        for _ in range(self.options.bisections):
            middle = 0.5 * (outside + inside)
            is_inside = self._is_inside(state, field, middle)
            inside = np.where(is_inside, middle, inside)
            outside = np.where(is_inside, outside, middle)
        self._is_inside(state, field, inside)
        pixel, h0, dh, slab = self.slabs.heights(state, field)
        h_outside = h0 + dh * outside
        return np.flatnonzero(self.slabs.judge(state, ids, field, pixel, h_outside, slab, inside))
