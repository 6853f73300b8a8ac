# SPDX-License-Identifier: GPL-3.0-or-later
"""Light where surfaces end: pixels there are a mixture of two, whose passes need not fit together.

Depth is that of one sample, colours and normals are means over all of them: the light of one surface times
the colour of another makes dots and holes that neither has.
"""

from __future__ import annotations

import numpy as np

from .camera import Camera
from .frame_points import surface_points
from .gbuffer import GBuffer
from .light import luminance
from .types import BoolArray, FloatArray, IntArray

# A neighbour so many footprints off a pixel's plane, or whose normal has less cosine, is another surface's.
_OFF_PLANE, _SAME_NORMAL = 1.0, 0.9
# Weight of the light of mixed pixels beside that of others.
_MIXED = 0.3
# So many of the eight neighbours may be brighter, and as many darker: on a line of dots each has two.
_OUTLIERS = 2
# Less colour than this is none.
_LEAST_COLOR = 1e-6
# What is so many times darker than its neighbours has no light of its own to be scaled.
_LEAST_SHARE = 1e-6


def find_surface_edges(gbuffer: GBuffer, camera: Camera) -> BoolArray:
    """Return which pixels (H, W) have a neighbour beside, above or below of another surface."""
    shape = gbuffer.shape
    with np.errstate(invalid="ignore"):
        position, normal = surface_points(gbuffer, camera, np.arange(gbuffer.depth.size))
    background = gbuffer.is_background
    position[:, background.reshape(-1)] = 0.0
    position, normal = position.reshape(3, *shape), normal.reshape(3, *shape)
    footprint = 1.0 / max(camera.fx, camera.fy)
    limit = np.full(shape, footprint, dtype=position.dtype)
    if not camera.is_orthographic:
        limit *= -position[2]
    limit *= _OFF_PLANE
    found = np.zeros(shape, dtype=np.bool_)
    for axis in (0, 1):
        here, there = (_shifted(axis, part) for part in (slice(None, -1), slice(1, None)))
        apart = position[:, *there] - position[:, *here]
        (ax, ay, az), (bx, by, bz) = normal[:, *here], normal[:, *there]
        off = np.abs(ax * apart[0] + ay * apart[1] + az * apart[2])
        is_other = off > limit[here]
        is_other |= np.abs(bx * apart[0] + by * apart[1] + bz * apart[2]) > limit[here]
        is_other |= ax * bx + ay * by + az * bz < _SAME_NORMAL
        found[here] |= is_other
        found[there] |= is_other
    found &= ~background
    return found


def settle_silhouettes(light: FloatArray, color: FloatArray, is_silhouette: BoolArray) -> FloatArray:
    """Return light (H, W, 3) that fits the colour it is multiplied by where both are of mixtures.

    A mixed pixel takes the mean of the light around it, weighted by the colours there: the part of its colour
    that is a mirror's gets the mirror's light. Light times colour is then neither brighter than the third
    brightest of the eight pixels around it nor darker than the third darkest: a trimmed range, as of
    rank-order filters.

    Parameters
    ----------
    light, color : (H, W, 3)
        Indirect light, and the colour that it is multiplied by.
    is_silhouette : (H, W)
        The pixels to look at.
    """
    pixel = np.flatnonzero(is_silhouette)
    around = _Neighbours(pixel, is_silhouette.shape)
    settled = light.copy()
    flat = settled.reshape(-1, 3)
    flat[pixel] = _mean_by_color(light, color, is_silhouette, around, flat.take(pixel, axis=0))
    seen = np.sort(around.read(luminance(settled * color)[..., None])[..., 0], axis=0)
    own = luminance(flat.take(pixel, axis=0) * color.reshape(-1, 3).take(pixel, axis=0))
    target = np.clip(own, seen[_OUTLIERS], seen[7 - _OUTLIERS])
    is_lit = own > _LEAST_SHARE * target
    scale = np.where(is_lit, target / np.where(is_lit, own, 1.0), 1.0)
    flat[pixel] *= scale.astype(light.dtype)[:, None]
    return settled


def _mean_by_color(
    light: FloatArray, color: FloatArray, is_silhouette: BoolArray, around: _Neighbours, own: FloatArray
) -> FloatArray:
    """Return the mean light (P, 3) of pixels and their neighbours, or their `own` where all are black."""
    pixel = around.pixel
    weight = color * np.where(is_silhouette, _MIXED, 1.0).astype(color.dtype)[..., None]
    own_weight = weight.reshape(-1, 3).take(pixel, axis=0)
    total = own_weight + around.read(weight).sum(axis=0)
    mean = own_weight * own + around.read(weight * light).sum(axis=0)
    settled: FloatArray = np.where(total > _LEAST_COLOR, mean / np.maximum(total, _LEAST_COLOR), own)
    return settled


class _Neighbours:
    """Reads the eight pixels around each of some; beyond the border stand those at it."""

    def __init__(self, pixel: IntArray, shape: tuple[int, int]) -> None:
        self.pixel, (height, width) = pixel, shape
        row, column = np.divmod(pixel, width)
        self.rows = [np.clip(row + step, 0, height - 1) * width for step in (-1, 0, 1)]
        self.columns = [np.clip(column + step, 0, width - 1) for step in (-1, 0, 1)]

    def read(self, image: FloatArray) -> FloatArray:
        """Return values (8, P, C) of an image (H, W, C)."""
        flat = image.reshape(-1, image.shape[-1])
        steps = [step for step in np.ndindex(3, 3) if step != (1, 1)]
        return np.stack([flat.take(self.rows[down] + self.columns[right], axis=0) for down, right in steps])


def _shifted(axis: int, part: slice) -> tuple[slice, slice]:
    return (part, slice(None)) if axis == 0 else (slice(None), part)
