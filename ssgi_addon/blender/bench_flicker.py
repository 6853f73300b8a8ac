# SPDX-License-Identifier: GPL-3.0-or-later
"""What flickers: the frame-to-frame change of a picture's error while the camera moves slowly."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..bench.methods import Method
from ..bench.options import BenchOptions
from ..bench.scores import flicker
from ..bench.store import SceneState, digest, method_key, scene_folder
from ..bench.tasks import Task
from ..files import replacing
from .bench_reference import render_best
from .bench_renders import borrow_bench, run_method
from .capture import CaptureOptions, capture_frame
from .kept_world import KeptWorld
from .restore import Restorer

FloatArray = NDArray[np.float32]

FRAMES = 10
REFERENCE_SAMPLES = 64
# Half of the size each way: ten references would take longer than all else
SHRINK = 2
# Of the camera from frame to frame: about a pixel and a half of such a frame, and some parallax.
PAN_DEGREES = 0.3
SIDEWAYS = 0.002  # times the distance of what it looks at


def measure_flicker(
    scene: bpy.types.Scene, task: Task, state: SceneState, progress: Callable[[float, str], None]
) -> None:
    """Render ten frames of a camera move by each preset and by Cycles' fastest ways; keep what flickers.

    Parameters
    ----------
    scene
        Open; exactly as before afterwards, also after an error.
    task
        Of the run.
    state
        Gets ``flicker``, and is saved after each method.
    progress
        Called with a fraction and a text.

    Raises
    ------
    SSGIError
        If the scene cannot be rendered, or a result cannot be written.
    """
    options = task.options
    width, height = (max(1, side // SHRINK) for side in options.resolution)
    found = state.flicker.setdefault("methods", {})
    state.flicker |= {"frames": FRAMES, "resolution": [width, height], "reference_samples": REFERENCE_SAMPLES}
    methods = [method for method in task.methods() if method.headline and method.light != "direct"]
    keys = {method.name: method_key(method, state.key, options) for method in methods}
    pending = [method for method in methods if found.get(method.name, {}).get("key") != keys[method.name]]
    if not pending:
        return
    with Restorer() as restorer:
        borrow_bench(restorer, scene, (width, height))
        distance = _distance(scene, (width, height))
        move = CameraMove(restorer, scene, distance)
        references = _references(scene, move, state.key, options, (width, height), progress)
        for index, method in enumerate(pending):
            if time.time() > task.deadline:
                state.left_out[f"flicker of {method.name}"] = "the time was up"
                continue
            progress(0.5 + 0.5 * index / len(pending), f"Flicker of {method.name}")
            images, seconds = _film(scene, move, method, (width, height))
            rms = flicker(images, references, scene.view_settings.exposure)
            found[method.name] = {"key": keys[method.name], "rms": rms, "seconds": seconds}
            state.save(scene_folder(options, state.name))


class CameraMove:
    """A camera that pans and slides from where the scene's own stands, which it stands in for."""

    def __init__(self, restorer: Restorer, scene: bpy.types.Scene, distance: float) -> None:
        data = scene.camera.data
        self.start = scene.camera.matrix_world.copy()
        self.distance = distance
        # Without the animation, parents and constraints of the scene's camera
        self.camera = bpy.data.objects.new("SSGI Bench", data)
        restorer.callback(bpy.data.objects.remove, self.camera)
        for marker in scene.timeline_markers:
            restorer.change(marker, camera=None)
        restorer.change(scene, camera=self.camera)

    def __iter__(self) -> Iterator[int]:
        """Put the camera to each frame's place in turn."""
        for frame in range(FRAMES):
            slide = Matrix.Translation((frame * SIDEWAYS * self.distance, 0.0, 0.0))
            pan = Matrix.Rotation(math.radians(frame * PAN_DEGREES), 4, "Y")
            self.camera.matrix_world = self.start @ slide @ pan
            yield frame


def _distance(scene: bpy.types.Scene, size: tuple[int, int]) -> float:
    """Return how far it is to what the camera looks at, half of the pixels nearer than that."""
    options = CaptureOptions(samples=1, denoiser="none", resolution=size)
    depth = capture_frame(scene, options).gbuffer.depth
    seen = depth[np.isfinite(depth)]
    return float(np.median(seen)) if seen.size else 1.0


def _film(
    scene: bpy.types.Scene, move: CameraMove, method: Method, size: tuple[int, int]
) -> tuple[FloatArray, float]:
    """Return all frames by one method and the mean seconds of those after the first."""
    kept = KeptWorld() if method.kind == "ours" else None
    runs = [run_method(scene, method, size, seed=frame, kept=kept) for frame in move]
    seconds = [run.seconds for run in runs]
    return np.stack([run.combined for run in runs]), float(np.mean(seconds[1:]))


def _references(
    scene: bpy.types.Scene,
    move: CameraMove,
    key: str,
    options: BenchOptions,
    size: tuple[int, int],
    progress: Callable[[float, str], None],
) -> FloatArray:
    name = digest(key, size, FRAMES, REFERENCE_SAMPLES, PAN_DEGREES, SIDEWAYS, bpy.app.version_string)
    path: Path = options.reference_folder / f"{name}.npy"
    if path.is_file():
        return np.load(path)
    frames = []
    for frame in move:
        progress(0.5 * frame / FRAMES, f"Reference of frame {frame + 1} of {FRAMES}")
        frames.append(render_best(scene, size, REFERENCE_SAMPLES, frame).combined)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, np.stack(frames))
    return np.stack(frames)
