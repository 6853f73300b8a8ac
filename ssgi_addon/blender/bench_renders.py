# SPDX-License-Identifier: GPL-3.0-or-later
"""One timed render of a method of the benchmark: Cycles, EEVEE, or our own job."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bench.machine import peak_memory_since
from ..bench.methods import Method
from ..results import Picture
from . import compat
from .cycles_passes import CYCLES, render_passes
from .eevee_passes import render_eevee_passes
from .kept_world import KeptWorld
from .one_frame import make_picture
from .render_settings import borrow_denoiser, borrow_passes, borrow_scene
from .restore import Restorer

FloatArray = NDArray[np.float32]
Size = tuple[int, int]

INDIRECT = ("Diffuse Indirect", "Glossy Indirect")
# What `borrow_denoiser` calls those of the methods.
_DENOISERS = {"raw": "none", "fastest": "fast", "best": "accurate"}


@dataclass(frozen=True, eq=False)
class Run:
    """One run: its picture and what it cost.

    Attributes
    ----------
    combined : (H, W, 3)
        The finished picture, scene-linear.
    seconds
        From the open scene to the picture in memory.
    memory_mb
        Largest resident size of the process in that time.
    layers
        Further passes by Blender's names, where asked for.
    picture
        Ours alone.
    """

    combined: FloatArray
    seconds: float
    memory_mb: float | None = None
    layers: dict[str, FloatArray] = field(default_factory=dict)
    picture: Picture | None = None


def borrow_bench(restorer: Restorer, scene: bpy.types.Scene, size: Size, engine_id: str = CYCLES) -> None:
    """Keep the scene resident in the engine, and free of shortcuts that bias it, until `restorer` closes.

    All methods of one engine run inside: none pays for building a scene that another one's settings freed.
    """
    borrow_scene(restorer, scene, resolution=size, engine_id=engine_id)
    restorer.change(scene.render, use_persistent_data=True)
    if engine_id == CYCLES:
        borrow_unbiased(restorer, scene)


def borrow_unbiased(restorer: Restorer, scene: bpy.types.Scene) -> None:
    """Switch off what makes Cycles' light darker than it is, and let all use one denoiser."""
    restorer.change(
        scene.cycles, sample_clamp_direct=0.0, sample_clamp_indirect=0.0, light_sampling_threshold=0.0
    )
    if compat.has_denoiser(scene):
        restorer.change(scene.cycles, denoiser="OPENIMAGEDENOISE", denoising_input_passes="RGB_ALBEDO_NORMAL")


def why_not(scene: bpy.types.Scene, method: Method, missing_gl: str | None) -> str | None:
    """Say why a method cannot run here; None where it can."""
    if method.kind == "eevee" and missing_gl is not None:
        return f"EEVEE cannot render here: {missing_gl}"
    if method.denoiser != "raw" and not compat.has_denoiser(scene):
        return "this build of Blender has no denoiser"
    return None


def run_method(
    scene: bpy.types.Scene,
    method: Method,
    size: Size,
    *,
    passes: Sequence[str] = (),
    samples: int | None = None,
    seed: int = 0,
    kept: KeptWorld | None = None,
) -> Run:
    """Run a method once.

    Parameters
    ----------
    scene
        Set up by `borrow_bench`; exactly as before afterwards, also after an error.
    method
        What to run.
    size
        Width and height, pixels.
    passes
        Passes that Cycles is to return besides its picture.
    samples
        Other than the method's, of Cycles.
    seed
        Of Cycles' noise.
    kept
        What earlier frames captured, for ours.

    Raises
    ------
    SSGIError
        If the scene cannot be rendered.
    """
    if samples is not None:
        method = replace(method, samples=samples)
    peak_memory_since(reset=True)
    with Restorer() as restorer:
        begun = time.perf_counter()
        if method.kind == "ours":
            restorer.change(scene.cycles, seed=seed, use_animated_seed=False)
            picture, _ = make_picture(scene, method.job_options(size), kept=kept)
            run = Run(picture.combined, 0.0, picture=picture)
        elif method.kind == "cycles":
            layers = _render_cycles(restorer, scene, method, size, seed, ("Combined", *passes))
            run = Run(layers["Combined"], 0.0, layers=layers)
        else:
            run = Run(_render_eevee(restorer, scene, method, size), 0.0)
        seconds = time.perf_counter() - begun
    return replace(run, seconds=seconds, memory_mb=peak_memory_since(reset=False))


def _render_cycles(
    restorer: Restorer,
    scene: bpy.types.Scene,
    method: Method,
    size: Size,
    seed: int,
    passes: tuple[str, ...],
) -> dict[str, FloatArray]:
    view_layer = borrow_scene(restorer, scene, resolution=size)
    restorer.change(scene.cycles, samples=method.samples, seed=seed, use_animated_seed=False)
    if method.light == "direct":
        restorer.change(scene.cycles, diffuse_bounces=0, glossy_bounces=0)
    if method.light == "fast gi":
        restorer.change(scene.cycles, use_fast_gi=True)
    borrow_denoiser(restorer, scene, view_layer, _DENOISERS[method.denoiser])
    borrow_passes(restorer, view_layer, passes)
    return render_passes(scene, view_layer, passes).layers


def _render_eevee(restorer: Restorer, scene: bpy.types.Scene, method: Method, size: Size) -> FloatArray:
    view_layer = borrow_scene(restorer, scene, resolution=size, engine_id=compat.eevee_engine_id())
    restorer.change(
        scene.eevee, taa_render_samples=method.samples, use_raytracing=method.light == "raytracing"
    )
    return render_eevee_passes(scene, view_layer, ("Combined",)).layers["Combined"]


def kind_of_state(method: Method) -> tuple[Any, ...]:
    """Return what methods share that leave a scene in the engine alike, so that one warms the other."""
    if method.kind != "ours":
        return method.kind, method.light, method.denoiser
    captures = [(name, value) for name, value in method.changes if "." not in name]
    return method.kind, method.preset, *captures
