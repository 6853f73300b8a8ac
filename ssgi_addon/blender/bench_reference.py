# SPDX-License-Identifier: GPL-3.0-or-later
"""The truth of a benchmark's scene: two references whose noise differs, kept on disk."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bench.scores import own_error
from ..bench.store import digest
from ..files import replacing
from .capture import CaptureOptions, capture_frame
from .reference import Reference, ReferenceOptions, render_reference

FloatArray = NDArray[np.float32]

_SEEDS = (0, 1)
# Of methods, whose seed is 0: the noise of a reference must not be theirs.
_FIRST_SEED = 1000
# Changes when what is kept changes.
_FORMAT = 1


@dataclass(frozen=True, eq=False)
class Truth:
    """Both halves of a reference, and the frame's depth.

    Attributes
    ----------
    combined, direct : (2, H, W, 3)
        Cycles with all bounces, and its direct light alone; both denoised where this Blender can.
    diffuse, glossy : (2, H, W, 3)
        The passes Diffuse Indirect and Glossy Indirect, never denoised.
    depth : (H, W)
        At the pixels' centres, +inf on background.
    seconds
        That all of it took to render.
    """

    combined: FloatArray
    direct: FloatArray
    diffuse: FloatArray
    glossy: FloatArray
    depth: FloatArray
    seconds: float

    def own_errors(self) -> dict[str, float]:
        """Return the relMSE that each mean of two halves has by itself, as far as the halves tell."""
        return {name: own_error(getattr(self, name)) for name in ("combined", "diffuse", "glossy")}


def truth_of(
    scene: bpy.types.Scene,
    key: str,
    folder: Path,
    size: tuple[int, int],
    samples: int,
    progress: Callable[[float, str], None],
) -> Truth:
    """Return a scene's truth, rendered once for each scene, size and number of samples.

    Parameters
    ----------
    scene
        Set up by `borrow_bench`; exactly as before afterwards, also after an error.
    key
        Of the scene's file.
    folder
        Where truths are kept.
    size
        Width and height, pixels.
    samples
        Per pixel, of each half.
    progress
        Called with a fraction and a text.

    Raises
    ------
    SSGIError
        If the scene cannot be rendered, or the folder cannot be written.
    """
    name = digest(key, size, samples, scene.frame_current, bpy.app.version_string, _FORMAT)
    path = folder / f"{name}.npz"
    if path.is_file():
        with np.load(path) as kept:
            return Truth(**{item.name: kept[item.name] for item in fields(Truth)})
    truth = _render(scene, size, samples, progress)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **{item.name: getattr(truth, item.name) for item in fields(Truth)})
    return truth


def render_best(
    scene: bpy.types.Scene, size: tuple[int, int], samples: int, seed: int, *, direct: bool = False
) -> Reference:
    """Render Cycles' light with its best denoising: all of it, or the direct light alone."""
    bounces = {"diffuse_bounces": 0, "glossy_bounces": 0} if direct else {}
    options = ReferenceOptions(samples=samples, resolution=size, seed=_FIRST_SEED + seed, **bounces)
    return render_reference(scene, options)


def _render(
    scene: bpy.types.Scene,
    size: tuple[int, int],
    samples: int,
    progress: Callable[[float, str], None],
) -> Truth:
    begun = time.perf_counter()
    halves, directs = [], []
    for seed in range(2):
        progress(0.5 * seed, f"Reference {seed + 1} of 2")
        halves.append(render_best(scene, size, samples, seed))
        directs.append(render_best(scene, size, samples, seed, direct=True).combined)
    geometry = capture_frame(scene, CaptureOptions(samples=1, denoiser="none", resolution=size))
    return Truth(
        combined=np.stack([half.combined for half in halves]),
        direct=np.stack(directs),
        diffuse=np.stack([half.diffuse_indirect for half in halves]),
        glossy=np.stack([half.glossy_indirect for half in halves]),
        depth=geometry.gbuffer.depth,
        seconds=time.perf_counter() - begun,
    )
