# SPDX-License-Identifier: GPL-3.0-or-later
"""Capture what stands behind the visible surfaces: their back faces, and the layer behind with its light."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..blender_passes import FARTHEST_SURFACE
from ..core import Camera, GBuffer
from ..thickness import Orientation, SurfaceIdentity, is_beyond, thickness_of
from .engines import Engine
from .gbuffer import GEOMETRY_PASSES, gbuffer_from_passes
from .peel import borrow_layer_behind, borrow_second_surface
from .render_settings import borrow_passes, borrow_pixel_centers
from .restore import Restorer
from .roughness import borrow_roughness
from .volumes import borrow_clear_air

FloatArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
View = tuple[GBuffer, Camera]
Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Take:
    """Views that were captured one after another with one set-up, and can be rendered so again.

    Attributes
    ----------
    views
        G-buffers and cameras.
    aim
        Points the scene's camera at each view in turn, step by step of the iterator that it returns.
    samples
        Per pixel, of the light in the layer behind.
    """

    views: tuple[View, ...]
    aim: Callable[[Restorer], Iterator[None]]
    samples: int


def add_hidden_surfaces(
    engine: Engine,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    takes: Sequence[Take],
    *,
    back_faces: bool,
    behind: bool,
    denoiser: str,
    progress: Progress,
) -> tuple[list[tuple[View, ...]], Mapping[str, float]]:
    """Return the views with the thickness of what they show, and with the layer behind it.

    Two rounds of renders, since materials are edited once for all views of a round: one sample of the next
    surface behind the first, which tells back faces and how things are oriented, and the light of the layer
    behind. Both through pixel centres and without volumes, as the faces of a surround.

    Parameters
    ----------
    engine
        Cycles.
    scene, view_layer
        Set up by `borrow_scene`; exactly as before afterwards, also after an error.
    takes
        All views.
    back_faces, behind
        Which of the two to add.
    denoiser
        Of the light, as in `CaptureOptions`.
    progress
        Called with a fraction and a text before each render; an exception from it ends the capture.

    Returns
    -------
    views
        Of each take.
    seconds
        Wall time of each round that was wanted, ``"back faces"`` and ``"behind"``. A layer behind needs
        the first round, too: its time counts as `behind` where no thickness is wanted.
    """
    start = time.perf_counter()
    count = sum(len(take.views) for take in takes) * (2 if behind else 1)
    told = iter(range(count))

    def tell(text: str) -> None:
        progress(next(told) / count, text)

    seconds = {}
    second = _second_surfaces(engine, scene, view_layer, takes, lambda: tell("Back faces"))
    views = [take.views for take in takes]
    if back_faces:
        views = _with_thickness(views, second)
        seconds["back faces"] = time.perf_counter() - start
        start = time.perf_counter()
    if behind:
        layers = _layers_behind(
            engine, scene, view_layer, takes, second, denoiser, lambda: tell("Layer behind")
        )
        views = [
            tuple(
                (replace(gbuffer, behind=layer), camera)
                for (gbuffer, camera), layer in zip(*pair, strict=True)
            )
            for pair in zip(views, layers, strict=True)
        ]
        seconds["behind"] = time.perf_counter() - start
    return views, seconds


@dataclass(frozen=True, eq=False)
class _SecondSurface:
    """What one view shows once its first surface is looked through."""

    depth: FloatArray
    first: SurfaceIdentity
    second: SurfaceIdentity


def _second_surfaces(
    engine: Engine,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    takes: Sequence[Take],
    tell: Callable[[], None],
) -> list[list[_SecondSurface]]:
    with Restorer() as restorer:
        engine.borrow_geometry(restorer, scene, view_layer)
        borrow_clear_air(restorer, view_layer)
        first, second = borrow_second_surface(restorer, view_layer)
        names = ("Depth", *first.names, *second.names)
        borrow_passes(restorer, view_layer, names)

        def capture(take: Take) -> Iterator[_SecondSurface]:
            with Restorer() as aimed:
                borrow_pixel_centers(aimed, scene)
                for _ in take.aim(aimed):
                    tell()
                    layers = engine.render(scene, view_layer, names).layers
                    yield _SecondSurface(_depth(layers), first.read(layers), second.read(layers))

        return [list(capture(take)) for take in takes]


def _layers_behind(
    engine: Engine,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    takes: Sequence[Take],
    second: Sequence[Sequence[_SecondSurface]],
    denoiser: str,
    tell: Callable[[], None],
) -> list[list[GBuffer]]:
    firsts = [found.first for found in _flat(second)]
    flipped = Orientation([first.material for first in firsts], firsts).mostly_backs()
    with Restorer() as restorer:
        borrow_clear_air(restorer, view_layer)
        borrow_layer_behind(restorer, view_layer, flipped)
        roughness = borrow_roughness(restorer, view_layer)  # sees which surfaces are looked through
        names = (*GEOMETRY_PASSES, *engine.light_passes, *roughness.passes)
        borrow_passes(restorer, view_layer, names)

        def capture(take: Take, surfaces: Sequence[_SecondSurface]) -> Iterator[GBuffer]:
            with Restorer() as aimed:
                is_denoised = engine.borrow_light(aimed, scene, view_layer, take.samples, denoiser)
                borrow_pixel_centers(aimed, scene)
                for (front, camera), passed, _ in zip(take.views, surfaces, take.aim(aimed), strict=True):
                    tell()
                    layers = engine.render(scene, view_layer, names).layers
                    behind = gbuffer_from_passes(
                        layers, roughness.read(layers), camera, is_denoised=is_denoised
                    )
                    is_there = _is_beyond_passed(behind.depth, front, camera, passed, flipped)
                    yield replace(behind, depth=np.where(is_there, behind.depth, np.float32(np.inf)))

        return [list(capture(*pair)) for pair in zip(takes, second, strict=True)]


def _is_beyond_passed(
    depth: FloatArray, front: GBuffer, camera: Camera, passed: _SecondSurface, flipped: frozenset[int]
) -> BoolArray:
    """Return where a depth is not the first surface's still, nor a back face's that is there twice."""
    is_turned = np.isin(passed.second.material, list(flipped))
    is_passed_back = passed.second.is_known & (passed.second.is_back != is_turned)
    is_passed_back &= np.isfinite(passed.depth)  # Cycles names a surface without opacity, but not where it is
    nearest = np.where(front.is_background, np.float32(1.0), front.depth)
    nearest = np.where(is_passed_back, np.maximum(nearest, passed.depth), nearest)
    return is_beyond(depth, nearest, front, camera)


def _with_thickness(
    views: Sequence[Sequence[View]], second: Sequence[Sequence[_SecondSurface]]
) -> list[tuple[View, ...]]:
    firsts = [found.first for found in _flat(second)]
    things = Orientation([first.thing for first in firsts], firsts)
    return [
        tuple(
            (
                replace(
                    gbuffer,
                    thickness=thickness_of(gbuffer, camera, found.depth, found.first, found.second, things),
                ),
                camera,
            )
            for (gbuffer, camera), found in zip(*pair, strict=True)
        )
        for pair in zip(views, second, strict=True)
    ]


def _flat(takes: Sequence[Sequence[_SecondSurface]]) -> list[_SecondSurface]:
    return [found for take in takes for found in take]


def _depth(layers: Mapping[str, FloatArray]) -> FloatArray:
    depth = layers["Depth"]
    return np.where(depth < FARTHEST_SURFACE, depth, np.float32(np.inf))
