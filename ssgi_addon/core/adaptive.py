# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays where the variance asks for them: some for every pixel, then ever more for the pixels that need them.

After Rousselle, Knaus and Zwicker 2011, "Adaptive Sampling and Reconstruction using Greedy Error
Minimization", in its plainest form: rays go on where the estimated error of the mean, relative to the
picture, is above a threshold. The variance of a few rays misses what they missed, and to stop where rays
happen to agree darkens the mean; so the variance is that of thousands of rays around a pixel, not of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from . import parallel
from .diffuse import HemisphereRays, has_rays
from .environment import Environment
from .gbuffer import GBuffer
from .light import luminance
from .scene import TraceScene
from .settings import Settings
from .types import BoolArray, FloatArray, IntArray

# Rays that every pixel takes first; each round after it doubles those of the pixels that go on.
FIRST_ROUND = 4
# Pixels to each side whose rays tell the variance. Measured on two interiors at a threshold of 0.2: all light
# is 3.5 and 1.9 % too dark by 3 pixels, 0.8 and 0.5 % by 8, 0.2 and 0.3 % by 24.
_REACH = 24
# Dark pixels are judged by this share of the picture's mean luminance.
_DARK_SHARE = 0.1


def round_slices(rays: int) -> list[slice]:
    """Return which of a pixel's rays each round takes."""
    ends = [0, min(FIRST_ROUND, rays)]
    while ends[-1] < rays:
        ends.append(min(2 * ends[-1], rays))
    return [slice(begin, end) for begin, end in pairwise(ends)]


def is_adaptive(settings: Settings) -> bool:
    """Whether diffuse rays are traced in rounds."""
    options = settings.diffuse
    return options.adaptive > 0.0 and options.rays > FIRST_ROUND and has_rays(settings)


@dataclass(frozen=True, eq=False)
class AdaptiveSamples:
    """`DiffuseSamples` of pixels with different numbers of rays.

    Attributes
    ----------
    taken : (P,) int64
        Rays of each pixel.
    rounds
        Of each round, the pixels that took part, as ascending places in `pixel` (N,), and the texels that
        their rays met, (rays, N) int32.
    """

    pixel: IntArray
    bounce: FloatArray
    environment: FloatArray
    visibility: FloatArray
    known: FloatArray
    variance: FloatArray
    taken: IntArray
    rounds: list[tuple[IntArray, np.ndarray]]
    brings_light: bool = True

    @property
    def traced(self) -> int:
        """Rays of all pixels."""
        return int(self.taken.sum())

    @property
    def count(self) -> int:
        """Mean of the rays per pixel, rounded down."""
        return self.traced // max(self.pixel.size, 1)

    @property
    def most_own(self) -> int:
        """As in `DiffuseSamples`: where rays are few, they were found to be enough."""
        return int(self.taken.max(initial=0))

    def gather(self, handed_on: FloatArray, threads: int | None) -> FloatArray:
        """As `DiffuseSamples.gather`."""
        bounce = np.zeros_like(self.bounce)
        share = (1.0 / self.taken).astype(bounce.dtype)

        def work(slots: IntArray) -> None:
            begin, end = int(slots[0]), int(slots[-1]) + 1
            for places, hit in self.rounds:
                first, last = np.searchsorted(places, (begin, end))
                part = places[first:last]
                total = bounce.take(part, axis=0)
                for texels in hit[:, first:last]:
                    total += handed_on.take(texels, axis=0)
                bounce[part] = total
            bounce[begin:end] *= share[begin:end, None]

        parallel.run_chunks(work, parallel.split(np.arange(self.pixel.size), 65536), threads)
        return bounce


class _Sums:
    """Sums over the rays of P pixels, in the order of the rays."""

    def __init__(self, count: int, dtype: np.dtype) -> None:
        self.bounce, self.environment = np.zeros((2, count, 3), dtype=dtype)
        # Of the luminance, and of its square
        self.first, self.second = np.zeros((2, count), dtype=dtype)
        self.taken, self.known, self.open = np.zeros((3, count), dtype=np.int64)

    def add(
        self, to: IntArray, rays: HemisphereRays, where: slice, source: FloatArray, sky: Environment | None
    ) -> None:
        """Add the rays of a run of pixels, whose sums stand at `to`."""
        radiance, from_sky = rays.light(where, source, sky)
        _add_rows(self.bounce, to, radiance)
        if from_sky is not None:
            _add_rows(self.environment, to, from_sky)
            radiance += from_sky
        brightness = luminance(radiance)
        _add_rows(self.first, to, brightness)
        _add_rows(self.second, to, brightness * brightness)
        self.known[to] += rays.is_known(where).sum(axis=0)
        self.open[to] += rays.is_open(where).sum(axis=0)
        self.taken[to] += radiance.shape[0]

    def spread(self) -> FloatArray:
        """Return the mean square deviation (P,) from each pixel's mean."""
        mean = self.first / self._count()
        spread: FloatArray = np.maximum(self.second / self._count() - mean * mean, 0.0)
        return spread

    def samples(self, pixel: IntArray, rounds: list[tuple[IntArray, np.ndarray]]) -> AdaptiveSamples:
        """Return the means."""
        count, dtype = self._count(), self.bounce.dtype
        return AdaptiveSamples(
            pixel,
            self.bounce / count[:, None],
            self.environment / count[:, None],
            (self.open / self.taken).astype(dtype),
            (self.known / self.taken).astype(dtype),
            self.spread() / (count - 1.0),
            self.taken,
            rounds,
        )

    def _count(self) -> FloatArray:
        return self.taken.astype(self.bounce.dtype)


def _add_rows(total: FloatArray, to: IntArray, rows: FloatArray) -> None:
    sums = total.take(to, axis=0)
    for row in rows:
        sums += row
    total[to] = sums


def sample_adaptively(
    scene: TraceScene,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    pixel: IntArray,
    advance: parallel.Advance | None = None,
) -> AdaptiveSamples:
    """Sample the hemispheres above pixels of the frame, in rounds.

    A pixel that takes part in all of them has the samples of `diffuse.sample_hemispheres`.

    Parameters
    ----------
    scene, source, environment, settings, pixel, advance
        As in `diffuse.sample_hemispheres`.
    """
    frame = scene.views[0].layers[0]
    sums = _Sums(pixel.size, scene.dtype)
    rounds: list[tuple[IntArray, np.ndarray]] = []
    active = np.arange(pixel.size)
    for chosen in round_slices(settings.diffuse.rays):
        if rounds:
            active = active[is_noisy(frame, pixel, sums, settings.diffuse.adaptive).take(active)]
        if not active.size:
            break
        hit = np.empty((chosen.stop - chosen.start, active.size), dtype=np.int32)
        rounds.append((active, hit))
        part = _part(advance, chosen, settings.diffuse.rays)
        for block in parallel.split(np.arange(active.size), parallel.RAYS_AT_ONCE // 2 // hit.shape[0]):
            _add_block(scene, source, environment, settings, pixel, sums, (active, hit), block, chosen, part)
        if advance is not None:
            part(1.0)
    return sums.samples(pixel, rounds)


def _part(advance: parallel.Advance | None, chosen: slice, rays: int) -> parallel.Advance:
    def advanced(fraction: float) -> None:
        if advance is not None:
            advance((chosen.start + fraction * (chosen.stop - chosen.start)) / rays)

    return advanced


def _add_block(
    scene: TraceScene,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    pixel: IntArray,
    sums: _Sums,
    taking_part: tuple[IntArray, np.ndarray],
    block: IntArray,
    chosen: slice,
    advance: parallel.Advance,
) -> None:
    """Trace and add the chosen rays of a run of the pixels that take part in a round."""
    active, hit = taking_part

    def advanced(fraction: float) -> None:
        advance((block[0] + fraction * block.size) / active.size)

    rays = HemisphereRays.trace(scene, 0, settings, pixel.take(active.take(block)), advanced, chosen)

    def shade(slots: IntArray) -> None:
        where = slice(slots[0], slots[-1] + 1)
        to = slice(block[0] + where.start, block[0] + where.stop)
        hit[:, to] = rays.texel[:, where]
        sums.add(active[to], rays, where, source, environment)

    chunks = parallel.split(np.arange(block.size), max(1, parallel.RAYS_PER_TASK // hit.shape[0]))
    parallel.run_chunks(shade, chunks, settings.threads)


def is_noisy(frame: GBuffer, pixel: IntArray, sums: _Sums, threshold: float) -> BoolArray:
    """Return which pixels (P,) have a larger error of the mean than a share of the picture.

    The picture is the direct light with the diffuse light so far; both this and the variance are means over
    the pixels around.
    """
    count = sums.taken.astype(sums.first.dtype)

    def around(values: FloatArray) -> FloatArray:
        """Return the mean (P,) of the pixels around that have values."""
        image, weight = np.zeros((2, *frame.shape))
        image.reshape(-1)[pixel], weight.reshape(-1)[pixel] = values, 1.0
        total, number = (_square_sums(part).reshape(-1).take(pixel) for part in (image, weight))
        mean: FloatArray = (np.maximum(total, 0.0) / np.rint(number)).astype(values.dtype)
        return mean

    color = luminance(frame.albedo).reshape(-1).take(pixel)
    # Of a single ray: n / (n - 1) of the spread among n of them
    variance = around(sums.spread() * (count / (count - 1.0)))
    picture = luminance(frame.direct).reshape(-1).take(pixel) + color * around(sums.first / count)
    dark = _DARK_SHARE * float(picture.mean(dtype=np.float64))
    scale = np.sqrt(picture * picture + dark * dark)
    noisy: BoolArray = color * np.sqrt(variance / count) > threshold * scale
    return noisy


def _square_sums(image: FloatArray) -> FloatArray:
    """Return the sums (H, W) over squares of ``2 * _REACH + 1`` pixels, by differences of running sums."""
    for axis in (0, 1):
        # One more before, so that a difference is the sum of what lies between
        padding = [(_REACH + 1, _REACH) if axis == other else (0, 0) for other in (0, 1)]
        until = np.moveaxis(np.cumsum(np.pad(image, padding), axis=axis), axis, 0)
        side = 2 * _REACH + 1
        image = np.moveaxis(until[side:] - until[:-side], 0, axis)
    return image
