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
from .types import BoolArray, FloatArray

# A neighbour so many footprints off a pixel's plane, or whose normal has less cosine, is another surface's.
_OFF_PLANE, _SAME_NORMAL = 1.0, 0.9
# So many of the eight neighbours may be brighter, and as many darker: on a line of dots each has two.
_OUTLIERS = 2
_LEAST_LIGHT = 1e-6


def find_silhouettes(gbuffer: GBuffer, camera: Camera) -> BoolArray:
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


def without_outliers(light: FloatArray, color: FloatArray, is_silhouette: BoolArray) -> FloatArray:
    """Return light (H, W, 3) that makes no dots and no holes of its colour at silhouettes.

    Light times colour is neither brighter than the third brightest of the eight pixels around it nor darker
    than the third darkest: a trimmed range, as of rank-order filters.

    Parameters
    ----------
    light, color : (H, W, 3)
        Indirect light, and the colour that it is multiplied by.
    is_silhouette : (H, W)
        The pixels to look at.
    """
    width = is_silhouette.shape[1]
    seen = np.pad(luminance(light * color), 1, mode="edge")
    pixel = np.flatnonzero(is_silhouette)
    row, column = np.divmod(pixel, width)
    corner = row * (width + 2) + column
    steps = [down * (width + 2) + right for down, right in np.ndindex(3, 3) if (down, right) != (1, 1)]
    around = np.stack([seen.reshape(-1).take(corner + step) for step in steps])
    around.partition((_OUTLIERS, 7 - _OUTLIERS), axis=0)
    own = seen.reshape(-1).take(corner + width + 3)
    target = np.clip(own, around[_OUTLIERS], around[7 - _OUTLIERS])
    scale = np.where(own > _LEAST_LIGHT, target / np.maximum(own, _LEAST_LIGHT), 1.0)
    settled = light.copy()
    settled.reshape(-1, 3)[pixel] *= scale.astype(light.dtype)[:, None]
    return settled


def _shifted(axis: int, part: slice) -> tuple[slice, slice]:
    return (part, slice(None)) if axis == 0 else (slice(None), part)
