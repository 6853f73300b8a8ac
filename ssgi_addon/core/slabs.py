# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of a walk, and what its rays meet at level 0."""

from __future__ import annotations

import numpy as np

from .field_stack import FieldStack
from .screen_rays import BLOCKED, HIT, TraceResult
from .types import BoolArray, FloatArray, IntArray

SELF_CONTACT_PX = 2
# A ray that enters a slab from inside goes out of sight at this part of the distance.
JUST_BEFORE = 1.0 - 1e-3

# Rows of the state; x and y stand together, so that one call serves both. Mirrored coordinates throughout.
START = slice(0, 2)
Q0 = 2
SPEED = slice(3, 5)
VQ = 5
SIGN = slice(6, 8)  # -1 where the axis is mirrored
CELL = slice(8, 10)  # column and row at the current level
S = 10  # on entry into the cell
IN_SIGHT = 11  # 1 until the ray passes behind something, then 0
MEETING = slice(0, 12)  # all that the look into a slab needs
INVERSE = slice(12, 14)  # 1 / speed
SIZE = 14  # of the cell, pixels
S_END = 15
S_VANISH = 16
ROWS = 17


class SlabTest:
    """The exact test of rays against the slab of one level-0 cell each.

    Parameters
    ----------
    stack
        The fields.
    direction_vs : (3, N)
        View-space directions of all rays.
    starts_on_surface
        The rays leave the surface in their first cell.
    notes_hidden
        Note where rays go out of sight.
    result
        Receives hits and blocks.
    """

    def __init__(
        self,
        stack: FieldStack,
        direction_vs: FloatArray,
        starts_on_surface: bool,
        notes_hidden: bool,
        result: TraceResult,
    ) -> None:
        self.stack, self.direction_vs, self.result = stack, direction_vs, result
        self.starts_on_surface, self.notes_hidden = starts_on_surface, notes_hidden
        # Hits that lie deeper than an edge allows: numbers, fields, pixels and states
        self.deep: list[tuple[IntArray, IntArray, IntArray, FloatArray]] = []
        self.last = np.array([[stack.padded_width], [stack.padded_height]], dtype=direction_vs.dtype) - 1.0

    def meet(self, state: FloatArray, ids: IntArray, field: IntArray, s_out: FloatArray) -> IntArray:
        """Write what rays meet in their level-0 cells before `s_out`; return those that stopped.

        Parameters
        ----------
        state : (rows of MEETING, N)
            Of the rays; those that go out of sight here lose their mark.
        ids, field, s_out : (N,)
            Numbers of the rays, the fields that they walk, and where they leave their cells.
        """
        s_in = state[S]
        pixel, h0, dh, slab = self.heights(state, field)
        h_in, h_out = h0 + dh * s_in, h0 + dh * s_out
        # Neither in front all the way nor behind all the way: through the front, inside, or through the back
        reaches_slab = np.maximum(h_in, h_out) >= -slab
        if self.notes_hidden:
            self._note_hidden(np.flatnonzero((state[IN_SIGHT] > 0.0) & ~reaches_slab), state, ids)
        met = np.flatnonzero((np.minimum(h_in, h_out) <= 0.0) & reaches_slab)
        if met.size == 0:
            return met
        state, h_in, s_in = state.take(met, axis=1), h_in.take(met), s_in.take(met)
        s_met = np.where(h_in > 0.0, s_in - h_in / dh.take(met), s_in)
        ids, field, pixel = ids.take(met), field.take(met), pixel.take(met)
        return met[self.judge(state, ids, field, pixel, h_in, slab.take(met), s_met)]

    def _note_hidden(self, passes: IntArray, state: FloatArray, ids: IntArray) -> None:
        """Note where rays go out of sight that pass their cells behind the slab."""
        state[IN_SIGHT, passes] = 0.0
        last = state.take(passes, axis=1)
        self.result.hidden[ids.take(passes)] = self.distance(last, last[S])

    def heights(
        self, state: FloatArray, field: IntArray
    ) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Return the pixel of each ray's cell, h0 and dh of h(s) = h0 + s * dh, and the slab's extent.

        h is how far in front of the patch's plane the ray is, in q.
        """
        offset = state[START] - (state[CELL] + 0.5)
        pixel = self.pixel(state[CELL], state[SIGN], field)
        front, gx, gy, slab = self.stack.planes.take(pixel, axis=0).T
        gx, gy = gx * state[SIGN][0], gy * state[SIGN][1]
        h0 = state[Q0] - front - gx * offset[0] - gy * offset[1]
        dh = state[VQ] - gx * state[SPEED][0] - gy * state[SPEED][1]
        return pixel, h0, dh, slab

    def judge(
        self,
        state: FloatArray,
        ids: IntArray,
        field: IntArray,
        pixel: IntArray,
        h_in: FloatArray,
        slab: FloatArray,
        s_met: FloatArray,
    ) -> BoolArray:
        """Write what rays meet that come into a slab from height `h_in`; return which of them stop.

        Hits on entry are hits unless `settle` finds that they lie at an edge.

        Parameters
        ----------
        state : (rows of MEETING, N)
            Of the rays, in the cell of the slab.
        ids, field, pixel, h_in, slab, s_met : (N,)
            Numbers of the rays, their fields, the slabs' pixels, the heights above their fronts that the rays
            come from, the slabs' extents, and where the rays meet them.
        """
        faces = self._facing(pixel, ids) < 0.0
        # The step between two pixels of one surface is part of its front; beyond its edge there is no step
        reach, over_edge = self.stack.reach.take(pixel), self.stack.footprint.take(pixel)
        stops = np.ones(ids.shape, dtype=np.bool_)
        if self.starts_on_surface:
            away = _cells_from_origin(state)
            rise = (away <= 1.0) * self._rise_in_own_cell(state, field)
            reach += rise
            over_edge += rise
            stops = faces | (away > SELF_CONTACT_PX)
        is_hit = faces & (h_in >= -np.minimum(slab, reach))
        self._write(np.flatnonzero(stops), is_hit, ids, pixel, s_met, state)
        if self.notes_hidden:
            # Within a slab, or behind it, nothing is in sight any more: just before, it was
            inside = ids.take(np.flatnonzero(stops & (h_in <= 0.0)))
            last = self.result.distance.take(inside) * JUST_BEFORE
            self.result.hidden[inside] = np.minimum(self.result.hidden.take(inside), last)
        deep = np.flatnonzero(is_hit & (h_in < -over_edge))
        if deep.size:
            self.deep.append((ids.take(deep), field.take(deep), pixel.take(deep), state.take(deep, axis=1)))
        return stops

    def settle(self) -> None:
        """Block the rays that came in too deep at an edge: all at once, since at each step they are few."""
        if self.deep:
            ids, field, pixel, state = (np.concatenate(parts, axis=-1) for parts in zip(*self.deep))
            self.result.status[ids[self._comes_over_edge(state, field, pixel)]] = BLOCKED
            self.deep.clear()

    def _write(
        self,
        stops: IntArray,
        is_hit: BoolArray,
        ids: IntArray,
        pixel: IntArray,
        s_met: FloatArray,
        state: FloatArray,
    ) -> None:
        result, state = self.result, state.take(stops, axis=1)
        ids, s_met = ids.take(stops), s_met.take(stops)
        result.status[ids] = BLOCKED + (HIT - BLOCKED) * is_hit.take(stops)
        result.pixel[ids] = pixel.take(stops)
        result.distance[ids] = self.distance(state, s_met)
        x, y = self._unmirrored(state[START] + state[SPEED] * s_met, state[SIGN], self.last + 1.0)
        result.x_px[ids], result.y_px[ids] = x, y

    @staticmethod
    def _unmirrored(position: FloatArray, sign: FloatArray, end: FloatArray) -> FloatArray:
        """Return mirrored positions or cells as they stand in the image; a mirrored 0 stands at `end`."""
        unmirrored: FloatArray = (sign < 0.0) * end + sign * position
        return unmirrored

    def pixel(self, cell: FloatArray, sign: FloatArray, field: IntArray) -> IntArray:
        """Return flat pixel indices of mirrored level-0 cells ``(2, N)``.

        Rounding at the border stays in the frame.
        """
        stack = self.stack
        x, y = self._unmirrored(cell, sign, self.last).astype(np.int64)
        pixel: IntArray = np.minimum(np.maximum(y, 0), stack.height - 1) * stack.width
        pixel += np.minimum(np.maximum(x, 0), stack.width - 1)
        if len(stack.fields) > 1:
            pixel += field * stack.pixels_per_field
        return pixel

    def _facing(self, pixel: IntArray, ids: IntArray) -> FloatArray:
        """Return n . D: negative where the ray comes toward the surface's front."""
        nx, ny, nz = self.stack.normal.take(pixel, axis=0).T
        dx, dy, dz = (component.take(ids) for component in self.direction_vs)
        cosine: FloatArray = nx * dx + ny * dy + nz * dz
        return cosine

    def _comes_over_edge(self, state: FloatArray, field: IntArray, pixel: IntArray) -> BoolArray:
        """Return which rays come into their slabs at an edge: what lies before it on their way is far behind.

        There the ray does not meet the front between two pixels, but a side that the camera does not see.
        """
        before = state[CELL] - state[START]
        # The border that was crossed last has the larger before / speed; a ray through a corner crosses two
        s_x, s_y = before * state[SPEED][::-1]
        is_crossed = np.stack([s_x >= s_y, s_y >= s_x]) & (before > 0.0)
        beside = self.pixel(state[CELL] - is_crossed, state[SIGN], field)
        right, down = is_crossed * (0.5 * state[SIGN])
        here, there = self.stack.planes.take(pixel, axis=0).T, self.stack.planes.take(beside, axis=0).T
        fall = here[0] - here[1] * right - here[2] * down - (there[0] + there[1] * right + there[2] * down)
        comes_over: BoolArray = (fall > self.stack.largest_step.take(pixel)) & (beside != pixel)
        return comes_over

    def _rise_in_own_cell(self, state: FloatArray, field: IntArray) -> FloatArray:
        """Return how far the origin's own patch may have carried a ray in q before its cell ended.

        Where two surfaces meet within a pixel, the ray met the second one inside its own cell, untested.
        """
        home = self.pixel(np.floor(state[START]), state[SIGN], field)
        _, gx, gy, _ = self.stack.planes.take(home, axis=0).T
        rise: FloatArray = 0.5 * (np.abs(gx) + np.abs(gy))
        return rise

    def distance(self, state: FloatArray, s: FloatArray) -> FloatArray:
        """Convert s back to distance: t = s / q(s), orthographic t = s."""
        if self.stack.is_orthographic:
            return s
        q = state[Q0] + state[VQ] * s
        # At the vanishing point rounding may leave less than nothing of q
        distance: FloatArray = np.divide(s, q, out=np.full_like(q, np.inf), where=q > 0.0)
        return distance


def _cells_from_origin(state: FloatArray) -> FloatArray:
    away = np.abs(state[CELL] - np.floor(state[START]))
    farthest: FloatArray = np.maximum(away[0], away[1])
    return farthest
