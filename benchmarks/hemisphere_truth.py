# SPDX-License-Identifier: GPL-3.0-or-later
"""The diffuse light that a frame alone can answer: the integral over each hemisphere by many traced rays.

What every faster method of the diffuse pass approximates: one bounce, no surround, no filter. Rays without an
answer bring nothing, so that what the frame cannot see counts for no method and against none.

Run ``python -m benchmarks.hemisphere_truth NAME WIDTHxHEIGHT [RAYS]`` to compute one ahead.
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

RAYS = 1024
# Goes up where tracer or sampling change what a hemisphere brings: truths that were kept no longer count.
VERSION = 1
# Of one part, which has a seed and a file of its own: a truth with more rays takes those of one with fewer.
_RAYS_PER_PART = 256
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
    each = max(1, min(rays // 2, _RAYS_PER_PART))
    if rays < 2 or rays % (2 * each):
        raise ValueError(f"truth rays: expected a multiple of {2 * each}, got {rays}")
    frame = replace(frame, views=(), environment=None)
    parts = [_part(_path(name, frame, each, seed), frame, each, seed) for seed in range(rays // each)]
    return HemisphereTruth(frame, np.stack([np.mean(parts[half::2], axis=0) for half in (0, 1)]))


def diffuse_light(frame: CapturedFrame, diffuse: DiffuseSettings, seed: int = 0) -> IndirectLight:
    """Return the light of the diffuse pass alone."""
    settings = Settings(reflections=ReflectionSettings(enabled=False), diffuse=diffuse, seed=seed)
    return render_indirect(frame.gbuffer, frame.camera, settings, frame.environment, frame.views)


def _part(path: Path, frame: CapturedFrame, rays: int, seed: int) -> FloatArray:
    """Return (H, W, 5) light, visibility and answered part by some of the rays."""
    if not path.is_file():
        settings = DiffuseSettings(method="hemisphere", rays=rays, bounces=1, filter=False)
        light = diffuse_light(frame, settings, seed=_FIRST_SEED + seed)
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.save(file, np.dstack([light.diffuse, light.visibility, light.known_diffuse]))
    part: FloatArray = np.load(path)
    return part


def _path(name: str, frame: CapturedFrame, rays: int, seed: int) -> Path:
    """Return where a part is kept; those of a frame that changed by a bit have another place."""
    gbuffer, camera = frame.gbuffer, frame.camera
    digest = hashlib.sha256(repr(camera).encode())
    planes = (gbuffer.depth, gbuffer.normal, gbuffer.albedo, gbuffer.diffuse_source, gbuffer.thickness)
    for plane in planes:
        digest.update(b"" if plane is None else np.ascontiguousarray(plane).tobytes())
    height, width = gbuffer.shape
    return CACHE / f"hemisphere{VERSION}_{name}_{width}x{height}_{digest.hexdigest()[:8]}_{rays}_{seed}.npy"


def main() -> None:
    """Compute one truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("size", type=parse_size)
    parser.add_argument("rays", type=int, nargs="?", default=RAYS)
    arguments = parser.parse_args()
    hemisphere_truth(arguments.name, captured_frame(arguments.name, arguments.size), arguments.rays)


if __name__ == "__main__":
    main()
