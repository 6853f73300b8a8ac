# SPDX-License-Identifier: GPL-3.0-or-later
"""What patches cover of a side of a slice: single sectors, or all below a horizon."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arcs import SECTORS
from .patches import Bytes, Cover, Patches
from .types import BoolArray, FloatArray

_ALL = np.uint32(0xFFFFFFFF)

Words = NDArray[np.uint32]


class SectorCover(Cover):
    """Sectors as bits of words; a patch covers those that it and its thickness stand before."""

    steps_per_sector = 1
    points = 4

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        count = self.receivers.q.size
        # Bits that nothing has covered, and those that reach the background
        self.free = np.full(count, _ALL)
        self.sky = np.zeros(count, np.uint32)

    def _cover(self, patches: Patches, begin: FloatArray | float, end: FloatArray | float) -> Bytes:
        passed = self._passed(patches, begin, end)
        bounds, words = self.scratch.bounds, self.scratch.words
        np.minimum(passed[0], passed[1], out=bounds[0])
        np.maximum(passed[0], passed[1], out=bounds[1])
        np.minimum(bounds[0], passed[3], out=bounds[0])
        np.maximum(bounds[1], passed[3], out=bounds[1])
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
        """As `Cover.open`."""
        return _count_bits(self.free | self.sky).astype(self.side.weight.dtype)

    def escaped(self) -> FloatArray:
        """As `Cover.escaped`."""
        return _count_bits(self.sky).astype(self.side.weight.dtype)

    def draw(self, u: FloatArray) -> FloatArray:
        """As `Cover.draw`."""
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


class HorizonCover(Cover):
    """Everything between the tangent plane and the highest direction."""

    steps_per_sector = 7  # of 255
    points = 2

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.horizon = np.full_like(self.receivers.q, SECTORS)
        self.sky = np.zeros_like(self.horizon)

    def _cover(self, patches: Patches, begin: FloatArray | float, end: FloatArray | float) -> Bytes:
        passed = self._passed(patches, begin, end)
        highest = np.maximum(np.minimum(passed[0], passed[1]), 0.0)
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
        """As `Cover.open`."""
        return self.horizon

    def escaped(self) -> FloatArray:
        """As `Cover.escaped`."""
        return np.minimum(self.sky, self.horizon)

    def draw(self, u: FloatArray) -> FloatArray:
        """As `Cover.draw`."""
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
