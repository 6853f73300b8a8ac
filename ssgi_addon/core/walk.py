# SPDX-License-Identifier: GPL-3.0-or-later
"""The walk of many rays through the pyramid at once; `tracer` says what it must find."""

from __future__ import annotations

import numpy as np

from .depth_field import DepthField
from .screen_rays import BLOCKED, ESCAPED, HIT, ScreenRays, TraceResult
from .types import BoolArray, FloatArray, IntArray

# Finished rays are dropped from the arrays once they are this fraction: a compaction costs about a third of a step.
_COMPACT_FRACTION = 0.125
_SELF_CONTACT_PX = 2
# A ray straight at the camera never leaves its cell: any finite end does, and keeps 0 * inf out.
_STRAIGHT_AT_CAMERA = 1e30

# Rows of the state: start, velocity, 1 / velocity, s on entry into the cell, s at the end, the cell and its size.
_X0, _Y0, _Q0, _VX, _VY, _VQ, _IVX, _IVY, _S, _S_END, _COLUMN, _ROW, _SIZE = range(13)


class Walk:
    """The walk of one group of rays whose velocities share their signs.

    Coordinates are mirrored so that every ray moves toward +x and +y, which leaves one rule for cell
    borders and makes the walk exactly symmetric under flips of the image. A ray keeps the cell of its current
    level; which of its four children it is in is decided on the way down, by the same border crossings that
    a linear walk compares, so all walks visit the same level-0 cells. A ray that has ended carries NaN until
    the next compaction: every comparison with it is False, so it neither moves nor meets anything.

    The step blends by arithmetic, not by masks: a masked copy costs as much as thirty additions.

    Parameters
    ----------
    field
        What the rays walk through.
    rays, direction_vs
        All rays, and their view-space directions (3, N).
    members : (M,)
        Which of them make this group.
    octant
        Bits 0, 1, 2: velocity in x, y, q is negative.
    starts_on_surface
        The rays leave the surface in their first cell.
    result
        Receives the answers of the group's rays.
    """

    def __init__(
        self,
        field: DepthField,
        rays: ScreenRays,
        direction_vs: FloatArray,
        members: IntArray,
        octant: int,
        starts_on_surface: bool,
        result: TraceResult,
    ) -> None:
        self.field, self.rays, self.result, self.direction_vs = field, rays, result, direction_vs
        self.flip_x, self.flip_y = bool(octant & 1), bool(octant & 2)
        self.is_receding = bool(octant & 4)  # q falls along the ray
        self.starts_on_surface = starts_on_surface
        # Atlas index of the mirrored cell (0, 0) of each level
        level = np.arange(field.levels, dtype=np.int64)
        self.base = field.origins.copy()
        if self.flip_x:
            self.base += (field.padded_width >> level) - 1
        if self.flip_y:
            self.base += ((field.padded_height >> level) - 1) * field.stride
        count, dtype = members.shape[0], rays.s_begin.dtype
        self.size_of_level = (1 << level).astype(dtype)
        self.id = members
        self.level = np.zeros(count, dtype=np.int64)
        self.state = np.empty((13, count), dtype=dtype)
        self.scratch = np.empty((9, count), dtype=dtype)
        self.masks = np.empty((8, count), dtype=np.bool_)
        self.cells = np.empty((2, count), dtype=np.int64)
        # Cell numbers are exact in a float32 up to its mantissa
        is_small = field.atlas_nearest.shape[0] < 2**24
        self.numbers = self.scratch[8] if is_small else np.empty(count, dtype=np.float64)
        self.ended = 0
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            self._place()

    def _place(self) -> None:
        """Set the start of every ray, and step out of the origin's own cell."""
        field, rays, ids, state = self.field, self.rays, self.id, self.state
        for row, component in zip(range(6), (*rays.start, *rays.velocity), strict=True):
            component.take(ids, out=state[row], mode="clip")
        x0, y0, _, vx, vy, _, ivx, ivy, s, s_end, column, row, size = state
        if self.flip_x:
            np.subtract(field.padded_width, x0, out=x0)
        if self.flip_y:
            np.subtract(field.padded_height, y0, out=y0)
        np.abs(state[_VX : _VY + 1], out=state[_VX : _VY + 1])
        np.divide(1.0, state[_VX : _VY + 1], out=state[_IVX : _IVY + 1])
        rays.s_begin.take(ids, out=s, mode="clip")
        # The frame's border, by the expression that the walk uses for cell borders
        limit_x = field.padded_width if self.flip_x else field.camera.width
        limit_y = field.padded_height if self.flip_y else field.camera.height
        s_exit = np.fmin(np.fmin((limit_x - x0) * ivx, (limit_y - y0) * ivy), _STRAIGHT_AT_CAMERA)
        s_end[:] = np.minimum(np.minimum(rays.s_vanish.take(ids), rays.s_limit.take(ids)), s_exit)
        # Rays from outside begin in a border cell
        leaves_cell = s == 0.0 if self.starts_on_surface else np.zeros(s.shape, dtype=np.bool_)
        column[:] = np.clip(np.floor(x0 + vx * s), 0, field.padded_width - 1)
        row[:] = np.clip(np.floor(y0 + vy * s), 0, field.padded_height - 1)
        s_x, s_y = (column + 1.0 - x0) * ivx, (row + 1.0 - y0) * ivy
        s_out = np.minimum(np.minimum(s_x, s_y), s_end)
        column += leaves_cell & (s_x <= s_out)
        row += leaves_cell & (s_y <= s_out)
        is_visible = s < s_end
        np.copyto(s, s_out, where=leaves_cell)
        size.fill(1.0)
        over = ~(s < s_end)
        self._finish(np.flatnonzero(over & is_visible))
        self._retire(np.flatnonzero(over), s)
        self._compact()

    def run(self, max_steps: int) -> None:
        """Walk all rays to their ends and write the results."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(max_steps):
                if self.id.shape[0] == 0:
                    return
                self._step()
                if self.ended > _COMPACT_FRACTION * self.id.shape[0]:
                    self._compact()

    def _step(self) -> None:
        """Test every ray against its cell, then skip the cell, look into it, or descend."""
        count = self.id.shape[0]
        to_x, to_y, s_x, s_y, s_out = self.scratch[:5, :count]
        is_clear, is_leaf, flag, moves_x, moves_y = self.masks[:5, :count]
        # Find where the ray leaves the cell
        for cell, start, inverse, border, s_border in ((_COLUMN, _X0, _IVX, to_x, s_x), (_ROW, _Y0, _IVY, to_y, s_y)):
            np.add(self.state[cell], 1.0, out=border)
            np.multiply(border, self.state[_SIZE], out=border)
            np.subtract(border, self.state[start], out=s_border)
            np.multiply(s_border, self.state[inverse], out=s_border)
        np.minimum(s_x, s_y, out=s_out)
        np.minimum(s_out, self.state[_S_END], out=s_out)
        self._test_bounds(s_out, is_clear, flag)
        # At level 0 look into the slab itself
        np.equal(self.level, 0, out=is_leaf)
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
            self._finish(over)
            self._retire(over, s_out)
        for s_border, moves in ((s_x, moves_x), (s_y, moves_y)):
            np.less_equal(s_border, s_out, out=moves)
            np.logical_and(moves, is_leaving, out=moves)
        self._move(is_leaving, (moves_x, moves_y), (to_x, to_y))
        # s = s_out for those that leave: s never falls, so the larger one is it
        np.multiply(s_out, is_leaving, out=s_out)
        np.maximum(self.state[_S], s_out, out=self.state[_S])

    def _test_bounds(self, s_out: FloatArray, is_clear: BoolArray, is_behind: BoolArray) -> None:
        """Set `is_clear` where the ray passes its cell wholly in front of or wholly behind."""
        field, count = self.field, self.id.shape[0]
        numbers, bound = self.numbers[:count], self.scratch[8, :count]
        q_in, q_out = self.scratch[5:7, :count]
        cell, base = self.cells[:, :count]
        np.multiply(self.state[_ROW], float(-field.stride if self.flip_y else field.stride), out=numbers)
        (np.subtract if self.flip_x else np.add)(numbers, self.state[_COLUMN], out=numbers)
        np.copyto(cell, numbers, casting="unsafe")
        np.take(self.base, self.level, out=base, mode="clip")
        np.add(cell, base, out=cell)
        for s, q in ((self.state[_S], q_in), (s_out, q_out)):
            np.multiply(self.state[_VQ], s, out=q)
            np.add(q, self.state[_Q0], out=q)
        q_low, q_high = (q_out, q_in) if self.is_receding else (q_in, q_out)
        np.take(field.atlas_nearest, cell, out=bound, mode="clip")
        np.greater(q_low, bound, out=is_clear)
        np.take(field.atlas_farthest, cell, out=bound, mode="clip")
        np.less(q_high, bound, out=is_behind)
        np.logical_or(is_clear, is_behind, out=is_clear)

    def _move(
        self, is_leaving: BoolArray, moves: tuple[BoolArray, BoolArray], to: tuple[FloatArray, FloatArray]
    ) -> None:
        """Step leaving rays into the next cell, one level up where its parent is new; let the others descend.

        `to` holds the borders ahead and is used up. A cell's number at another level is its number times the
        ratio of the sizes; on the way down the child is the one that holds the ray at its current s.
        """
        count = self.id.shape[0]
        half, whole = self.scratch[5:7, :count]
        rises, flag = self.masks[1:3, :count]
        beyond = self.masks[5:7, :count]
        is_descending = self.masks[7, :count]
        np.logical_not(is_leaving, out=is_descending)
        np.multiply(self.state[_SIZE], 0.5, out=half)
        rises.fill(False)
        for axis, (cell, start, inverse) in enumerate(((_COLUMN, _X0, _IVX), (_ROW, _Y0, _IVY))):
            middle, number = to[axis], self.state[cell]
            np.subtract(middle, half, out=middle)
            np.subtract(middle, self.state[start], out=middle)
            np.multiply(middle, self.state[inverse], out=middle)
            np.greater_equal(self.state[_S], middle, out=beyond[axis])
            np.logical_and(beyond[axis], is_descending, out=beyond[axis])
            # A new even cell has a new parent
            np.add(number, moves[axis], out=number)
            np.multiply(number, 0.5, out=middle)
            np.floor(middle, out=whole)
            np.equal(middle, whole, out=flag)
            np.logical_and(flag, moves[axis], out=flag)
            np.logical_or(rises, flag, out=rises)
        np.less(self.level, self.field.levels - 1, out=flag)
        np.logical_and(rises, flag, out=rises)
        np.add(self.level, rises, out=self.level)
        np.subtract(self.level, is_descending, out=self.level)
        ratio, size = half, self.state[_SIZE]
        np.copyto(ratio, size)
        np.take(self.size_of_level, self.level, out=size, mode="clip")
        np.divide(ratio, size, out=ratio)
        for axis, cell in enumerate((_COLUMN, _ROW)):
            number = self.state[cell]
            np.multiply(number, ratio, out=number)
            np.add(number, beyond[axis], out=number)
            np.floor(number, out=number)

    def _meet_slabs(self, leaf: IntArray, s_out: FloatArray) -> IntArray:
        """Test rays against their level-0 cell; write hits and blocks, return the rays that stopped."""
        field = self.field
        x0, y0, q0, vx, vy, vq, _, _, s_in, _, column, row, _ = self.state.take(leaf, axis=1)
        pixel = self._pixel(column, row)
        gx, gy = field.gradient_x.take(pixel), field.gradient_y.take(pixel)
        if self.flip_x:
            np.negative(gx, out=gx)
        if self.flip_y:
            np.negative(gy, out=gy)
        # h(s) = h0 + s * dh: how far in front of the patch's plane the ray is, in q
        h0 = q0 - field.front.take(pixel) - gx * (x0 - (column + 0.5)) - gy * (y0 - (row + 0.5))
        dh = vq - gx * vx - gy * vy
        h_in, h_out = h0 + dh * s_in, h0 + dh * s_out
        behind = -field.slab.take(pixel)
        # From outside through the front, already inside, or from behind through the back
        meets = np.where(h_in > 0.0, h_out <= 0.0, (h_in >= behind) | (h_out >= behind))
        meets &= ~field.is_background.take(pixel)
        met = np.flatnonzero(meets)
        if met.size == 0:
            return met
        ray, pixel = leaf.take(met), pixel.take(met)
        h_in, dh, s_in = h_in.take(met), dh.take(met), s_in.take(met)
        faces = self._facing(pixel, self.id.take(ray)) < 0.0
        crosses = h_in > 0.0
        # The step between two pixels of one surface is part of its front
        is_hit = faces & (crosses | ((h_in >= behind.take(met)) & (h_in >= -field.reach.take(pixel))))
        s_met = np.where(crosses, s_in - h_in / dh, s_in)
        stops = np.flatnonzero(faces | ~self._near_origin(ray)) if self.starts_on_surface else np.arange(ray.shape[0])
        ray, s_met = ray.take(stops), s_met.take(stops)
        ids = self.id.take(ray)
        self.result.status[ids] = np.where(is_hit.take(stops), HIT, BLOCKED)
        self.result.pixel[ids] = pixel.take(stops)
        self.result.distance[ids] = self._distance(ray, s_met)
        return ray

    def _pixel(self, column: FloatArray, row: FloatArray) -> IntArray:
        """Return flat pixel indices of mirrored level-0 cells; rounding at the border stays in the frame."""
        field = self.field
        x, y = column.astype(np.int64), row.astype(np.int64)
        if self.flip_x:
            x = field.padded_width - 1 - x
        if self.flip_y:
            y = field.padded_height - 1 - y
        width, height = field.camera.width, field.camera.height
        return np.minimum(np.maximum(y, 0), height - 1) * width + np.minimum(np.maximum(x, 0), width - 1)

    def _facing(self, pixel: IntArray, ids: IntArray) -> FloatArray:
        """Return n . D: negative where the ray comes toward the surface's front."""
        normal = self.field.normal.take(pixel, axis=0)
        dx, dy, dz = (component.take(ids) for component in self.direction_vs)
        return normal[:, 0] * dx + normal[:, 1] * dy + normal[:, 2] * dz

    def _near_origin(self, ray: IntArray) -> BoolArray:
        away_x = np.abs(self.state[_COLUMN].take(ray) - np.floor(self.state[_X0].take(ray)))
        away_y = np.abs(self.state[_ROW].take(ray) - np.floor(self.state[_Y0].take(ray)))
        return np.maximum(away_x, away_y) <= _SELF_CONTACT_PX

    def _distance(self, ray: IntArray, s: FloatArray) -> FloatArray:
        """Convert s back to distance: t = s / q(s), orthographic t = s."""
        if self.field.camera.is_orthographic:
            return s
        return s / (self.state[_Q0].take(ray) + self.state[_VQ].take(ray) * s)

    def _finish(self, over: IntArray) -> None:
        """Rays that end at their vanishing point escape if they are over background; all others stay UNKNOWN."""
        s_end = self.state[_S_END].take(over)
        vanishes = s_end == self.rays.s_vanish.take(self.id.take(over))
        left = np.flatnonzero(~vanishes)
        self.result.distance[self.id.take(over.take(left))] = self._distance(over.take(left), s_end.take(left))
        over = over[vanishes]
        x0, y0, _, vx, vy, _, _, _, _, s, _, _, _ = self.state.take(over, axis=1)
        pixel = self._pixel(np.floor(x0 + vx * s), np.floor(y0 + vy * s))
        escapes = over[self.field.is_background.take(pixel)]
        self.result.status[self.id.take(escapes)] = ESCAPED

    def _retire(self, ended: IntArray, s: FloatArray) -> None:
        """Let rays that have ended stand still: `s` is where they go next."""
        s[ended] = np.nan
        self.state[_S_END, ended] = np.nan
        self.ended += ended.shape[0]

    def _compact(self) -> None:
        """Drop the rays that have ended."""
        kept = np.flatnonzero(self.state[_S_END] == self.state[_S_END])
        if kept.shape[0] < self.id.shape[0]:
            self.state = self.state.take(kept, axis=1)
            self.id, self.level = self.id.take(kept), self.level.take(kept)
        self.ended = 0
