# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample points near surfaces, tested against the depth buffer without following a ray.

As the first screen-space methods do: Mittring 2007, "Finding Next Gen: CryEngine 2" (SSAO, points of a
sphere, here of the half above the surface), and Ritschel, Grosch and Seidel 2009 (SSDO, one point per
direction, at a distance of its own). A point within a slab is blocked by that pixel's surface, every
other one is open. The paper of SSDO weighs the bounce by the sender's area and distance; directions that are
drawn by the cosine need no weight, each stands for its share of the hemisphere.
"""

from __future__ import annotations

import numpy as np

from . import tracer
from .answers import Answers
from .sampling import sample_square
from .scene import TraceScene
from .settings import Settings
from .types import FloatArray, IntArray

# Distances of points have another shift of the sequence than their directions.
_SEED_OFFSET = 0x5054


def test_points(
    scene: TraceScene,
    home: int,
    origin: FloatArray,
    direction: FloatArray,
    pixel: IntArray,
    settings: Settings,
) -> Answers:
    """Test a point along each of several directions from pixels of a view.

    Parameters
    ----------
    scene, home
        The view whose front layer is tested.
    origin, direction : (3, rays, P)
        View space; unit directions.
    pixel : (P,)
        Flat indices of the pixels that they start from.
    settings
        Radius and seed.

    Returns
    -------
    Answers
        Of rays x P points: HIT within a slab whose surface faces the direction, BLOCKED within any other,
        ESCAPED in the open, UNKNOWN outside the frame.
    """
    view = scene.views[home]
    field, camera = view.fields[0], view.camera
    rays, dtype = origin.shape[1], origin.dtype
    reach = settings.diffuse.radius * (camera.width / camera.fx if camera.is_orthographic else -origin[2])
    along, _ = sample_square(pixel, camera.width, rays, settings.seed + _SEED_OFFSET, dtype)
    distance = np.minimum(along * reach, settings.reach).ravel()
    direction = direction.reshape(3, -1)
    point = origin.reshape(3, -1) + direction * distance
    depth = -point[2]
    scale = 1.0 if camera.is_orthographic else 1.0 / np.where(depth > 0.0, depth, np.inf)
    x, y = camera.cx + camera.fx * point[0] * scale, camera.cy - camera.fy * point[1] * scale
    is_inside = (x >= 0.0) & (x < camera.width) & (y >= 0.0) & (y < camera.height)
    if not camera.is_orthographic:
        is_inside &= depth > 0.0
    column, row = (np.where(is_inside, at, 0.0).astype(np.int64) for at in (x, y))
    met = row * camera.width + column
    front, gx, gy, slab = field.planes.take(met, axis=0).T
    height = (-depth if camera.is_orthographic else scale) - front
    height -= gx * (x - column - 0.5) + gy * (y - row - 0.5)
    is_solid = is_inside & (height <= 0.0) & (height >= -slab) & (met != np.tile(pixel, rays))
    faces = (field.normal.take(met, axis=0).T * direction).sum(axis=0) < 0.0
    cases = [is_solid & faces, is_solid, is_inside]
    kinds = [np.int8(kind) for kind in (tracer.HIT, tracer.BLOCKED, tracer.ESCAPED)]
    status = np.select(cases, kinds, np.int8(tracer.UNKNOWN))
    is_hit = status == tracer.HIT
    texel = np.where(is_hit, met + view.offsets[0], scene.texels)
    return Answers(status, texel, np.where(is_hit, distance, np.inf).astype(dtype), x, y)
