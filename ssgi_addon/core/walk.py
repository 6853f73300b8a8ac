# SPDX-License-Identifier: GPL-3.0-or-later
"""The walk of many rays through the pyramid at once; `tracer` says what it must find."""

from __future__ import annotations

import numpy as np

from .field_stack import FieldStack
from .screen_rays import BLOCKED, ESCAPED, HIT, ScreenRays, TraceResult
from .types import BoolArray, FloatArray, IntArray

# Rays that walk at once: fewer waste time on calls, more fall out of the cache.
CAPACITY = 262144
# Ended rays are dropped, and waiting ones let in, once they are this fraction: that costs a third of a step.
_REFILL_FRACTION = 0.25
_SELF_CONTACT_PX = 2
# A ray straight at the camera never leaves its cell: any finite end does, and keeps 0 * inf out.
_STRAIGHT_AT_CAMERA = 1e30

# Rows of the state; x and y stand together, so that one call serves both. Mirrored coordinates throughout.
_START = slice(0, 2)
_Q0 = 2
_SPEED = slice(3, 5)
_VQ = 5
_SIGN = slice(6, 8)  # -1 where the axis is mirrored
_CELL = slice(8, 10)  # column and row at the current level
_S = 10  # on entry into the cell
_MEETING = slice(0, 11)  # all that the look into a slab needs
_INVERSE = slice(11, 13)  # 1 / speed
_SIZE = 13  # of the cell, pixels
_S_END = 14
_ROWS = 15


class Walk:
    """Rays on their way through depth fields, each ray through its own.

    Coordinates are mirrored so that every ray moves toward +x and +y, which leaves one rule for cell
    borders and makes the walk exactly symmetric under flips of the image. A ray keeps the cell of its current
    level; which of its four children it is in is decided on the way down, by the same border crossings that
    a linear walk compares, so all walks visit the same level-0 cells. A ray that has ended carries NaN until
    it is dropped: every comparison with it is False, so it neither moves nor meets anything.

    The step blends by arithmetic, not by masks: a masked copy costs as much as thirty additions.

    Parameters
    ----------
    stack
        What the rays walk through.
    rays, direction_vs
        All rays, and their view-space directions (3, N).
    starts_on_surface
        The rays leave the surface in their first cell.
    result
        Receives the answers.
    """

    def __init__(
        self,
        stack: FieldStack,
        rays: ScreenRays,
        direction_vs: FloatArray,
        starts_on_surface: bool,
        result: TraceResult,
    ) -> None:
        self.stack, self.rays, self.direction_vs, self.result = stack, rays, direction_vs, result
        self.starts_on_surface = starts_on_surface
        dtype = rays.s_begin.dtype
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
        self.waiting = np.flatnonzero(rays.s_begin < np.inf)  # the others never lie over the frame
        capacity = min(CAPACITY, self.waiting.shape[0])
        self.id = np.empty(0, dtype=np.int64)
        self.slot = np.empty(0, dtype=np.int64)
        self.state = np.empty((_ROWS, 0), dtype=dtype)
        self.scratch = np.empty((9, capacity), dtype=dtype)
        self.masks = np.empty((8, capacity), dtype=np.bool_)
        self.indices = np.empty((2, capacity), dtype=np.int64)
        # Cell numbers are exact in a float32 up to its mantissa
        is_small = stack.cells_per_field < 2**24
        self.numbers = self.scratch[8] if is_small else np.empty(capacity, dtype=np.float64)
        self.ended = 0

    def run(self) -> None:
        """Walk all rays to their ends and write the results."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            self._refill()
            while self.id.shape[0]:
                self._step()
                if self.ended > _REFILL_FRACTION * self.id.shape[0]:
                    self._refill()

    def _refill(self) -> None:
        """Drop the rays that have ended, and let waiting ones in."""
        s_end = self.state[_S_END]
        kept = np.flatnonzero(s_end == s_end)
        self.state = self.state.take(kept, axis=1)
        self.id, self.slot = self.id.take(kept), self.slot.take(kept)
        self.ended = 0
        room = self.scratch.shape[1] - kept.shape[0]
        if self.waiting.shape[0] and room:
            admitted, self.waiting = self.waiting[:room], self.waiting[room:]
            state, slot = self._place(admitted)
            self.state = np.concatenate([self.state, state], axis=1)
            self.id = np.concatenate([self.id, admitted])
            self.slot = np.concatenate([self.slot, slot])
            self.ended = int(np.isnan(self.state[_S_END]).sum())

    def _place(self, ids: IntArray) -> tuple[FloatArray, IntArray]:
        """Return state and slot of rays at their start, out of the origin's own cell."""
        stack, rays = self.stack, self.rays
        state = np.empty((_ROWS, ids.shape[0]), dtype=self.state.dtype)
        for row, component in zip((0, 1, _Q0, 3, 4, _VQ), (*rays.start, *rays.velocity), strict=True):
            component.take(ids, out=state[row], mode="clip")
        start, speed, inverse = state[_START], state[_SPEED], state[_INVERSE]
        cell, s = state[_CELL], state[_S]
        is_mirrored = speed < 0.0
        state[_SIGN] = 1.0 - 2.0 * is_mirrored
        slot = (4 * rays.field.take(ids) + is_mirrored[0] + 2 * is_mirrored[1]) * np.int64(stack.levels)
        np.copyto(start, self.padded - start, where=is_mirrored)
        np.abs(speed, out=speed)
        np.divide(1.0, speed, out=inverse)
        rays.s_begin.take(ids, out=s, mode="clip")
        # The frame's border, by the expression that the walk uses for cell borders
        limit = np.where(is_mirrored, self.padded, [[stack.width], [stack.height]])
        s_exit = np.fmin(np.fmin(*((limit - start) * inverse)), _STRAIGHT_AT_CAMERA)
        state[_S_END] = np.minimum(np.minimum(rays.s_vanish.take(ids), rays.s_limit.take(ids)), s_exit)
        # Rays from outside begin in a border cell
        cell[:] = np.clip(np.floor(start + speed * s), 0.0, self.padded - 1.0)
        state[_SIZE] = 1.0
        is_visible = s < state[_S_END]
        if self.starts_on_surface:
            leaves = s == 0.0
            s_border = (cell + 1.0 - start) * inverse
            s_out = np.minimum(np.minimum(*s_border), state[_S_END])
            cell += leaves & (s_border <= s_out)
            np.copyto(s, s_out, where=leaves)
        over = ~(s < state[_S_END]) | (start >= limit).any(axis=0)
        self._finish(ids, state, np.flatnonzero(over & is_visible))
        state[_S_END, over] = np.nan
        s[over] = np.nan
        return state, slot

    def _step(self) -> None:
        """Test every ray against its cell, then skip the cell, look into it, or descend."""
        count = self.id.shape[0]
        border, s_border = self.scratch[0:2, :count], self.scratch[2:4, :count]
        s_out = self.scratch[4, :count]
        is_clear, is_leaf, flag = self.masks[0:3, :count]
        moves = self.masks[3:5, :count]
        # Find where the ray leaves the cell
        np.add(self.state[_CELL], 1.0, out=border)
        np.multiply(border, self.state[_SIZE], out=border)
        np.subtract(border, self.state[_START], out=s_border)
        np.multiply(s_border, self.state[_INVERSE], out=s_border)
        np.minimum(s_border[0], s_border[1], out=s_out)
        np.minimum(s_out, self.state[_S_END], out=s_out)
        self._test_bounds(s_out, is_clear, flag)
        # At level 0 look into the slab itself
        np.equal(self.state[_SIZE], 1.0, out=is_leaf)
        np.greater(is_leaf, is_clear, out=flag)
        leaf = np.flatnonzero(flag)
        if leaf.size:
            self._retire(self._meet_slabs(leaf, s_out.take(leaf)), s_out)
        # Leave the cell where nothing was met, else descend
        is_leaving = np.logical_or(is_clear, is_leaf, out=is_clear)
        np.greater_equal(s_out, self.state[_S_END], out=flag)
        np.logical_and(flag, is_leaving, out=flag)
        over = np.flatnonzero(flag)
        if over.size:
            self._finish(self.id, self.state, over)
            self._retire(over, s_out)
        np.less_equal(s_border, s_out, out=moves)
        np.logical_and(moves, is_leaving, out=moves)
        self._move(is_leaving, moves, border)
        # s = s_out for those that leave: s never falls, so the larger one is it
        np.multiply(s_out, is_leaving, out=s_out)
        np.maximum(self.state[_S], s_out, out=self.state[_S])

    def _test_bounds(self, s_out: FloatArray, is_clear: BoolArray, is_behind: BoolArray) -> None:
        """Set `is_clear` where the ray passes its cell wholly in front of or wholly behind."""
        stack, count = self.stack, self.id.shape[0]
        numbers, bound = self.numbers[:count], self.scratch[8, :count]
        q_in, q_out, term = self.scratch[5:8, :count]
        index, base = self.indices[:, :count]
        column, row = self.state[_CELL]
        sign_x, sign_y = self.state[_SIGN]
        np.multiply(row, float(stack.stride), out=numbers)
        np.multiply(numbers, sign_y, out=numbers)
        np.multiply(column, sign_x, out=term)
        np.add(numbers, term, out=numbers)
        np.copyto(index, numbers, casting="unsafe")
        np.take(self.base_of_slot, self.slot, out=base, mode="clip")
        np.add(index, base, out=index)
        for s, q in ((self.state[_S], q_in), (s_out, q_out)):
            np.multiply(self.state[_VQ], s, out=q)
            np.add(q, self.state[_Q0], out=q)
        np.minimum(q_in, q_out, out=term)
        np.take(stack.atlas_nearest, index, out=bound, mode="clip")
        np.greater(term, bound, out=is_clear)
        np.maximum(q_in, q_out, out=term)
        np.take(stack.atlas_farthest, index, out=bound, mode="clip")
        np.less(term, bound, out=is_behind)
        np.logical_or(is_clear, is_behind, out=is_clear)

    def _move(self, is_leaving: BoolArray, moves: BoolArray, border: FloatArray) -> None:
        """Step leaving rays into the next cell, one level up where its parent is new; let the others descend.

        `border` holds the borders ahead and is used up. A cell's number at another level is its number times
        the ratio of the sizes; on the way down the child is the one that holds the ray at its current s.
        """
        count = self.id.shape[0]
        size, cell = self.state[_SIZE], self.state[_CELL]
        ratio, whole = self.scratch[5, :count], self.scratch[6:8, :count]
        rises, is_descending = self.masks[1:3, :count]
        is_beyond, is_even = self.masks[5:7, :count], self.masks[6:8, :count]
        np.logical_not(is_leaving, out=is_descending)
        # On the way down: beyond the middle once the ray has crossed it
        np.multiply(size, 0.5, out=ratio)
        np.subtract(border, ratio, out=border)
        np.subtract(border, self.state[_START], out=border)
        np.multiply(border, self.state[_INVERSE], out=border)
        np.add(cell, moves, out=cell)
        np.multiply(cell, 0.5, out=whole)
        # On the way out: a new even cell has a new parent
        np.equal(whole, np.floor(whole), out=is_even)
        np.logical_and(is_even, moves, out=is_even)
        np.logical_or(is_even[0], is_even[1], out=rises)
        np.less(size, self.top_size, out=is_even[0])
        np.logical_and(rises, is_even[0], out=rises)
        np.greater_equal(self.state[_S], border, out=is_beyond)
        np.logical_and(is_beyond, is_descending, out=is_beyond)
        np.add(self.slot, rises, out=self.slot)
        np.subtract(self.slot, is_descending, out=self.slot)
        np.copyto(ratio, size)
        np.take(self.size_of_slot, self.slot, out=size, mode="clip")
        np.divide(ratio, size, out=ratio)
        np.multiply(cell, ratio, out=cell)
        np.add(cell, is_beyond, out=cell)
        np.floor(cell, out=cell)

    def _meet_slabs(self, leaf: IntArray, s_out: FloatArray) -> IntArray:
        """Test rays against their level-0 cell; write hits and blocks, return the rays that stopped."""
        stack, state = self.stack, self.state[_MEETING].take(leaf, axis=1)
        offset = state[_START] - (state[_CELL] + 0.5)
        s_in = state[_S]
        pixel = self._pixel(state[_CELL], state[_SIGN], self.id.take(leaf))
        gx = stack.gradient_x.take(pixel) * state[_SIGN][0]
        gy = stack.gradient_y.take(pixel) * state[_SIGN][1]
        # h(s) = h0 + s * dh: how far in front of the patch's plane the ray is, in q
        h0 = state[_Q0] - stack.front.take(pixel) - gx * offset[0] - gy * offset[1]
        dh = state[_VQ] - gx * state[_SPEED][0] - gy * state[_SPEED][1]
        h_in, h_out = h0 + dh * s_in, h0 + dh * s_out
        behind = -stack.slab.take(pixel)
        # From outside through the front, already inside, or from behind through the back
        meets = np.where(h_in > 0.0, h_out <= 0.0, (h_in >= behind) | (h_out >= behind))
        met = np.flatnonzero(meets)
        if met.size == 0:
            return met
        ray, pixel = leaf.take(met), pixel.take(met)
        h_in, dh, s_in = h_in.take(met), dh.take(met), s_in.take(met)
        faces = self._facing(pixel, self.id.take(ray)) < 0.0
        crosses = h_in > 0.0
        # The step between two pixels of one surface is part of its front
        reach = stack.reach.take(pixel)
        if self.starts_on_surface:
            away = self._cells_from_origin(state.take(met, axis=1))
            reach += np.where(away <= 1.0, self._rise_in_own_cell(ray), 0.0)
        is_hit = faces & (crosses | ((h_in >= behind.take(met)) & (h_in >= -reach)))
        s_met = np.where(crosses, s_in - h_in / dh, s_in)
        if self.starts_on_surface:
            stops = np.flatnonzero(faces | (away > _SELF_CONTACT_PX))
            ray, s_met = ray.take(stops), s_met.take(stops)
            is_hit, pixel = is_hit.take(stops), pixel.take(stops)
        ids = self.id.take(ray)
        self.result.status[ids] = np.where(is_hit, HIT, BLOCKED)
        self.result.pixel[ids] = pixel
        self.result.distance[ids] = self._distance(self.state, ray, s_met)
        return ray

    def _pixel(self, cell: FloatArray, sign: FloatArray, ids: IntArray) -> IntArray:
        """Return flat pixel indices of mirrored level-0 cells ``(2, N)``.

        Rounding at the border stays in the frame.
        """
        stack = self.stack
        x, y = np.where(sign < 0.0, self.padded - 1.0 - cell, cell).astype(np.int64)
        pixel: IntArray = np.minimum(np.maximum(y, 0), stack.height - 1) * stack.width
        pixel += np.minimum(np.maximum(x, 0), stack.width - 1)
        if len(stack.fields) > 1:
            pixel += self.rays.field.take(ids) * stack.pixels_per_field
        return pixel

    def _facing(self, pixel: IntArray, ids: IntArray) -> FloatArray:
        """Return n . D: negative where the ray comes toward the surface's front."""
        normal = self.stack.normal.take(pixel, axis=0)
        dx, dy, dz = (component.take(ids) for component in self.direction_vs)
        cosine: FloatArray = normal[:, 0] * dx + normal[:, 1] * dy + normal[:, 2] * dz
        return cosine

    @staticmethod
    def _cells_from_origin(state: FloatArray) -> FloatArray:
        away = np.abs(state[_CELL] - np.floor(state[_START]))
        farthest: FloatArray = np.maximum(away[0], away[1])
        return farthest

    def _rise_in_own_cell(self, ray: IntArray) -> FloatArray:
        """Return how far the origin's own patch may have carried a ray in q before its cell ended.

        Where two surfaces meet within a pixel, the ray met the second one inside its own cell, untested.
        """
        start, sign = self.state[_START].take(ray, axis=1), self.state[_SIGN].take(ray, axis=1)
        home = self._pixel(np.floor(start), sign, self.id.take(ray))
        tilt: FloatArray = np.abs(self.stack.gradient_x.take(home)) + np.abs(self.stack.gradient_y.take(home))
        return 0.5 * tilt

    def _distance(self, state: FloatArray, ray: IntArray, s: FloatArray) -> FloatArray:
        """Convert s back to distance: t = s / q(s), orthographic t = s."""
        if self.stack.is_orthographic:
            return s
        distance: FloatArray = s / (state[_Q0].take(ray) + state[_VQ].take(ray) * s)
        return distance

    def _finish(self, ids: IntArray, state: FloatArray, over: IntArray) -> None:
        """Let rays that end at their vanishing point over background escape; all others stay UNKNOWN."""
        s_end = state[_S_END].take(over)
        vanishes = s_end == self.rays.s_vanish.take(ids.take(over))
        left = np.flatnonzero(~vanishes)
        distance = self._distance(state, over.take(left), s_end.take(left))
        self.result.distance[ids.take(over.take(left))] = distance
        over = over[vanishes]
        last = state.take(over, axis=1)
        pixel = self._pixel(np.floor(last[_START] + last[_SPEED] * last[_S_END]), last[_SIGN], ids.take(over))
        self.result.status[ids.take(over[self.stack.is_background.take(pixel)])] = ESCAPED

    def _retire(self, ended: IntArray, s: FloatArray) -> None:
        """Let rays that have ended stand still: `s` is where they go next."""
        s[ended] = np.nan
        self.state[_S_END, ended] = np.nan
        self.ended += ended.shape[0]
