# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels that are read along a line on the screen, as patches that stand for parts of the line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arcs import SECTORS, Receivers, SliceSide
from .slabs import SELF_CONTACT_PX
from .types import BoolArray, FloatArray

Bytes = NDArray[np.uint8]

# Planes that differ by less than this share of q, and of how far they rise, are one: some hundred roundings.
_ROUNDING = 1e-5


@dataclass(frozen=True)
class Read:
    """A pixel that stands for a part of a line on the screen.

    Attributes
    ----------
    number
        Its place along the line, from 0.
    right, down
        Offset of the pixel from the receiver, pixels.
    begin, middle
        Where its part of the line begins unless planes cross there, and its middle, pixels from the receiver.
    ux, uy
        Unit direction of the line, y down.
    """

    number: int
    right: int
    down: int
    begin: float
    middle: float
    ux: float
    uy: float

    @property
    def is_near(self) -> bool:
        """True beside the receiver, where a surface's own roughness may face away."""
        return max(abs(self.right), abs(self.down)) <= SELF_CONTACT_PX


class Scratch:
    """Arrays that tasks use again and again, for up to `size` pixels.

    Attributes
    ----------
    planes : (5, N)
        Of the pixels that were read last: `DepthField.planes` and `DepthField.reach`.
    """

    def __init__(self, size: int, dtype: np.dtype) -> None:
        self._floats, self._words = np.empty(26 * size, dtype), np.empty(4 * size, np.uint32)
        self.resize(size)

    def resize(self, size: int) -> None:
        """Let all arrays hold `size` pixels."""
        floats = self._floats[: 26 * size].reshape(26, size)
        self.planes, self.ends, self.bounds = floats[:5], floats[5:9], floats[9:13]
        self.borders, self.spare = floats[13:15], floats[15:16]
        self.lines, self.tells = (floats[16:20], floats[20:24]), floats[24:26]
        self.words = self._words[: 4 * size].reshape(4, size)


@dataclass
class Patches:
    """What one read found for each receiver: a line of depth along the slice, and what kind of surface it is.

    Attributes
    ----------
    read
        Where it was read.
    here, slope, slab, step : (N,)
        q at the receiver, its growth per pixel along the line, the extent of what lies behind the front, and
        how much of that counts as front.
    faces, is_sky : (N,) bool
        Fronts that face the receiver, and background.
    is_absent, outside : (N,) bool or None
        What lies outside the frame or too far away, and what lies outside.
    """

    read: Read
    here: FloatArray
    slope: FloatArray
    slab: FloatArray
    step: FloatArray
    faces: BoolArray
    is_sky: BoolArray
    is_absent: BoolArray | None
    outside: BoolArray | None


class Cover:
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
        limit: FloatArray,
    ) -> None:
        self.side, self.receivers, self.scratch = side, receivers, scratch
        self.q_end, self.max_distance = q_end, max_distance
        # Shares are rounded up or down by chance, on average right
        self.jitter = jitter
        # Where the line leaves the frame, pixels from each receiver
        self.limit = limit
        self.last: Patches | None = None
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
        return last.read.number, self._cover(last, self.begin, self.limit)

    def open(self) -> FloatArray:
        """Return how many sectors nothing covers."""
        raise NotImplementedError

    def escaped(self) -> FloatArray:
        """Return how many sectors reach the background."""
        raise NotImplementedError

    def draw(self, u: FloatArray) -> FloatArray:
        """Return a place among the open sectors, counted from the view direction, by numbers of [0, 1)."""
        raise NotImplementedError

    def _cover(self, patches: Patches, begin: FloatArray | float, end: FloatArray | float) -> Bytes:
        raise NotImplementedError

    def _patches(self, read: Read, outside: BoolArray | None) -> Patches:
        """Return the patches of the planes in the scratch."""
        q, gx, gy, slab, reach = self.scratch.planes
        here, slope, kept_slab, step = self.scratch.lines[read.number & 1]
        product = self.scratch.spare[0]
        np.multiply(gx, read.ux, out=slope)
        np.multiply(gy, read.uy, out=product)
        np.add(slope, product, out=slope)
        np.multiply(gx, float(read.right), out=here)
        np.multiply(gy, float(read.down), out=product)
        np.add(here, product, out=here)
        np.subtract(q, here, out=here)
        np.copyto(kept_slab, slab)
        np.minimum(slab, reach, out=step)
        is_sky = q == self.q_end
        faces = self.receivers.q > here
        faces &= ~is_sky
        is_absent = outside
        if self.max_distance < np.inf:
            is_far = self._is_too_far(read)
            is_absent = is_far if outside is None else is_far | outside
        if outside is not None:
            is_sky &= ~outside
        return Patches(read, here, slope, kept_slab, step, faces, is_sky, is_absent, outside)

    def _is_too_far(self, read: Read) -> BoolArray:
        """Return which patches lie beyond the largest distance."""
        q, side = self.scratch.planes[0], self.side
        cotangent = (q * side.slope - side.scale) * (1.0 / read.middle) - side.offset
        away = read.middle * side.across * np.sqrt(cotangent * cotangent + 1.0)
        if not self.receivers.camera.is_orthographic:
            away = away / np.maximum(q, 1e-30)
        is_far: BoolArray = (away > self.max_distance) & (q != self.q_end)
        return is_far

    def _border(self, last: Patches, patches: Patches) -> FloatArray:
        """Return where on the line the patches of one read give way to those of the next."""
        border: FloatArray = self.scratch.borders[patches.read.number & 1]
        rise: FloatArray = self.scratch.spare[0]
        np.subtract(last.slope, patches.slope, out=rise)
        np.subtract(patches.here, last.here, out=border)
        is_told = self._is_told(rise, last, patches)
        with np.errstate(divide="ignore", invalid="ignore"):
            np.divide(border, rise, out=border)
        crossing = rise
        np.fmax(border, last.read.middle, out=crossing)
        np.fmin(crossing, patches.read.middle, out=crossing)
        is_between = crossing == border
        is_between &= is_told
        if patches.is_absent is not None:
            is_between &= ~patches.is_absent
        np.subtract(crossing, patches.read.begin, out=border)
        np.multiply(border, is_between, out=border)
        np.add(border, patches.read.begin, out=border)
        if patches.outside is not None:
            # The last one within the frame stands for all up to its edge
            np.copyto(border, self.limit, where=patches.outside)
        return border

    def _is_told(self, rise: FloatArray, last: Patches, patches: Patches) -> BoolArray:
        """Return where the planes of two reads, whose slopes differ by `rise`, are more than rounding apart.

        Where one surface goes on, their crossing is a quotient of two roundings.
        """
        span, scale = self.scratch.tells
        np.multiply(patches.slope, _ROUNDING * patches.read.middle, out=scale)
        np.abs(scale, out=scale)
        np.multiply(self.scratch.planes[0], _ROUNDING, out=span)
        np.abs(span, out=span)
        np.add(scale, span, out=scale)
        np.multiply(rise, patches.read.middle - last.read.middle, out=span)
        np.abs(span, out=span)
        is_told: BoolArray = span > scale
        return is_told

    def _passed(self, patches: Patches, begin: FloatArray | float, end: FloatArray | float) -> FloatArray:
        """Return the sectors (points, N), from the view direction, where the points of the patches lie."""
        side, ends = self.side, self.scratch.ends[: self.points]
        middle = patches.read.middle
        places = (begin, end, middle, middle)[: self.points]
        for point, place in zip(ends, places):
            np.multiply(patches.slope, place, out=point)
            np.add(point, patches.here, out=point)
        # q may fall below 0 beyond a plane's horizon: such points still lie in the plane, as seen from here
        if self.points > 2:
            np.subtract(ends[2], patches.slab, out=ends[2])
            np.subtract(ends[3], patches.step, out=ends[3])
        np.multiply(ends, side.slope, out=ends)
        np.subtract(ends, side.scale, out=ends)
        for point, place in zip(ends, places):
            np.divide(point, place, out=point)
        np.subtract(ends, side.offset, out=ends)
        passed: FloatArray = side.sectors(ends, self.scratch.bounds[: self.points])
        if patches.is_absent is not None:
            passed[:, patches.is_absent] = SECTORS
        return passed
