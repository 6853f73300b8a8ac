# SPDX-License-Identifier: GPL-3.0-or-later
"""The diffuse light that a frame alone can answer: the integral over each hemisphere by many traced rays.

What every faster method of the diffuse pass approximates: one bounce, no surround, no filter. Rays without an
answer bring nothing, so that what the frame cannot see counts for no method and against none.

Run ``python -m benchmarks.hemisphere_truth NAME WIDTHxHEIGHT`` to compute one ahead.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.cycles_truth import captured_frame
from benchmarks.inputs import CACHE, parse_size
from ssgi_addon.core import DiffuseSettings, IndirectLight, ReflectionSettings, Settings, render_indirect
from ssgi_addon.core.types import FloatArray
from ssgi_addon.files import replacing
from ssgi_addon.frame import CapturedFrame

RAYS = 512
# Goes up where tracer or sampling change what a hemisphere brings: truths that were kept no longer count.
VERSION = 1
# Of one call, which keeps where each ray hit: four bytes per ray and pixel.
_RAYS_AT_ONCE = 256
# Far from those that variants are run with.
_FIRST_SEED = 1000


@dataclass(frozen=True, eq=False)
class HemisphereTruth:
    """What the hemispheres of a frame bring.

    Attributes
    ----------
    frame
        The frame alone.
    halves : (2, H, W, 5)
        RGB of the diffuse light, visibility and the part that was answered, each of half the rays and with
        seeds of its own: the halves differ by noise alone.
    """

    frame: CapturedFrame
    halves: FloatArray

    @property
    def diffuse(self) -> FloatArray:
        """(H, W, 3) mean of the light of both halves."""
        return self._mean[..., :3]

    @property
    def visibility(self) -> FloatArray:
        """(H, W) mean of the visibility of both halves."""
        return self._mean[..., 3]

    @property
    def known(self) -> FloatArray:
        """(H, W) mean of the answered part of both halves."""
        return self._mean[..., 4]

    @property
    def _mean(self) -> FloatArray:
        mean: FloatArray = self.halves.mean(axis=0)
        return mean


def hemisphere_truth(name: str, frame: CapturedFrame, rays: int = RAYS) -> HemisphereTruth:
    """Return a frame without its surround and what its hemispheres bring, computed where it is not kept yet.

    Parameters
    ----------
    name
        Of the scene, for the file's name.
    frame
        As it was captured.
    rays
        Per pixel, in both halves together.
    """
    frame = replace(frame, views=(), environment=None)
    path = _path(name, frame, rays)
    if not path.is_file():
        halves = np.stack([_half(frame, rays // 2, half) for half in (0, 1)])
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.save(file, halves)
    return HemisphereTruth(frame, np.load(path))


def diffuse_light(frame: CapturedFrame, diffuse: DiffuseSettings, seed: int = 0) -> IndirectLight:
    """Return the light of the diffuse pass alone."""
    settings = Settings(reflections=ReflectionSettings(enabled=False), diffuse=diffuse, seed=seed)
    return render_indirect(frame.gbuffer, frame.camera, settings, frame.environment, frame.views)


def _half(frame: CapturedFrame, rays: int, half: int) -> FloatArray:
    """Return (H, W, 5) light, visibility and answered part, the mean of several runs."""
    at_once = min(rays, _RAYS_AT_ONCE)
    if rays % at_once:
        raise ValueError(f"rays: expected a multiple of {2 * _RAYS_AT_ONCE}, or less, got {2 * rays}")
    runs = rays // at_once
    settings = DiffuseSettings(method="hemisphere", rays=at_once, bounces=1, filter=False)
    total = np.zeros((*frame.gbuffer.shape, 5))
    for run in range(runs):
        light = diffuse_light(frame, settings, seed=_FIRST_SEED + half * runs + run)
        total += np.dstack([light.diffuse, light.visibility, light.known_diffuse])
    return (total / runs).astype(np.float32)


def _path(name: str, frame: CapturedFrame, rays: int) -> Path:
    """Return where a truth is kept; a frame that changed by a bit has another place."""
    gbuffer, camera = frame.gbuffer, frame.camera
    digest = hashlib.sha256(repr(camera).encode())
    for plane in (gbuffer.depth, gbuffer.normal, gbuffer.albedo, gbuffer.diffuse_source):
        digest.update(np.ascontiguousarray(plane).tobytes())
    height, width = gbuffer.shape
    return CACHE / f"hemisphere{VERSION}_{name}_{width}x{height}_{rays}_{digest.hexdigest()[:8]}.npy"


def main() -> None:
    """Compute one truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("size", type=parse_size)
    arguments = parser.parse_args()
    hemisphere_truth(arguments.name, captured_frame(arguments.name, arguments.size))


if __name__ == "__main__":
    main()
