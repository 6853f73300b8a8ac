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
between two pixels (where the ray came into the pixel over an edge, than a pixel is wide), it is a HIT on a
surface that faces the ray; from deeper, or on a surface that faces away, BLOCKED.

It misses what lies between two samples: a ray that passes through a whole slab from one sample to the next
goes on, and so does one through a thing narrower than a step. What it finds lies behind the front by at most
the length of the last bisected step. Where a ray goes out of sight it does not note.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .field_stack import FieldStack
from .ray_queue import RayGroup, RayQueue
from .screen_rays import ScreenRays, TraceResult
from .slabs import CELL, INVERSE, S_END, SIGN, SIZE, SPEED, START, S
from .types import BoolArray, FloatArray, IntArray
from .walk import Walk

# What a march keeps in rows of the state that it has no other use for: the last column and row of the frame
# ahead, mirrored, and the length of a step in s.
LAST_CELL, LENGTH = INVERSE, SIZE
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
        super().__init__(stack, queue, direction_vs, starts_on_surface, False, max_steps, result)
        self.step, self.bisections = max(options.step, _SHORTEST_STEP), options.bisections
        self.frame = np.array([[stack.width], [stack.height]], dtype=direction_vs.dtype)

    def _place(self, rays: ScreenRays, ids: IntArray) -> RayGroup:
        """Return rays at their start, with what a step needs."""
        group = super()._place(rays, ids)
        state = group.state
        state[LENGTH] = self.step / np.maximum(*state[SPEED])
        state[LAST_CELL] = np.where(state[SIGN] < 0.0, self.padded, self.frame) - 1.0
        return group

    def _step(self) -> None:
        """Test every ray at its next sample."""
        self.steps += 1
        group, state, count = self.group, self.group.state, self.group.size
        position, s = self.scratch[0:2, :count], self.scratch[4, :count]
        touches, flag = self.masks[0:2, :count]
        # Go on by a step, by half of the first one; what is too short to count in s still moves
        np.equal(group.birth, self.steps - 1, out=flag)
        np.divide(state[LENGTH], flag + np.int8(1), out=s)
        np.add(state[S], s, out=s)
        np.maximum(s, np.nextafter(state[S], np.inf), out=s)
        np.minimum(s, state[S_END], out=s)
        # Leave out the rays that pass in front of all that is in the cell below, or behind it
        _find_cell(state, s, position)
        self._test_bounds(s, touches, flag)
        near = np.flatnonzero(touches)
        if near.size:
            self._retire(near.take(self._meet(near, s.take(near))), s)
        np.greater_equal(s, state[S_END], out=flag)
        over = np.flatnonzero(flag)
        if over.size:
            self._finish(group, over)
            self._retire(over, s)
        np.copyto(state[S], s)

    def _meet(self, near: IntArray, s: FloatArray) -> IntArray:
        """Refine and write what those rays meet that are inside a slab at s; return which of them stop."""
        state, field = self.group.state.take(near, axis=1), self.group.field.take(near)
        found = np.flatnonzero(self._is_inside(state, field, s))
        if not found.size:
            return found
        state, field, ids = state.take(found, axis=1), field.take(found), self.group.id.take(near.take(found))
        outside, inside = state[S].copy(), s.take(found)
        for _ in range(self.bisections):
            middle = 0.5 * (outside + inside)
            is_inside = self._is_inside(state, field, middle)
            inside = np.where(is_inside, middle, inside)
            outside = np.where(is_inside, outside, middle)
        _find_cell(state, inside, np.empty_like(state[CELL]))
        pixel, h0, dh, slab = self.slabs.heights(state, field)
        stops = self.slabs.judge(state, ids, field, pixel, h0 + dh * outside, slab, inside)
        return found[stops]

    def _is_inside(self, state: FloatArray, field: IntArray, s: FloatArray) -> BoolArray:
        """Move rays over the cell below them at s; return which are inside its slab."""
        _find_cell(state, s, np.empty_like(state[CELL]))
        _, h0, dh, slab = self.slabs.heights(state, field)
        h = h0 + dh * s
        is_inside: BoolArray = (h <= 0.0) & (h >= -slab)
        return is_inside


def _find_cell(state: FloatArray, s: FloatArray, position: FloatArray) -> None:
    """Set each ray's cell to the one below it at s; `position` is used up."""
    np.multiply(state[SPEED], s, out=position)
    np.add(position, state[START], out=position)
    np.floor(position, out=position)
    np.minimum(position, state[LAST_CELL], out=state[CELL])
