# SPDX-License-Identifier: GPL-3.0-or-later
"""Prepare a shot: capture at a few key frames what all of its frames share."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core import Fill
from ..files import check_writable, discard_abandoned
from ..job_options import JobOptions
from ..prepared import FILE, KeyFrame, Shot, Tuned, write_shot
from ..recipe import Recipe
from .capture import CaptureOptions, capture_frame
from .kept_world import KeptWorld
from .one_frame import capture_options, made_with, part, versions
from .render_settings import borrow_kept_data, find_view_layer
from .restore import Restorer
from .scene_file import content_hash, opened_scene

Progress = Callable[[float, str], None]

# A frame renders a quarter of its fill where the fills of the others cover this share of each key frame's.
# What they miss, the quarter still brings (ADR 25).
_COVERED, _SHARE = 0.9, 0.25
# What is captured once may take more time: so many times the fill's samples, and no budget (ADR 25).
_KEY_SAMPLES = 4.0
# Seeds of the key frames' noise, which must be no frame's own.
_FIRST_SEED = 1 << 20


def prepare_shot(
    scene_path: Path | None, options: JobOptions, keys: int, progress: Progress | None = None
) -> Shot:
    """Capture what the frames of a shot share, and write it.

    Parameters
    ----------
    scene_path
        The .blend file; None means the open scene.
    options
        As the frames are rendered; `output` is where the captures go. A shot that is there already, of the
        same options, is left as it is, whatever its key frames: frames may have been rendered with it.
    keys
        How many key frames to choose of the options' frames.
    progress
        Called with a fraction and a text; may raise to stop.

    Raises
    ------
    SSGIError
        If the scene cannot be opened or captured, the captures cannot be written, or those of other options
        are there and `overwrite` is off.
    """
    check_writable(options.output)
    scene = opened_scene(scene_path, enable_autoexec=options.enable_autoexec)
    recipe = shot_recipe(scene, options, content_hash())
    discard_abandoned(options.output)
    if (options.output / FILE).exists() and not options.overwrite:
        shot = Shot(options.output)
        shot.refuse_others(recipe)
        return shot
    frames = options.frames or tuple(range(scene.frame_start, scene.frame_end + 1))
    return _prepare(scene, options, key_frames(frames, keys), recipe, progress)


def key_frames(frames: Sequence[int], count: int) -> list[int]:
    """Return so many of the frames, spread evenly, the first and the last with them."""
    places = np.linspace(0, len(frames) - 1, min(count, len(frames)))
    return [frames[round(place)] for place in places]


def shot_recipe(scene: bpy.types.Scene, options: JobOptions, scene_files: str | None) -> dict[str, Any]:
    """Return what a shot is prepared for: the recipe of its frames, which does not know the shot yet."""
    recipe = made_with(scene, find_view_layer(scene), options, scene_files)
    return {name: value for name, value in recipe.items() if name not in ("shot", "keep_world")}


class _KeyWorld(KeptWorld):
    """Takes down what is captured at a key frame; goes on with the views of the one before where they do."""

    def __init__(self) -> None:
        super().__init__()
        self.fill_share = _KEY_SAMPLES
        self.fill: Fill | None = None

    def averaged(self, fill: Fill) -> Fill:
        self.fill = fill
        return fill

    @property
    def world(self) -> bytes:
        """Hash of the state that was looked at last."""
        return self._state


def _prepare(
    scene: bpy.types.Scene, options: JobOptions, frames: list[int], recipe: Recipe, progress: Progress | None
) -> Shot:
    begun = time.perf_counter()
    world, keys = _KeyWorld(), []
    with Restorer() as restorer:
        borrow_kept_data(restorer, scene, options.engine)
        for index, frame in enumerate(frames):
            if options.engine == "cycles":
                restorer.change(scene.cycles, seed=_FIRST_SEED + index, use_animated_seed=False)
            world.fill = None
            step = part(progress, index / len(frames), 1.0 / len(frames))
            captured = capture_frame(scene, _key_options(scene, options, frame), step, world)
            keys.append(
                KeyFrame(frame, world.world, world.fill, captured.views, captured.view_names, world.lost)
            )
    told = {"versions": versions(), "seconds": {"total": time.perf_counter() - begun}}
    write_shot(options.output, keys, tuned(keys), recipe, told)
    return Shot(options.output)


def _key_options(scene: bpy.types.Scene, options: JobOptions, frame: int) -> CaptureOptions:
    """Return what is captured of a key frame, whose own light nobody looks at."""
    wanted = capture_options(scene, options, frame)
    return replace(
        wanted,
        samples=1,
        denoiser="none",
        view_denoiser=wanted.view_denoiser or wanted.denoiser,
        keep_passes=False,
        budget=math.inf,
    )


def tuned(keys: Sequence[KeyFrame]) -> Tuned:
    """Decide how much of its fill each frame renders itself."""
    covered = min((_covered(key, keys) for key in keys), default=0.0)
    return Tuned(_SHARE if covered >= _COVERED else 1.0, covered)


def _covered(key: KeyFrame, keys: Sequence[KeyFrame]) -> float:
    """Return the share of a key frame's fill to which those of the others bring as many light paths."""
    others = [other.fill for other in keys if other is not key and other.fill and other.world == key.world]
    if key.fill is None or not others:
        return 0.0
    surfaces = ~key.fill.surfaces.is_background
    if not surfaces.any():
        return 1.0
    of_others = Fill.merged([*others, key.fill]).samples - key.fill.samples
    return float((of_others[surfaces] >= key.fill.samples[surfaces]).mean())
