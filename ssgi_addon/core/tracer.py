# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through a depth field: which surface does each one meet?

A ray is a straight line in (x, y, q). It walks the level-0 cells that it crosses, without the origin's own.
With h = q_ray - q_front inside a cell (linear, like both terms), and the slab reaching `slab` behind the
front:

- h > 0 on entry, h <= 0 on exit: it meets the front from outside. Facing it: HIT at the crossing.
- -slab <= h <= 0 on entry: it is inside. No deeper than `reach` (the step between two pixels of one
  surface) and facing the surface: HIT on entry; otherwise BLOCKED. Over an edge it meets a side that the
  camera does not see: `footprint` takes the place of `reach`, if that is more. At an edge the patch of the
  cell before lies farther than that of the cell, at the border between them, by more than `largest_step`.
- h < -slab on entry, h >= -slab on exit: it enters from behind, BLOCKED.
- otherwise it passes in front or behind and goes on.

Within two pixels of the origin a front that faces away is self-contact and is passed over, and within one
pixel `reach` and `footprint` are larger by half the tilt of the origin's own patch: where two surfaces
meet inside the origin's pixel, the ray has met the second one untested.
A ray that reaches its vanishing point inside a background cell ESCAPES; any other end is UNKNOWN.

The pyramid skips cells that the ray passes wholly in front of (nearest) or wholly behind (farthest); the
farthest bound is what keeps rays with finite thickness from crawling behind every foreground object.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import parallel
from .depth_field import DepthField
from .field_stack import FieldStack
from .march import March, MarchOptions
from .ray_queue import RayQueue
from .screen_rays import BLOCKED, ESCAPED, HIT, UNKNOWN, ScreenRays, TraceResult, pass_through, project_rays
from .types import FloatArray
from .walk import Walk

__all__ = [
    "BLOCKED",
    "ESCAPED",
    "HIT",
    "UNKNOWN",
    "MarchOptions",
    "ScreenRays",
    "TraceResult",
    "pass_through",
    "project_rays",
    "trace_rays",
    "trace_visitors",
]


# Fewer rays are not worth a thread of their own.
LEAST_RAYS = 16384


def trace_rays(
    field: DepthField,
    origin_vs: FloatArray,
    direction_vs: FloatArray,
    *,
    max_distance: float = np.inf,
    max_steps: int | None = None,
    starts_on_surface: bool = True,
    notes_hidden: bool = False,
    march: MarchOptions | None = None,
    threads: int | None = 1,
    advance: parallel.Advance | None = None,
) -> TraceResult:
    """Find the first surface of the field along each ray.

    Parameters
    ----------
    field
        Slabs and pyramid; one built with ``max_level=0`` gives the linear walk and the same hits.
    origin_vs, direction_vs : (3, N)
        View-space origins and directions, one row per component; perspective origins in front of the camera.
    max_distance
        In units of the directions' length.
    max_steps
        Cells, of any level, that a ray may look at; one that is not done then stays UNKNOWN. None: all.
    starts_on_surface
        The rays leave surfaces of this field: the cell under an origin is not tested, and what faces away
        beside it is self-contact. False for rays that come from elsewhere.
    notes_hidden
        Note where rays go out of sight, which costs some more steps of each that does. A march never does.
    march
        Sample the depth buffer at even steps and ignore the pyramid; one sample is one step of `max_steps`.
        None looks into all that the ray crosses.
    threads
        Worker threads, None for all cores; never changes a result.
    advance
        Called in this thread with the finished fraction; may raise to cancel.

    Returns
    -------
    TraceResult
        In the order of the rays.
    """

    def rays_of(where: slice) -> ScreenRays:
        return project_rays(field, origin_vs[:, where], direction_vs[:, where], max_distance)

    stack = FieldStack([field])
    return _walk(
        stack, rays_of, direction_vs, starts_on_surface, notes_hidden, max_steps, march, threads, advance
    )


def trace_visitors(
    stack: FieldStack,
    rays: ScreenRays,
    direction_vs: FloatArray,
    *,
    max_steps: int | None = None,
    march: MarchOptions | None = None,
    threads: int | None = 1,
) -> TraceResult:
    """Find the first surface along rays that come from elsewhere, each in its own field of the stack.

    Parameters
    ----------
    stack
        Fields of one size.
    rays
        By `project_rays`, with the index of each ray's field.
    direction_vs : (3, N)
        In the view space of each ray's field.
    max_steps, march, threads
        As in `trace_rays`.

    Returns
    -------
    TraceResult
        ``pixel`` counts through all fields of the stack; ``hidden`` is noted.
    """
    return _walk(stack, rays.run, direction_vs, False, True, max_steps, march, threads)


def _walk(
    stack: FieldStack,
    rays_of: Callable[[slice], ScreenRays],
    direction_vs: FloatArray,
    starts_on_surface: bool,
    notes_hidden: bool,
    max_steps: int | None,
    march: MarchOptions | None,
    threads: int | None,
    advance: parallel.Advance | None = None,
) -> TraceResult:
    """Let several walks share one queue: however the rays differ, all threads end together."""
    count = direction_vs.shape[1]
    result = TraceResult.empty(count, direction_vs.dtype)
    walks = min(parallel.thread_count(threads), -(-count // LEAST_RAYS))
    queue = RayQueue(count, rays_of, walks)

    def work(_: object) -> None:
        if march is None:
            Walk(stack, queue, direction_vs, starts_on_surface, notes_hidden, max_steps, result).run()
        else:
            March(stack, queue, direction_vs, starts_on_surface, max_steps, result, march).run()

    def report(_: float) -> None:
        if advance is not None:
            advance(queue.taken / queue.count)

    parallel.run_chunks(work, [None] * walks, threads, report, cancel=queue.close)
    return result
