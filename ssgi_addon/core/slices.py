# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffuse light by slices of the hemisphere, marched through the depth buffer without tracing a ray.

Each slice is a line on the screen through the pixel. Along both of its sides a few pixels are read, ever
farther apart, and each covers a part of the slice's arc:

- ``"horizon"``: all between the tangent plane and the highest direction so far (Bavoil et al. 2008, HBAO;
  Jimenez et al. 2016, GTAO). What raises the horizon lights the arc that it adds (Mayaux 2018,
  "Horizon-Based Indirect Lighting"). Everything is infinitely thick.
- ``"bitmask"``: the sectors that the surface and its thickness stand before (Therrien et al. 2023). What
  covers sectors first lights them; light passes behind thin things.

Where the papers read points, these read patches: each stands for its part of the line, along its plane, so
that no light falls between two reads of one surface, and a plane never covers itself. A patch that faces
away, and what is hidden behind a front, covers and brings nothing, as for rays. The patterns of a tile of
pixels differ; the filter averages over them.
"""

from __future__ import annotations

import math
import queue
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from . import parallel
from .arcs import SECTORS, Receivers, SliceSide
from .camera import Camera
from .covers import HorizonCover, SectorCover
from .depth_field import DepthField
from .gbuffer import GBuffer
from .interleave import SIDE, merge_phases, phase_shape, split_phases
from .patches import Bytes, Cover, Read, Scratch
from .sampling import mix, morton, sample_square
from .settings import Settings
from .types import BoolArray, FloatArray

COVERS: dict[str, type[Cover]] = {"horizon": HorizonCover, "bitmask": SectorCover}
# The first read covers the line from here on, pixels.
_FIRST_BORDER = 0.5
_PIXELS_PER_TASK = 32768
# Steps of the R2 sequence (Roberts 2018): powers of the inverse of the plastic number.
_STEPS = tuple(1.324717957244746**-power for power in (1, 2))


@dataclass(frozen=True, eq=False)
class Arcs:
    """What slices met, as shares of an even hemisphere, per pixel.

    Attributes
    ----------
    hit, escaped, open : (H, W)
        Shares that met a lit front, that reach the background, and that nothing covers, `escaped` included.
    direction : (H, W, 3)
        One of the open directions, view space, drawn by its share; zero where it was not asked for.
    """

    hit: FloatArray
    escaped: FloatArray
    open: FloatArray
    direction: FloatArray


@dataclass(frozen=True)
class _Band:
    """Some rows of a phase."""

    y: int
    x: int
    top: int
    bottom: int
    columns: int

    @property
    def order(self) -> int:
        """Number of the phase within a tile, in Morton order."""
        return int(morton(np.array([self.x]), np.array([self.y]))[0])

    @property
    def rows(self) -> slice:
        return slice(self.top, self.bottom)

    @property
    def shape(self) -> tuple[int, int]:
        return self.bottom - self.top, self.columns

    @property
    def pixels(self) -> tuple[slice, slice]:
        """Where the band's pixels lie in the frame."""
        return slice(self.y + self.top * SIDE, self.y + self.bottom * SIDE, SIDE), slice(self.x, None, SIDE)


@dataclass(frozen=True)
class _Window:
    """The pixels of a band that find what they read within the frame, and where it lies."""

    phase: tuple[int, int]
    here: tuple[slice, slice]
    there: tuple[slice, slice]
    is_whole: bool


class SliceGather:
    """Slices through all pixels of a frame, and what they met.

    Parameters
    ----------
    gbuffer, camera, field
        The frame and its slabs.
    settings
        Method, slices, steps, largest distance, seed and threads.
    """

    def __init__(self, gbuffer: GBuffer, camera: Camera, field: DepthField, settings: Settings) -> None:
        options = settings.diffuse
        self.gbuffer, self.camera, self.q_end, self.shape = gbuffer, camera, field.q_end, gbuffer.shape
        self.cover, self.slices, self.steps = COVERS[options.method], options.slices, options.steps
        self.max_distance, self.seed, self.threads = settings.reach, settings.seed, settings.threads
        slices, steps = self.slices, self.steps
        height, width = self.shape
        planes = field.planes.reshape(height, width, 4)
        self.planes = split_phases(np.concatenate([planes, field.reach.reshape(height, width, 1)], axis=-1))
        # Background has no q: it lies at the end
        np.maximum(self.planes[:, :, 0], field.q_end, out=self.planes[:, :, 0])
        _, _, _, rows, columns = self.planes.shape
        # Per side and read, how much of it lit fronts cover; per side, what a step of that is worth
        self.covered = np.zeros((SIDE, SIDE, slices, 2, steps, rows, columns), dtype=np.uint8)
        self.worth = np.zeros((SIDE, SIDE, slices, 2, rows, columns), dtype=planes.dtype)
        self.per_task = max(1, _PIXELS_PER_TASK // columns)
        self.scratches: queue.SimpleQueue[Scratch] = queue.SimpleQueue()

    def march(self, wants_direction: bool, advance: parallel.Advance | None = None) -> Arcs:
        """Cover the arcs of all pixels."""
        sums = np.zeros((SIDE, SIDE, 6, *self.planes.shape[3:]), dtype=self.planes.dtype)

        def work(band: _Band) -> None:
            receivers = Receivers.of(self.gbuffer, self.camera, band.pixels)
            if receivers.is_surface.any():
                self._march_band(
                    band, receivers, sums[band.y, band.x, :, band.rows, : band.columns], wants_direction
                )

        self._run(work, advance)
        merged = merge_phases(sums, self.shape)
        return Arcs(merged[..., 0], merged[..., 1], merged[..., 2], merged[..., 3:])

    def gather(self, handed_on: FloatArray) -> FloatArray:
        """Return the mean over the hemisphere (H, W, 3) of a radiance (H, W, 3) that hits hand on."""
        source = split_phases(handed_on)
        total = np.zeros_like(source)
        self._run(
            lambda band: self._gather_band(band, source, total[band.y, band.x, :, band.rows, : band.columns])
        )
        return merge_phases(total, self.shape)

    def _run(self, work: Callable[[_Band], None], advance: parallel.Advance | None = None) -> None:
        bands = []
        for y in range(min(SIDE, self.shape[0])):
            for x in range(min(SIDE, self.shape[1])):
                rows, columns = phase_shape(self.shape, y, x)
                for top in range(0, rows, self.per_task):
                    bands.append(_Band(y, x, top, min(top + self.per_task, rows), columns))
        parallel.run_chunks(work, bands, self.threads, advance)

    def _march_band(self, band: _Band, receivers: Receivers, sums: FloatArray, wants_direction: bool) -> None:
        """Cover the arcs of a band; sums (6, rows, columns) are hit, escaped, open and the direction."""
        scratch = self._borrow_scratch(receivers.q.size)
        count, dtype = receivers.q.size, receivers.q.dtype
        hit, escaped, free, total = np.zeros((4, count), dtype=dtype)
        direction = np.zeros((3, count), dtype=dtype)
        worth = self.worth[band.y, band.x, :, :, band.rows, : band.columns]
        for number, (side, ux, uy) in self._sides(band):
            arc = SliceSide.of(receivers, ux, uy)
            dice = self._dice(band, 2 * number + side)
            cover = self.cover(
                arc, receivers, scratch, self.q_end, self.max_distance, next(dice), self._limit(band, ux, uy)
            )
            lit = np.zeros(count, dtype=dtype)
            covered = self.covered[band.y, band.x, number, side, :, band.rows, : band.columns]
            found: list[tuple[int, Bytes] | None] = []
            for read, window in self._windows(band, number, side, ux, uy):
                found.append(cover.add(read, self._fill(scratch, window, band.shape)))
            for number_steps in (*found, cover.finish()):
                if number_steps is not None:
                    covered[number_steps[0]] = number_steps[1].reshape(band.shape)
                    lit += number_steps[1]
            hit += arc.weight * lit * (1.0 / cover.steps_per_sector)
            escaped += arc.weight * cover.escaped()
            share = arc.weight * cover.open()
            free += share
            total += arc.weight
            worth[number, side] = arc.weight.reshape(band.shape)
            if wants_direction:
                # The share of what is open decides which side the direction is drawn from
                u, v = self._points(band, 2 * number + side)
                is_chosen = u * free < share
                drawn = arc.direction(cover.draw(v), receivers.view)
                np.copyto(direction, drawn, where=is_chosen)
        inverse = (1.0 / SECTORS) / np.maximum(total, 1e-30)
        worth *= (inverse * (1.0 / self.cover.steps_per_sector)).reshape(band.shape)
        for index, values in enumerate((hit, escaped, free)):
            sums[index] = (values * inverse).reshape(band.shape)
        sums[3:] = direction.reshape(3, *band.shape)
        self.scratches.put(scratch)

    def _gather_band(self, band: _Band, source: FloatArray, total: FloatArray) -> None:
        light = np.empty_like(total)
        weight = np.empty(band.shape, dtype=total.dtype)
        product = np.empty_like(weight)
        for number, (side, ux, uy) in self._sides(band):
            covered = self.covered[band.y, band.x, number, side, :, band.rows, : band.columns]
            light[:] = 0.0
            for read, window in self._windows(band, number, side, ux, uy):
                np.copyto(weight, covered[read.number])
                here, there = window.here, window.there
                for channel in range(3):
                    np.multiply(weight[here], source[(*window.phase, channel)][there], out=product[here])
                    light[channel][here] += product[here]
            light *= self.worth[band.y, band.x, number, side, band.rows, : band.columns]
            total += light

    def _limit(self, band: _Band, ux: float, uy: float) -> FloatArray:
        """Return where lines from a band's pixels leave the frame (N,), pixels."""
        limits = []
        for size, step, where in zip(self.shape, (uy, ux), band.pixels):
            centre = np.arange(size)[where] + 0.5
            room = size - centre if step > 0.0 else centre
            limits.append((room / max(abs(step), 1e-9)).astype(self.planes.dtype))
        limit: FloatArray = np.minimum(limits[0][:, None], limits[1]).ravel()
        return limit

    def _borrow_scratch(self, size: int) -> Scratch:
        try:
            scratch = self.scratches.get_nowait()
        except queue.Empty:
            scratch = Scratch(self.per_task * self.planes.shape[4], self.planes.dtype)
        scratch.resize(size)
        return scratch

    def _fill(self, scratch: Scratch, window: _Window, shape: tuple[int, int]) -> BoolArray | None:
        """Copy the planes that a band reads; return where it reads beyond the frame, None for nowhere."""
        planes = scratch.planes.reshape(5, *shape)
        planes[:, *window.here] = self.planes[window.phase][:, *window.there]
        if window.is_whole:
            return None
        outside = np.ones(shape, dtype=np.bool_)
        outside[window.here] = False
        planes[:, outside] = 0.0
        return outside.ravel()

    def _sides(self, band: _Band) -> Iterator[tuple[int, tuple[int, float, float]]]:
        """Yield the number of each slice with its sides and their directions on the screen."""
        # Each 2 x 2 of a tile's phases is as even as the whole tile
        turn = _reversed_bits(band.order) / SIDE**2 + _hash(self.seed, 0) / SIDE**2
        for number in range(self.slices):
            angle = math.pi * (number + turn) / self.slices
            for side, sign in enumerate((1.0, -1.0)):
                yield number, (side, sign * math.cos(angle), sign * math.sin(angle))

    def _dice(self, band: _Band, kind: int) -> Iterator[float]:
        """Yield numbers of [0, 1) that are even over the phases of a tile."""
        for axis, step in enumerate(_STEPS):
            yield (step * band.order + _hash(self.seed, 4 * kind + axis + 1)) % 1.0

    def _points(self, band: _Band, kind: int) -> tuple[FloatArray, FloatArray]:
        """Return sample points (u, v) of [0, 1)², each (N,), that are even over neighbours."""
        rows, columns = (np.arange(size)[where] for size, where in zip(self.shape, band.pixels))
        pixel = (rows[:, None] * self.shape[1] + columns).ravel()
        u, v = sample_square(pixel, self.shape[1], 1, self.seed + 64 + kind, self.planes.dtype)
        return u[0], v[0]

    def _windows(
        self, band: _Band, number: int, side: int, ux: float, uy: float
    ) -> Iterator[tuple[Read, _Window]]:
        """Yield the reads along a line, and the pixels of a band that find them in the frame."""
        height, width = self.shape
        longest = min(width / max(abs(ux), 1e-9), height / max(abs(uy), 1e-9))
        ratio = (max(longest, 2.0) / _FIRST_BORDER) ** (1.0 / self.steps)
        *_, place = self._dice(band, 2 * number + side)
        for step in range(self.steps):
            begin = _FIRST_BORDER * ratio**step
            middle = max(begin * ratio**place, 1.0)
            right, down = round(middle * ux), round(middle * uy)
            window = self._window(band, right, down)
            if window is not None:
                yield Read(step, right, down, begin, middle, ux, uy), window

    def _window(self, band: _Band, right: int, down: int) -> _Window | None:
        shift_y, phase_y = divmod(band.y + down, SIDE)
        shift_x, phase_x = divmod(band.x + right, SIDE)
        rows, columns = phase_shape(self.shape, phase_y, phase_x)
        first, last = max(band.top, -shift_y), min(band.bottom, rows - shift_y)
        left, end = max(0, -shift_x), min(band.columns, columns - shift_x)
        if first >= last or left >= end:
            return None
        here = (slice(first - band.top, last - band.top), slice(left, end))
        there = (slice(first + shift_y, last + shift_y), slice(left + shift_x, end + shift_x))
        is_whole = (last - first, end - left) == band.shape
        return _Window((phase_y, phase_x), here, there, is_whole)


def _reversed_bits(order: int) -> int:
    """Return the number within a tile whose binary digits stand in the opposite order."""
    digits = (SIDE * SIDE).bit_length() - 1
    return int(format(order, f"0{digits}b")[::-1], 2)


def _hash(seed: int, kind: int) -> float:
    """Return a number of [0, 1) that depends on a seed and a purpose."""
    return mix(1031 * seed + kind) / 2.0**32
