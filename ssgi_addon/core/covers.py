# SPDX-License-Identifier: GPL-3.0-or-later
"""What patches cover of a side of a slice: single sectors, or all below a horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arcs import SECTORS, Receivers, SliceSide
from .types import BoolArray, FloatArray

# Fronts that face away so near are the surface's own roughness, as in `slabs`.
_SELF_CONTACT_PX = 2
_ALL = np.uint32(0xFFFFFFFF)

Words = NDArray[np.uint32]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Read:
    """A pixel that stands for a part of a line on the screen.

    Attributes
    ----------
    number
        Its place along the line, from 0.
    right, down
        Offset of the pixel from the receiver, pixels.
    begin, middle, end
        The part of the line, pixels from the receiver.
    ux, uy
        Unit direction of the line, y down.
    """

    number: int
    right: int
    down: int
    begin: float
    middle: float
    end: float
    ux: float
    uy: float

    @property
    def is_near(self) -> bool:
        """True beside the receiver, where a surface's own roughness may face away."""
        return max(abs(self.right), abs(self.down)) <= _SELF_CONTACT_PX


class Scratch:
    """Arrays that tasks use again and again, for up to `size` pixels.

    Attributes
    ----------
    planes : (4, N)
        Of the pixels that were read last, as in `DepthField`.
    """

    def __init__(self, size: int, dtype: np.dtype) -> None:
        self._floats, self._words = np.empty(24 * size, dtype), np.empty(4 * size, np.uint32)
        self.resize(size)

    def resize(self, size: int) -> None:
        """Let all arrays hold `size` pixels."""
        floats = self._floats[: 24 * size].reshape(24, size)
        self.planes, self.ends, self.bounds, self.borders = (
            floats[:4],
            floats[4:7],
            floats[7:11],
            floats[11:15],
        )
        self.lines = (floats[15:18], floats[18:21])
        self.spare = floats[21:24]
        self.words = self._words[: 4 * size].reshape(4, size)


@dataclass
class _Patches:
    """What one read found for each receiver: a line of depth along the slice, and what kind of surface it is.

    Attributes
    ----------
    read
        Where it was read.
    here, slope, slab : (N,)
        q at the receiver, its growth per pixel along the line, and the extent of what lies behind the front.
    faces, is_sky, is_absent : (N,) bool
        Fronts that face the receiver, background, and what lies outside the frame or too far away.
    """

    read: Read
    here: FloatArray
    slope: FloatArray
    slab: FloatArray
    faces: BoolArray
    is_sky: BoolArray
    is_absent: BoolArray | None


class _Cover:
    """One side of a slice, covered read by read, from near to far.

    A read stands for the line as far as the reads beside it. Where their planes cross in between is where one
    surface meets the next; elsewhere the border is the reads' own.
    """

    # Shares are kept as bytes: so many steps per sector.
    steps_per_sector: int
    # Points of a patch that are looked at: its two ends, and the back behind its middle.
    points: int

    def __init__(
        self,
        side: SliceSide,
        receivers: Receivers,
        scratch: Scratch,
        q_end: float,
        max_distance: float,
        jitter: float,
    ) -> None:
        self.side, self.receivers, self.scratch = side, receivers, scratch
        self.q_end, self.max_distance = q_end, max_distance
        # Shares are rounded up or down by chance, on average right
        self.jitter = jitter
        self.last: _Patches | None = None
        self.begin: FloatArray | float = 0.0

    def add(self, read: Read, outside: BoolArray | None) -> tuple[int, Bytes] | None:
        """Take in the planes in the scratch; cover what the read before stands for.

        Parameters
        ----------
        read
            Where they were read.
        outside : (N,) bool or None
            Where nothing was read.

        Returns
        -------
        number, steps
            Of the read before, and how much of the side its lit fronts cover first, in steps; None at first.
        """
        patches, last = self._patches(read, outside), self.last
        self.last = patches
        if last is None:
            self.begin = read.begin
            return None
        border = self._border(last, patches)
        steps = self._cover(last, self.begin, border)
        self.begin = border
        return last.read.number, steps

    def finish(self) -> tuple[int, Bytes] | None:
        """Cover what the last read stands for."""
        last, self.last = self.last, None
        if last is None:
            return None
        return last.read.number, self._cover(last, self.begin, last.read.end)

    def _cover(self, patches: _Patches, begin: FloatArray | float, end: FloatArray | float) -> Bytes:
        raise NotImplementedError

    def _patches(self, read: Read, outside: BoolArray | None) -> _Patches:
        """Return the patches of the planes in the scratch."""
        q, gx, gy, slab = self.scratch.planes
        here, slope, kept_slab = self.scratch.lines[read.number & 1]
        product = self.scratch.spare[0]
        np.multiply(gx, read.ux, out=slope)
        np.multiply(gy, read.uy, out=product)
        np.add(slope, product, out=slope)
        np.multiply(gx, float(read.right), out=here)
        np.multiply(gy, float(read.down), out=product)
        np.add(here, product, out=here)
        np.subtract(q, here, out=here)
        np.copyto(kept_slab, slab)
        is_sky = q == self.q_end
        faces = self.receivers.q > here
        faces &= ~is_sky
        if self.max_distance < np.inf:
            is_far = self._is_too_far(read)
            outside = is_far if outside is None else is_far | outside
        if outside is not None:
            is_sky &= ~outside
        return _Patches(read, here, slope, kept_slab, faces, is_sky, outside)

    def _is_too_far(self, read: Read) -> BoolArray:
        """Return which patches lie beyond the largest distance."""
        q, side = self.scratch.planes[0], self.side
        cotangent = (q * side.slope - side.scale) * (1.0 / read.middle) - side.offset
        away = read.middle * side.across * np.sqrt(cotangent * cotangent + 1.0)
        if not self.receivers.camera.is_orthographic:
            away = away / np.maximum(q, 1e-30)
        is_far: BoolArray = (away > self.max_distance) & (q != self.q_end)
        return is_far

    def _border(self, last: _Patches, patches: _Patches) -> FloatArray:
        """Return where on the line the patches of one read give way to those of the next."""
        border, rise = self.scratch.borders[patches.read.number & 1], self.scratch.spare[0]
        np.subtract(last.slope, patches.slope, out=rise)
        np.subtract(patches.here, last.here, out=border)
        np.divide(border, rise, out=border)
        crossing = rise
        np.fmax(border, last.read.middle, out=crossing)
        np.fmin(crossing, patches.read.middle, out=crossing)
        is_between = crossing == border
        if patches.is_absent is not None:
            is_between &= ~patches.is_absent
        np.subtract(crossing, patches.read.begin, out=border)
        np.multiply(border, is_between, out=border)
        np.add(border, patches.read.begin, out=border)
        return border

    def _passed(self, patches: _Patches, begin: FloatArray | float, end: FloatArray | float) -> FloatArray:
        """Return the sectors (points, N), from the view direction, where the points of the patches lie."""
        side, ends = self.side, self.scratch.ends[: self.points]
        middle = patches.read.middle
        places = (begin, end, middle)[: self.points]
        for point, place in zip(ends, places):
            np.multiply(patches.slope, place, out=point)
            np.add(point, patches.here, out=point)
        if self.points > 2:
            np.subtract(ends[2], patches.slab, out=ends[2])
        np.maximum(ends, self.q_end, out=ends)
        np.multiply(ends, side.slope, out=ends)
        np.subtract(ends, side.scale, out=ends)
        for point, place in zip(ends, places):
            np.divide(point, place, out=point)
        np.subtract(ends, side.offset, out=ends)
        passed = side.sectors(ends, self.scratch.bounds[: self.points])
        if patches.is_absent is not None:
            passed[:, patches.is_absent] = SECTORS
        return passed


class SectorCover(_Cover):
    """Sectors as bits of words; a patch covers those that it and its thickness stand before."""

    steps_per_sector = 1
    points = 3

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        count = self.receivers.q.size
        # Bits that nothing has covered, and those that reach the background
        self.free = np.full(count, _ALL)
        self.sky = np.zeros(count, np.uint32)

    def _cover(self, patches: _Patches, begin: FloatArray | float, end: FloatArray | float) -> Bytes:
        passed = self._passed(patches, begin, end)
        bounds, words = self.scratch.bounds, self.scratch.words
        np.minimum(passed[0], passed[1], out=bounds[0])
        np.maximum(passed[0], passed[1], out=bounds[1])
        np.minimum(bounds[0], passed[2], out=bounds[2])
        np.maximum(bounds[1], passed[2], out=bounds[3])
        np.add(bounds, self.jitter, out=bounds)
        np.clip(bounds, 0.0, float(SECTORS), out=bounds)
        # Words with ones below each bound
        np.copyto(words, bounds, casting="unsafe")
        np.subtract(np.uint32(SECTORS), words, out=words)
        np.right_shift(_ALL, words, out=words)
        front = np.bitwise_xor(words[0], words[1], out=words[0])
        whole = np.bitwise_xor(words[2], words[3], out=words[2])
        np.bitwise_and(front, self.free, out=front)
        mask = words[1]
        if patches.is_sky.any():
            self.sky |= front & _mask(patches.is_sky, mask)
            front &= ~mask
            whole &= ~mask
        lit = np.bitwise_and(front, _mask(patches.faces, mask), out=front)
        if patches.read.is_near:
            whole &= mask
        self.free &= ~(lit | (whole & ~self.sky))
        return _count_bits(lit)

    def open(self) -> FloatArray:
        """Return how many sectors nothing covers."""
        return _count_bits(self.free | self.sky).astype(self.side.weight.dtype)

    def escaped(self) -> FloatArray:
        """Return how many sectors reach the background."""
        return _count_bits(self.sky).astype(self.side.weight.dtype)

    def draw(self, u: float) -> FloatArray:
        """Return a place among the open sectors, in sectors from the view direction, by a number of [0, 1)."""
        bits = self.free | self.sky
        target = u * _count_bits(bits)
        rank = np.floor(target)
        within = target - rank
        place = np.zeros(bits.shape, np.uint32)
        for width in (16, 8, 4, 2, 1):
            lower = _count_bits((bits >> place) & np.uint32((1 << width) - 1))
            is_above = rank >= lower
            rank -= lower * is_above
            place += np.uint32(width) * is_above
        drawn: FloatArray = (place + within).astype(self.side.weight.dtype)
        return drawn


class HorizonCover(_Cover):
    """Everything between the tangent plane and the highest direction."""

    steps_per_sector = 7  # of 255
    points = 2

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.horizon = np.full_like(self.receivers.q, SECTORS)
        self.sky = np.zeros_like(self.horizon)

    def _cover(self, patches: _Patches, begin: FloatArray | float, end: FloatArray | float) -> Bytes:
        passed = self._passed(patches, begin, end)
        highest = np.minimum(passed[0], passed[1])
        added = np.maximum(self.horizon - highest, 0.0)
        if patches.is_sky.any():
            lowest = np.minimum(np.maximum(passed[0], passed[1]), self.horizon)
            self.sky += np.maximum(lowest - highest, 0.0) * patches.is_sky
            added *= ~patches.is_sky
        if patches.read.is_near:
            added *= patches.faces
        self.horizon -= added
        added *= patches.faces
        steps: Bytes = (added * self.steps_per_sector + self.jitter).astype(np.uint8)
        return steps

    def open(self) -> FloatArray:
        """As `SectorCover.open`."""
        return self.horizon

    def escaped(self) -> FloatArray:
        """As `SectorCover.escaped`."""
        return np.minimum(self.sky, self.horizon)

    def draw(self, u: float) -> FloatArray:
        """As `SectorCover.draw`."""
        return self.horizon * u


def _mask(flags: BoolArray, out: Words) -> Words:
    """Return words of ones where `flags` holds, else of zeros."""
    np.copyto(out, flags)
    return np.negative(out, out=out)


def _count_bits_by_table(words: Words) -> Bytes:
    """Return the number of ones in each word, for numpy before 2."""
    table = np.array([bin(value).count("1") for value in range(1 << 8)], dtype=np.uint8)
    counts: Bytes = table[words.view(np.uint8)].reshape(*words.shape, 4).sum(axis=-1, dtype=np.uint8)
    return counts


_count_bits = getattr(np, "bitwise_count", _count_bits_by_table)
