# SPDX-License-Identifier: GPL-3.0-or-later
"""The walk of many rays through the pyramid at once; `tracer` says what it must find."""

from __future__ import annotations

from collections import deque

import numpy as np

from . import slabs
from .field_stack import FieldStack
from .ray_queue import RayGroup, RayQueue
from .screen_rays import ESCAPED, ScreenRays, TraceResult
from .slabs import (
    CELL,
    IN_SIGHT,
    INVERSE,
    MEETING,
    Q0,
    ROWS,
    S_END,
    S_VANISH,
    SIGN,
    SIZE,
    SPEED,
    START,
    VQ,
    S,
)
from .types import BoolArray, FloatArray, IntArray

# Rays that walk at once in one thread: fewer waste time on calls, more fall out of the cache.
CAPACITY = 131072
# Ended rays make room for waiting ones once they are this fraction; without waiting ones they are dropped.
_REFILL_FRACTION = 0.125
# A walk with fewer rays and no more to come leaves them to another one.
_STRAGGLERS = 32768
# A ray straight at the camera never leaves its cell: any finite end does, and keeps 0 * inf out.
_STRAIGHT_AT_CAMERA = 1e30


class Walk:
    """Rays on their way through depth fields, each ray through its own.

    Coordinates are mirrored so that every ray moves toward +x and +y, which leaves one rule for cell
    borders and makes the walk exactly symmetric under flips of the image. A ray keeps the cell of its current
    level; which of its four children it is in is decided on the way down, by the same border crossings that
    a linear walk compares, so all walks visit the same level-0 cells. A ray that has ended carries NaN until
    another one takes its place: every comparison with it is False, so it neither moves nor meets anything.

    The step blends by arithmetic, not by masks: a masked copy costs as much as thirty additions.

    Parameters
    ----------
    stack
        What the rays walk through.
    queue
        Where the rays wait.
    direction_vs : (3, N)
        View-space directions of all rays of the queue.
    starts_on_surface
        The rays leave the surface in their first cell.
    notes_hidden
        Look into the first slab that each ray passes behind, and note where.
    max_steps
        A ray that is not done after so many steps stays UNKNOWN; None lets every ray walk to its end.
    result
        Receives the answers.
    """

    def __init__(
        self,
        stack: FieldStack,
        queue: RayQueue,
        direction_vs: FloatArray,
        starts_on_surface: bool,
        notes_hidden: bool,
        max_steps: int | None,
        result: TraceResult,
    ) -> None:
        self.stack, self.queue, self.result = stack, queue, result
        self.slabs = slabs.SlabTest(stack, direction_vs, starts_on_surface, notes_hidden, result)
        self.starts_on_surface, self.notes_hidden = starts_on_surface, notes_hidden
        self.max_steps = max_steps
        dtype = direction_vs.dtype
        self.padded = np.array([[stack.padded_width], [stack.padded_height]], dtype=dtype)
        # One slot per level for each of the four ways to mirror, for each field
        level = np.arange(stack.levels, dtype=np.int64)
        last_column = (stack.padded_width >> level) - 1
        last_row = ((stack.padded_height >> level) - 1) * stack.stride
        ways = [stack.origins + x * last_column + y * last_row for y in (0, 1) for x in (0, 1)]
        first_cells = stack.cells_per_field * np.arange(len(stack.fields))
        self.base_of_slot = (first_cells[:, None] + np.concatenate(ways)).ravel()
        self.size_of_slot = np.tile((1 << level).astype(dtype), 4 * len(stack.fields))
        self.top_size = float(1 << (stack.levels - 1))
        self.group = RayGroup.empty(min(CAPACITY, queue.count), dtype)
        self.ended, self.ended_count = [np.arange(self.group.size)], self.group.size
        self._make_scratch()
        self.steps = 0
        self.births: deque[int] = deque()

    def _make_scratch(self) -> None:
        capacity, dtype = self.group.size, self.padded.dtype
        self.scratch = np.empty((8, capacity), dtype=dtype)
        self.bound = np.empty((capacity, 2), dtype=self.stack.planes.dtype)
        self.masks = np.empty((8, capacity), dtype=np.bool_)
        self.indices = np.empty((2, capacity), dtype=np.int64)
        # Cell numbers are exact in a float32 up to its mantissa
        is_small = self.stack.cells_per_field < 2**24
        self.numbers = np.empty(capacity, dtype=dtype if is_small else np.float64)

    def run(self) -> None:
        """Walk rays until the queue is empty and all of them have ended; write the results."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            self._walk()
            self.slabs.settle()

    def _walk(self) -> None:
        is_last = False
        while self.group.size:
            if self.ended_count > _REFILL_FRACTION * self.group.size:
                is_empty = self._refill()
                if is_empty and not is_last and self.group.size < _STRAGGLERS:
                    self.group.birth -= self.steps
                    group = self.queue.leave(self.group)
                    if group is None:
                        return
                    self._adopt(group)
                    is_last = True
            self._step()
            if self.births and self.births[0] + (self.max_steps or 0) == self.steps:
                self._expire(self.births.popleft())

    def _refill(self) -> bool:
        """Let waiting rays in where others have ended, else drop what has ended; return if none wait."""
        room = np.concatenate(self.ended)
        self.ended, self.ended_count = [], 0
        while room.size:
            admitted = self.queue.take(room.size)
            if admitted.start == admitted.stop:
                self.group = self.group.alive()
                self.ended, self.ended_count = [], 0
                return True
            rays, ids = self.queue.rays_of(admitted), np.arange(admitted.start, admitted.stop)
            lies_over = np.flatnonzero(rays.s_begin < np.inf)
            if lies_over.size < ids.size:
                rays, ids = rays.only(lies_over), ids.take(lies_over)
            place, room = room[: ids.size], room[ids.size :]
            group = self._place(rays, ids)
            self.group.put(place, group)
            self._note_ended(place.take(np.flatnonzero(np.isnan(group.state[S_END]))))
            if self.max_steps is not None and (not self.births or self.births[-1] != self.steps):
                self.births.append(self.steps)
        return False

    def _adopt(self, group: RayGroup) -> None:
        """Go on with the rays that other walks have left."""
        group.birth += self.steps
        self.group = group
        self._make_scratch()
        if self.max_steps is not None:
            self.births = deque(np.unique(group.birth).tolist())

    def _note_ended(self, ended: IntArray) -> None:
        self.ended.append(ended)
        self.ended_count += ended.shape[0]

    def _place(self, rays: ScreenRays, ids: IntArray) -> RayGroup:
        """Return rays at their start, out of the origin's own cell."""
        stack = self.stack
        state = np.empty((ROWS, ids.shape[0]), dtype=self.padded.dtype)
        for row, component in zip((0, 1, Q0, 3, 4, VQ), (*rays.start, *rays.velocity), strict=True):
            state[row] = component
        start, speed, inverse = state[START], state[SPEED], state[INVERSE]
        cell, s = state[CELL], state[S]
        is_mirrored = speed < 0.0
        state[SIGN] = 1.0 - 2.0 * is_mirrored
        slot = (4 * rays.field + is_mirrored[0] + 2 * is_mirrored[1]) * np.int64(stack.levels)
        np.copyto(start, self.padded - start, where=is_mirrored)
        np.abs(speed, out=speed)
        np.divide(1.0, speed, out=inverse)
        s[:] = rays.s_begin
        # The frame's border, by the expression that the walk uses for cell borders
        limit = np.where(is_mirrored, self.padded, [[stack.width], [stack.height]])
        s_exit = np.fmin(np.fmin(*((limit - start) * inverse)), _STRAIGHT_AT_CAMERA)
        state[S_VANISH] = rays.s_vanish
        state[S_END] = np.minimum(np.minimum(rays.s_vanish, rays.s_limit), s_exit)
        # Rays from outside begin in a border cell
        cell[:] = np.clip(np.floor(start + speed * s), 0.0, self.padded - 1.0)
        state[SIZE] = 1.0
        state[IN_SIGHT] = 1.0
        is_visible = s < state[S_END]
        if self.starts_on_surface:
            leaves = s == 0.0
            s_border = (cell + 1.0 - start) * inverse
            s_out = np.minimum(np.minimum(*s_border), state[S_END])
            cell += leaves & (s_border <= s_out)
            np.copyto(s, s_out, where=leaves)
        over = ~(s < state[S_END]) | (start >= limit).any(axis=0)
        group = RayGroup(ids, rays.field, slot, np.full_like(ids, self.steps), state)
        # Rays that end before they begin have seen nothing; only what has vanished by then stays unfollowed
        self._finish(group, np.flatnonzero(over & (is_visible | (state[S_END] < state[S_VANISH]))))
        state[S_END, over] = np.nan
        s[over] = np.nan
        return group

    def _step(self) -> None:
        """Test every ray against its cell, then skip the cell, look into it, or descend."""
        self.steps += 1
        group, state, count = self.group, self.group.state, self.group.size
        border, s_border = self.scratch[0:2, :count], self.scratch[2:4, :count]
        s_out = self.scratch[4, :count]
        touches, is_leaf, flag = self.masks[0:3, :count]
        moves = self.masks[3:5, :count]
        # Find where the ray leaves the cell
        np.add(state[CELL], 1.0, out=border)
        np.multiply(border, state[SIZE], out=border)
        np.subtract(border, state[START], out=s_border)
        np.multiply(s_border, state[INVERSE], out=s_border)
        np.minimum(s_border[0], s_border[1], out=s_out)
        np.minimum(s_out, state[S_END], out=s_out)
        self._test_bounds(s_out, touches, flag)
        # At level 0 look into the slab itself
        np.equal(state[SIZE], 1.0, out=is_leaf)
        np.logical_and(touches, is_leaf, out=flag)
        leaf = np.flatnonzero(flag)
        if leaf.size:
            inside = state[MEETING].take(leaf, axis=1)
            stopped = self.slabs.meet(inside, group.id.take(leaf), group.field.take(leaf), s_out.take(leaf))
            if self.notes_hidden:
                state[IN_SIGHT, leaf] = inside[IN_SIGHT]
            self._retire(leaf.take(stopped), s_out)
        # Leave the cell where nothing was met, else descend
        is_descending = np.greater(touches, is_leaf, out=touches)
        np.greater_equal(s_out, state[S_END], out=flag)
        np.greater(flag, is_descending, out=flag)
        over = np.flatnonzero(flag)
        if over.size:
            self._finish(group, over)
            self._retire(over, s_out)
        np.less_equal(s_border, s_out, out=moves)
        np.greater(moves, is_descending, out=moves)
        self._move(is_descending, moves, border)
        # s = s_out for those that leave: s never falls, so the larger one is it
        np.logical_not(is_descending, out=flag)
        np.multiply(s_out, flag, out=s_out)
        np.maximum(state[S], s_out, out=state[S])

    def _test_bounds(self, s_out: FloatArray, touches: BoolArray, flag: BoolArray) -> None:
        """Set `touches` where the ray passes its cell neither wholly in front of it nor wholly behind.

        Where rays are watched, those in sight touch what they pass behind, too.
        """
        stack, state, count = self.stack, self.group.state, self.group.size
        numbers, bound = self.numbers[:count], self.bound[:count]
        q_in, q_out, term = self.scratch[5:8, :count]
        index, base = self.indices[:, :count]
        column, row = state[CELL]
        sign_x, sign_y = state[SIGN]
        np.multiply(row, float(stack.stride), out=numbers, dtype=numbers.dtype)
        np.multiply(numbers, sign_y, out=numbers)
        np.multiply(column, sign_x, out=term)
        np.add(numbers, term, out=numbers)
        np.copyto(index, numbers, casting="unsafe")
        np.take(self.base_of_slot, self.group.slot, out=base, mode="clip")
        np.add(index, base, out=index)
        np.take(stack.bounds, index, out=bound.view(stack.bounds.dtype)[:, 0], mode="clip")
        for s, q in ((state[S], q_in), (s_out, q_out)):
            np.multiply(state[VQ], s, out=q)
            np.add(q, state[Q0], out=q)
        np.minimum(q_in, q_out, out=term)
        np.less_equal(term, bound[:, 0], out=touches)
        np.maximum(q_in, q_out, out=term)
        np.greater_equal(term, bound[:, 1], out=flag)
        if self.notes_hidden:
            np.logical_or(flag, state[IN_SIGHT], out=flag)
        np.logical_and(touches, flag, out=touches)

    def _move(self, is_descending: BoolArray, moves: BoolArray, border: FloatArray) -> None:
        """Step leaving rays into the next cell, one level up where its parent is new; let the others descend.

        `border` holds the borders ahead and is used up. A cell's number at another level is its number times
        the ratio of the sizes; on the way down the child is the one that holds the ray at its current s.
        """
        state, slot, count = self.group.state, self.group.slot, self.group.size
        size, cell = state[SIZE], state[CELL]
        np.add(cell, moves, out=cell)
        if self.top_size == 1.0:
            return
        ratio, whole = self.scratch[5, :count], self.scratch[6:8, :count]
        rises, is_below_top = self.masks[1, :count], self.masks[2, :count]
        is_beyond, is_even = self.masks[5:7, :count], self.masks[6:8, :count]
        # On the way down: beyond the middle once the ray has crossed it, and where it runs along it (NaN)
        np.multiply(size, 0.5, out=ratio)
        np.subtract(border, ratio, out=border)
        np.subtract(border, state[START], out=border)
        np.multiply(border, state[INVERSE], out=border)
        # On the way out: a new even cell has a new parent
        np.multiply(cell, 0.5, out=whole)
        np.floor(whole, out=self.scratch[2:4, :count])
        np.equal(whole, self.scratch[2:4, :count], out=is_even)
        np.logical_and(is_even, moves, out=is_even)
        np.logical_or(is_even[0], is_even[1], out=rises)
        np.less(size, self.top_size, out=is_below_top)
        np.logical_and(rises, is_below_top, out=rises)
        np.less(state[S], border, out=is_beyond)
        np.greater(is_descending, is_beyond, out=is_beyond)
        np.add(slot, rises, out=slot)
        np.subtract(slot, is_descending, out=slot)
        np.copyto(ratio, size)
        np.take(self.size_of_slot, slot, out=size, mode="clip")
        np.divide(ratio, size, out=ratio)
        np.multiply(cell, ratio, out=cell)
        np.add(cell, is_beyond, out=cell)
        np.floor(cell, out=cell)

    def _finish(self, group: RayGroup, over: IntArray) -> None:
        """Let rays that end at their vanishing point over background escape; all others stay UNKNOWN."""
        ids, field, last = group.id.take(over), group.field.take(over), group.state.take(over, axis=1)
        vanishes = last[S_END] == last[S_VANISH]
        left, gone = np.flatnonzero(~vanishes), np.flatnonzero(vanishes)
        end = last[S_END].take(left)
        self.result.distance[ids.take(left)] = self.slabs.distance(last.take(left, axis=1), end)
        last = last.take(gone, axis=1)
        cell = np.floor(last[START] + last[SPEED] * last[S_END])
        pixel = self.slabs.pixel(cell, last[SIGN], field.take(gone))
        self.result.status[ids.take(gone[self.stack.is_background.take(pixel)])] = ESCAPED

    def _expire(self, birth: int) -> None:
        """Let rays that are out of steps end where they are, unanswered."""
        group = self.group
        over = np.flatnonzero((group.birth == birth) & ~np.isnan(group.state[S_END]))
        last = group.state.take(over, axis=1)
        self.result.distance[group.id.take(over)] = self.slabs.distance(last, last[S])
        self._retire(over, group.state[S])

    def _retire(self, ended: IntArray, s: FloatArray) -> None:
        """Let rays that have ended stand still: `s` is where they go next."""
        s[ended] = np.nan
        self.group.state[S_END, ended] = np.nan
        self._note_ended(ended)
