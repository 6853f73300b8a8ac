# SPDX-License-Identifier: GPL-3.0-or-later
"""How thick the visible surfaces are, from the surface that stands behind each of them.

Where a thing is closed, its back face follows its front. Scenes hold much else: sheets of paper and single
planes for walls, things that stick in other things, and normals that point inward. Which of them a pixel
shows is a guess, and a wrong guess must not be worse than none: it never makes a surface thicker than the
relative heuristic would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .core import Camera, GBuffer, Settings

FloatArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

# Surfaces of one thing that show their backs in more than this share of its pixels, and their fronts as well:
# it is a sheet, or its normals follow no rule.
_MIXED = 0.05
# Gaps below this share of the distance are filled: carpets, labels and covers lie on something.
_CLOSE = 0.02
# A sheet is this many times as thick as the steps between its pixels, so that no ray slips through.
_STEPS = 2.0
# Two renders send their samples through a pixel this far apart, pixels.
_JITTER_PX = 0.02
# Slope of a plane that is seen edge-on, scene units per pixel: sums of it are still numbers.
_STEEPEST = 1e30
# Rounding of a depth, relative.
_ROUNDING = 1e-5


@dataclass(frozen=True, eq=False)
class SurfaceIdentity:
    """Which surface each pixel of a render met.

    Attributes
    ----------
    is_known : (H, W) bool
        The rest means something here.
    is_back : (H, W) bool
        The surface's normal points away from the camera.
    material : (H, W) int64
        Number of its material.
    thing : (H, W) float32
        Number of its object.
    """

    is_known: BoolArray
    is_back: BoolArray
    material: IntArray
    thing: FloatArray


class Orientation:
    """How often things show their backs, over all pixels of several views.

    Parameters
    ----------
    numbers
        What tells things apart, one array (H, W) per view: `SurfaceIdentity.thing` or `.material`.
    surfaces
        What the views see first.
    """

    def __init__(self, numbers: Sequence[NDArray[Any]], surfaces: Sequence[SurfaceIdentity]) -> None:
        known = [surface.is_known for surface in surfaces]
        of_pixels = np.concatenate([number[here] for number, here in zip(numbers, known, strict=True)])
        is_back = np.concatenate(
            [surface.is_back[here] for surface, here in zip(surfaces, known, strict=True)]
        )
        self._things, index, pixels = np.unique(of_pixels, return_inverse=True, return_counts=True)
        self._share = np.bincount(index, is_back, self._things.size) / pixels

    def share(self, numbers: NDArray[Any]) -> NDArray[np.float64]:
        """Return the share of backs for each number, 0 for things that no view shows."""
        if not self._things.size:
            return np.zeros(numbers.shape)
        place = np.minimum(np.searchsorted(self._things, numbers), self._things.size - 1)
        return np.where(self._things[place] == numbers, self._share[place], 0.0)

    def mostly_backs(self) -> frozenset[int]:
        """Return the numbers whose back faces are the front."""
        return frozenset(int(thing) for thing in self._things[self._share > 0.5])


def thickness_of(
    gbuffer: GBuffer,
    camera: Camera,
    second_depth: FloatArray,
    first: SurfaceIdentity,
    second: SurfaceIdentity,
    things: Orientation,
) -> FloatArray:
    """Return the thickness (H, W) of visible surfaces, as in `GBuffer.thickness`.

    - The back of the same object behind its front: exactly what lies between them.
    - A back behind a front, but of another object, or of one that shows both sides: what lies between them,
      or the heuristic's thickness where that is less.
    - Two fronts, or nothing behind: a sheet, as thin as the steps between its pixels allow. Small gaps are
      filled.
    - Where the first surface could not be looked through: the heuristic's.

    Parameters
    ----------
    gbuffer, camera
        The visible surfaces.
    second_depth : (H, W)
        Of the next surface along each pixel's ray, whichever way it faces; +inf where there is none.
    first, second
        The surface that was looked through, and the next one.
    things
        By `SurfaceIdentity.thing`.
    """
    depth = np.where(gbuffer.is_background, np.float32(1.0), gbuffer.depth)
    heuristic = Settings().thickness * _extent(depth, camera)
    sheet = _sheet(gbuffer, camera, depth, heuristic)
    is_peeled = is_beyond(second_depth, depth, gbuffer, camera) & first.is_known
    gap = np.where(is_peeled, second_depth - depth, np.float32(np.inf))

    share = things.share(first.thing)
    is_mixed = np.minimum(share, 1.0 - share) > _MIXED
    faces_as_its_thing = first.is_back == (share > 0.5)
    is_turned = np.isfinite(gap) & (~second.is_known | (first.is_back != second.is_back))
    is_own_back = is_turned & second.is_known & (first.thing == second.thing) & faces_as_its_thing & ~is_mixed
    thickness = np.select(
        [~is_peeled, is_own_back, is_turned, gap <= _CLOSE * _extent(depth, camera)],
        [heuristic, gap, np.minimum(gap, heuristic), np.maximum(gap, sheet)],
        sheet,
    )
    return np.where(gbuffer.is_background, 0.0, thickness).astype(np.float32)


def is_beyond(depth: FloatArray, front: FloatArray, gbuffer: GBuffer, camera: Camera) -> BoolArray:
    """Return (H, W) where one depth lies farther away than another one, as another surface does.

    Two surfaces closer than the samples' jitter tells apart count as one.

    Parameters
    ----------
    depth, front : (H, W)
        Two depths in each pixel.
    gbuffer, camera
        The visible surfaces, whose tilt says what jitter does to a depth.
    """
    extent = _extent(front, camera)
    margin = np.minimum(_JITTER_PX * _slope(gbuffer, camera, front).sum(axis=0), _CLOSE * extent)
    beyond: BoolArray = (depth > front + margin + _ROUNDING * extent) & ~gbuffer.is_background
    return beyond


def _extent(depth: FloatArray, camera: Camera) -> FloatArray:
    """Return what thickness is relative to: depth, or the width of an orthographic view."""
    return np.full_like(depth, camera.width / camera.fx) if camera.is_orthographic else depth


def _slope(gbuffer: GBuffer, camera: Camera, depth: FloatArray) -> FloatArray:
    """Return by how much the depth of each pixel's plane changes from pixel to pixel, (2, H, W): x and y."""
    y, x = np.mgrid[: camera.height, : camera.width].astype(np.float32) + 0.5
    toward = np.array([0.0, 0.0, -1.0], dtype=np.float32)
    if not camera.is_orthographic:
        toward = camera.pixel_to_view(x, y, np.ones_like(x))  # at depth 1
    facing = np.abs((gbuffer.normal * toward).sum(axis=-1))
    pixel = depth if not camera.is_orthographic else np.ones_like(depth)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = [
            pixel / focal * np.abs(gbuffer.normal[..., axis]) / facing
            for axis, focal in enumerate((camera.fx, camera.fy))
        ]
    return np.nan_to_num(np.stack(slopes), nan=0.0, posinf=_STEEPEST).astype(np.float32)


def _sheet(gbuffer: GBuffer, camera: Camera, depth: FloatArray, heuristic: FloatArray) -> FloatArray:
    """Return the thickness that holds the pixels of a sheet together.

    Neighbours belong to it that lie close, or where its plane says.
    """
    steps = np.zeros_like(depth)
    slopes = _slope(gbuffer, camera, depth)
    for axis, slope in ((1, slopes[0]), (0, slopes[1])):
        reach = np.maximum(_CLOSE * _extent(depth, camera), _STEPS * slope)
        with np.errstate(invalid="ignore"):  # between two pixels of background
            difference = np.abs(np.diff(gbuffer.depth, axis=axis))
        for there in (slice(None, -1), slice(1, None)):
            here = (slice(None), there) if axis == 1 else (there, slice(None))
            step = np.where(difference <= reach[here], difference, np.float32(0.0))
            steps[here] = np.maximum(steps[here], step)
    footprint = (1.0 if camera.is_orthographic else depth) / min(camera.fx, camera.fy)
    return np.minimum(np.maximum(_STEPS * steps, footprint), heuristic)
