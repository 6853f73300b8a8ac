# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through a depth field: which surface does each one meet?

A ray is a straight line in (x, y, q). It walks the level-0 cells that it crosses, without the origin's own.
With h = q_ray - q_front inside a cell (linear, like both terms), and the slab reaching `slab` behind the
front:

- h > 0 on entry, h <= 0 on exit: it meets the front from outside. Facing it: HIT at the crossing.
- -slab <= h <= 0 on entry: it is inside. No deeper than `reach` (the step between two pixels of one
  surface) and facing the surface: HIT on entry; otherwise BLOCKED.
- h < -slab on entry, h >= -slab on exit: it enters from behind, BLOCKED.
- otherwise it passes in front or behind and goes on.

Within two pixels of the origin a front that faces away is self-contact and is passed over, and within one
pixel `reach` is larger by half the tilt of the origin's own patch: where two surfaces meet inside the
origin's pixel, the ray has met the second one untested.
A ray that reaches its vanishing point inside a background cell ESCAPES; any other end is UNKNOWN.

The pyramid skips cells that the ray passes wholly in front of (nearest) or wholly behind (farthest); the
farthest bound is what keeps rays with finite thickness from crawling behind every foreground object.
"""

from __future__ import annotations

import numpy as np

from .depth_field import DepthField
from .field_stack import FieldStack
from .screen_rays import BLOCKED, ESCAPED, HIT, UNKNOWN, ScreenRays, TraceResult, project_rays
from .types import FloatArray
from .walk import Walk

__all__ = [
    "BLOCKED",
    "ESCAPED",
    "HIT",
    "UNKNOWN",
    "ScreenRays",
    "TraceResult",
    "project_rays",
    "trace_rays",
    "trace_visitors",
]


def trace_rays(
    field: DepthField,
    origin_vs: FloatArray,
    direction_vs: FloatArray,
    *,
    max_distance: float | FloatArray = np.inf,
    starts_on_surface: bool = True,
) -> TraceResult:
    """Find the first surface of the field along each ray.

    Parameters
    ----------
    field
        Slabs and pyramid; one built with ``max_level=0`` gives the linear walk and the same hits.
    origin_vs, direction_vs : (3, N)
        View-space origins and directions, one row per component; perspective origins in front of the camera.
    max_distance : float or (N,)
        In units of the directions' length.
    starts_on_surface
        The rays leave surfaces of this field: the cell under an origin is not tested, and what faces away
        beside it is self-contact. False for rays that come from elsewhere.

    Returns
    -------
    TraceResult
        In the order of the rays.
    """
    count = origin_vs.shape[1]
    result = TraceResult.empty(count, origin_vs.dtype)
    rays = project_rays(field, origin_vs, direction_vs, max_distance)
    Walk(FieldStack([field]), rays, direction_vs, starts_on_surface, result).run()
    return result


def trace_visitors(stack: FieldStack, rays: ScreenRays, direction_vs: FloatArray) -> TraceResult:
    """Find the first surface along rays that come from elsewhere, each in its own field of the stack.

    Parameters
    ----------
    stack
        Fields of one size.
    rays
        By `project_rays`, with the index of each ray's field.
    direction_vs : (3, N)
        In the view space of each ray's field.

    Returns
    -------
    TraceResult
        ``pixel`` counts through all fields of the stack.
    """
    result = TraceResult.empty(direction_vs.shape[1], direction_vs.dtype)
    Walk(stack, rays, direction_vs, False, result).run()
    return result
