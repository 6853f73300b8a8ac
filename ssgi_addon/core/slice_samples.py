# SPDX-License-Identifier: GPL-3.0-or-later
"""What slices of the hemisphere bring: arcs that the frame covers, and what lies beyond it in the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import parallel, tracer
from .denoise import local_mean
from .environment import Environment
from .frame_points import surface_points
from .light import luminance
from .scene import TraceScene
from .settings import Settings
from .slices import COVERS, SliceGather
from .types import FloatArray, IntArray

SLICED = tuple(COVERS)


@dataclass(frozen=True, eq=False)
class SliceSamples:
    """`diffuse.DiffuseSamples` of slices.

    What the frame leaves open is one sample more: ``beyond`` (P,) is the texel of another view that one
    direction of it meets, as in `scene.Answers`, and ``share`` (P,) how much of the hemisphere it stands for.
    """

    scene: TraceScene
    home: int
    gatherer: SliceGather
    pixel: IntArray
    bounce: FloatArray
    environment: FloatArray
    visibility: FloatArray
    known: FloatArray
    variance: FloatArray
    beyond: IntArray | None
    share: FloatArray
    count: int
    traced: int
    brings_light: bool = True
    most_own: int = 0

    def gather(self, handed_on: FloatArray, threads: int | None) -> FloatArray:
        """As `diffuse.DiffuseSamples.gather`."""
        front = handed_on[self.scene.front_texels(self.home)]
        shape = self.scene.views[self.home].layers[0].shape
        bounce = self.gatherer.gather(front.reshape(*shape, 3)).reshape(-1, 3).take(self.pixel, axis=0)
        if self.beyond is not None:
            bounce += self.share[:, None] * handed_on.take(self.beyond, axis=0)
        return bounce


def sample_slices(
    scene: TraceScene,
    home: int,
    source: FloatArray,
    environment: Environment | None,
    settings: Settings,
    pixel: IntArray,
    advance: parallel.Advance | None = None,
) -> SliceSamples:
    """Cover the hemispheres above the given pixels; parameters as in `diffuse.sample_hemispheres`.

    Layers behind the view's front are not looked at. One direction of what nothing covers is followed into
    the other views, and brings the environment where its colour differs by direction.
    """
    view, options = scene.views[home], settings.diffuse
    gbuffer = view.layers[0]
    gatherer = SliceGather(gbuffer, view.camera, view.fields[0], settings)
    has_views = len(scene.views) > 1
    is_even = environment is None or environment.is_constant
    arcs = gatherer.march(has_views or not is_even, advance)
    hit, escaped, share = (values.reshape(-1).take(pixel) for values in (arcs.hit, arcs.escaped, arcs.open))
    known, visibility, beyond = hit + escaped, share.copy(), None
    brings = 1.0 - hit if settings.unknown == "environment" else escaped
    direction = arcs.direction.reshape(-1, 3).take(pixel, axis=0).T if has_views or not is_even else None
    if direction is not None:
        origin, _ = surface_points(gbuffer, view.camera, pixel)
        answers = scene.answer(origin, direction, home, settings.threads, is_clear=True)
        visibility *= (answers.status != tracer.BLOCKED) & (answers.status != tracer.HIT)
        known = hit + share * (answers.status >= tracer.ESCAPED)
        brings = share * answers.brings_environment(settings.unknown)
        if settings.unknown == "environment":
            # What is hidden is unknown, too; for its colour the open direction is as good as any
            brings += 1.0 - hit - share
        beyond = answers.texel if has_views else None
    sky = np.zeros((pixel.size, 3), dtype=scene.dtype)
    if environment is not None:
        radiance = environment.radiance(*(np.zeros((3, pixel.size)) if direction is None else direction))
        sky += brings[:, None] * radiance
    samples = SliceSamples(
        scene, home, gatherer, pixel, sky, sky, visibility, np.minimum(known, 1.0), share, beyond, share,
        2 * options.slices * options.steps, 0 if not has_views else pixel.size,
    )  # fmt: skip
    bounce = samples.gather(source, settings.threads)
    return _with_light(samples, bounce)


def _with_light(samples: SliceSamples, bounce: FloatArray) -> SliceSamples:
    """Return samples with their bounce, and the variance that neighbours with other patterns show."""
    shape = samples.scene.views[samples.home].layers[0].shape
    brightness = np.zeros(shape, dtype=bounce.dtype)
    brightness.reshape(-1)[samples.pixel] = luminance(bounce + samples.environment)
    mean = local_mean(brightness)
    variance = np.maximum(local_mean(brightness * brightness) - mean * mean, 0.0)
    return replace(samples, bounce=bounce, variance=variance.reshape(-1).take(samples.pixel))
