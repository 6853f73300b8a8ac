# SPDX-License-Identifier: GPL-3.0-or-later
"""The tracer as compiled scalar code: what the numpy walk would cost without numpy.

One ray at a time, by the hit definition of `ssgi_addon.core.tracer` and on the same depth fields: begin at
level 0, climb a level on entering a new parent, descend where the bounds do not clear the cell. It evaluates
the same expressions in the same order as the walk, so both visit the same cells and find the same hits.
"""

from __future__ import annotations

import threading
from typing import NamedTuple

import numba
import numpy as np

from ssgi_addon.core import parallel, tracer
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.types import FloatArray, IntArray

# Rays per task: few enough that threads end together, many enough that handing them out costs nothing.
_RAYS_PER_TASK = 16384
_SELF_CONTACT_PX = 2
_STRAIGHT_AT_CAMERA = 1e30
_UNKNOWN, _BLOCKED, _ESCAPED, _HIT = tracer.UNKNOWN, tracer.BLOCKED, tracer.ESCAPED, tracer.HIT

# Without fast-math and with numpy's division: rounding, NaN and infinity are those of the walk. Nothing here
# makes arrays; with its runtime, numba would count references at every read, for half as much time again.
_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_compile = numba.njit(**_OPTIONS)
_inline = numba.njit(**_OPTIONS, forceinline=True)


class _Field(NamedTuple):
    """What a ray reads of a depth field; all floats are of the field's dtype."""

    fx: np.floating
    fy: np.floating
    cx: np.floating
    cy: np.floating
    q_end: np.floating
    is_orthographic: bool
    width: int
    height: int
    padded_width: int
    padded_height: int
    stride: int
    corners: IntArray  # (4, levels): atlas index of cell (0, 0) for each way to mirror
    bounds: FloatArray
    planes: FloatArray
    reach: FloatArray
    footprint: FloatArray
    largest_step: FloatArray
    normal: FloatArray
    is_background: np.ndarray


class _Line(NamedTuple):
    """A ray (x, y, q)(s) in coordinates that are mirrored so that vx and vy are not negative."""

    x: float
    y: float
    q: float
    vx: float
    vy: float
    vq: float
    is_mirrored_x: bool
    is_mirrored_y: bool


class _Answers(NamedTuple):
    status: np.ndarray
    pixel: IntArray
    distance: FloatArray
    x_px: FloatArray
    y_px: FloatArray


def trace_rays(
    field: DepthField,
    origin_vs: FloatArray,
    direction_vs: FloatArray,
    *,
    max_distance: float = np.inf,
    starts_on_surface: bool = True,
    threads: int | None = 1,
) -> tuple[tracer.TraceResult, int]:
    """Find the first surface of the field along each ray.

    Parameters
    ----------
    field, origin_vs, direction_vs, max_distance, starts_on_surface, threads
        As in `tracer.trace_rays`; field and rays of one dtype.

    Returns
    -------
    TraceResult
        In the order of the rays.
    int
        Cells, of any level, that all rays together looked at.
    """
    count, dtype = origin_vs.shape[1], origin_vs.dtype
    # Filled by the threads that own the rays, so that no thread waits for fresh memory
    result = tracer.TraceResult(
        np.empty(count, dtype=np.int8),
        np.empty(count, dtype=np.int64),
        *np.empty((3, count), dtype=dtype),
        np.full(count, np.inf, dtype=dtype),  # where rays go out of sight it does not note
    )
    constants, limit = _constants(field), dtype.type(max_distance)
    answers = _Answers(**{name: getattr(result, name) for name in _Answers._fields})
    lock, steps = threading.Lock(), 0

    def work(ids: IntArray) -> None:
        nonlocal steps
        taken = _trace(
            constants, origin_vs, direction_vs, limit, starts_on_surface, ids[0], ids[-1] + 1, answers
        )
        with lock:
            steps += taken

    parallel.run_chunks(work, parallel.split(np.arange(count), _RAYS_PER_TASK), threads)
    return result, steps


def _constants(field: DepthField) -> _Field:
    camera, real = field.camera, field.bounds.dtype.type
    level = np.arange(field.levels)
    last_column = (field.padded_width >> level) - 1
    last_row = ((field.padded_height >> level) - 1) * field.stride
    return _Field(
        fx=real(camera.fx),
        fy=real(camera.fy),
        cx=real(camera.cx),
        cy=real(camera.cy),
        q_end=real(field.q_end),
        is_orthographic=camera.is_orthographic,
        width=camera.width,
        height=camera.height,
        padded_width=field.padded_width,
        padded_height=field.padded_height,
        stride=field.stride,
        corners=np.stack([field.origins + x * last_column + y * last_row for y in (0, 1) for x in (0, 1)]),
        bounds=field.bounds,
        planes=field.planes,
        reach=field.reach,
        footprint=field.footprint,
        largest_step=field.largest_step,
        normal=field.normal,
        is_background=field.is_background,
    )


@_compile
def _trace(field, origin, direction, max_distance, starts_on_surface, begin, end, answers):
    """Trace rays `begin` to `end` one after another; return the number of cells that they looked at."""
    steps = 0
    for ray in range(begin, end):
        answers.status[ray] = _UNKNOWN
        answers.pixel[ray] = -1
        answers.distance[ray] = np.inf
        answers.x_px[ray] = 0.0
        answers.y_px[ray] = 0.0
        line, s_begin, s_vanish, s_limit = _project(field, origin, direction, ray, max_distance)
        if s_begin < np.inf:
            steps += _walk(
                field, line, s_begin, s_vanish, s_limit, direction, starts_on_surface, ray, answers
            )
    return steps


@_inline
def _project(field, origin, direction, ray, max_distance):
    """Return the ray as a line, and s where it first lies over the frame, vanishes and is long enough."""
    real = field.bounds.dtype.type
    one, infinity = real(1), real(np.inf)
    ox, oy, oz = origin[0, ray], origin[1, ray], origin[2, ray]
    dx, dy, dz = direction[0, ray], direction[1, ray], direction[2, ray]
    if field.is_orthographic:
        q, inverse = oz, one
        vx, vy, vq = field.fx * dx, -field.fy * dy, dz
        s_vanish = (field.q_end - q) / vq if vq < 0.0 else infinity
        s_limit = min(max_distance, -q / vq) if vq > 0.0 else max_distance
    else:
        q = one / -oz
        inverse = q
        slope = -dz * q
        vx, vy, vq = field.fx * (dx - ox * slope), -field.fy * (dy - oy * slope), -slope
        s_vanish = -one / dz if dz < 0.0 else infinity
        s_limit = max_distance * q / (one + max_distance * slope)
        if not s_limit >= 0.0:  # NaN for +inf: no limit
            s_limit = infinity
    x, y = field.cx + field.fx * ox * inverse, field.cy - field.fy * oy * inverse
    s_begin = max(_entry(field, x, vx, real(field.width)), _entry(field, y, vy, real(field.height)))
    is_mirrored_x, is_mirrored_y = vx < 0.0, vy < 0.0
    if is_mirrored_x:
        x = real(field.padded_width) - x
    if is_mirrored_y:
        y = real(field.padded_height) - y
    line = _Line(x, y, q, abs(vx), abs(vy), vq, is_mirrored_x, is_mirrored_y)  # no -0 either
    return line, s_begin, s_vanish, s_limit


@_inline
def _entry(field, position, speed, size):
    """Return s at which a coordinate comes into the frame: 0 from within, +inf for never."""
    real = field.bounds.dtype.type
    if position < 0.0:
        s = -position / speed
    elif position > size:
        s = (size - position) / speed
    else:
        return real(0)
    return s if s > 0.0 else real(np.inf)


@_inline
def _walk(field, line, s, s_vanish, s_limit, direction, starts_on_surface, ray, answers):
    """Walk one ray to its end; return the number of cells that it looked at."""
    real = field.bounds.dtype.type
    inverse_x, inverse_y = real(1) / line.vx, real(1) / line.vy
    # The frame's border, by the expression that the walk uses for cell borders
    limit_x = real(field.padded_width if line.is_mirrored_x else field.width)
    limit_y = real(field.padded_height if line.is_mirrored_y else field.height)
    s_end = real(_STRAIGHT_AT_CAMERA)
    for s_exit in ((limit_x - line.x) * inverse_x, (limit_y - line.y) * inverse_y, s_vanish, s_limit):
        if s_exit < s_end:
            s_end = s_exit
    if not s < s_end:
        return 0
    column = min(max(np.int64(np.floor(line.x + line.vx * s)), 0), field.padded_width - 1)
    row = min(max(np.int64(np.floor(line.y + line.vy * s)), 0), field.padded_height - 1)
    if starts_on_surface and s == 0.0:
        s_x, s_y = (real(column + 1) - line.x) * inverse_x, (real(row + 1) - line.y) * inverse_y
        s = min(min(s_x, s_y), s_end)
        column, row = column + (s_x <= s), row + (s_y <= s)
    way = line.is_mirrored_x + 2 * line.is_mirrored_y
    to_column = -1 if line.is_mirrored_x else 1
    to_row = -field.stride if line.is_mirrored_y else field.stride
    top = field.corners.shape[1] - 1
    steps = level = 0
    q_in = line.q + line.vq * s
    is_walking = s < s_end and line.x < limit_x and line.y < limit_y
    while is_walking:
        steps += 1
        # Find where the ray leaves the cell
        s_x = (real((column + 1) << level) - line.x) * inverse_x
        s_y = (real((row + 1) << level) - line.y) * inverse_y
        s_out = min(min(s_x, s_y), s_end)
        q_out = line.q + line.vq * s_out
        # An unsigned index needs no test for negative ones; `|` makes one branch of two that none foresees
        cell = np.uint64(field.corners[way, level] + row * to_row + column * to_column)
        is_clear = (min(q_in, q_out) > field.bounds[cell, 0]) | (max(q_in, q_out) < field.bounds[cell, 1])
        if not is_clear:
            if level > 0:
                # Descend into the child that holds the ray
                level -= 1
                s_x = (real((2 * column + 1) << level) - line.x) * inverse_x
                s_y = (real((2 * row + 1) << level) - line.y) * inverse_y
                column, row = 2 * column + (s >= s_x), 2 * row + (s >= s_y)
                continue
            if _meet(field, line, column, row, s, s_out, direction, starts_on_surface, ray, answers):
                return steps
        is_walking = s_out < s_end
        # Step into the next cell, one level up where its parent is new
        s, q_in = s_out, q_out
        is_parent_new = False
        if s_x <= s_out:
            column += 1
            is_parent_new = column & 1 == 0
        if s_y <= s_out:
            row += 1
            is_parent_new = is_parent_new or row & 1 == 0
        if is_parent_new and level < top:
            level, column, row = level + 1, column >> 1, row >> 1
    _finish(field, line, s_end, s_vanish, ray, answers)
    return steps


@_inline
def _meet(field, line, column, row, s_in, s_out, direction, starts_on_surface, ray, answers):
    """Test a ray against the slab of its level-0 cell; write the answer and return whether it stopped."""
    real = field.bounds.dtype.type
    half = real(0.5)
    pixel = _pixel(field, line, column, row)
    gx, gy = field.planes[pixel, 1], field.planes[pixel, 2]
    if line.is_mirrored_x:
        gx = -gx
    if line.is_mirrored_y:
        gy = -gy
    # h(s) = h0 + s * dh: how far in front of the patch's plane the ray is, in q
    dx, dy = line.x - (real(column) + half), line.y - (real(row) + half)
    h0 = line.q - field.planes[pixel, 0] - gx * dx - gy * dy
    dh = line.vq - gx * line.vx - gy * line.vy
    h_in, h_out, behind = h0 + dh * s_in, h0 + dh * s_out, -field.planes[pixel, 3]
    if not ((min(h_in, h_out) <= 0.0) & (max(h_in, h_out) >= behind)):
        return False
    crosses = h_in > 0.0
    faces = (
        field.normal[pixel, 0] * direction[0, ray]
        + field.normal[pixel, 1] * direction[1, ray]
        + field.normal[pixel, 2] * direction[2, ray]
    ) < 0.0
    rise = real(0)
    if starts_on_surface:
        home_column, home_row = np.int64(np.floor(line.x)), np.int64(np.floor(line.y))
        away = max(abs(column - home_column), abs(row - home_row))
        if not faces and away <= _SELF_CONTACT_PX:
            return False
        if away <= 1:
            home = _pixel(field, line, home_column, home_row)
            rise = half * (abs(field.planes[home, 1]) + abs(field.planes[home, 2]))
    is_hit = faces and (crosses or (h_in >= behind and h_in >= -(field.reach[pixel] + rise)))
    if is_hit and not crosses and h_in < -(field.footprint[pixel] + rise):
        is_hit = not _comes_over_edge(field, line, column, row, pixel)
    s = s_in - h_in / dh if crosses else s_in
    x, y = line.x + line.vx * s, line.y + line.vy * s
    answers.status[ray] = _HIT if is_hit else _BLOCKED
    answers.pixel[ray] = pixel
    answers.distance[ray] = _distance(field, line, s)
    answers.x_px[ray] = real(field.padded_width) - x if line.is_mirrored_x else x
    answers.y_px[ray] = real(field.padded_height) - y if line.is_mirrored_y else y
    return True


@_inline
def _comes_over_edge(field, line, column, row, pixel):
    """Return whether the surface falls by more than a step over the border that the ray crossed last."""
    real = field.bounds.dtype.type
    half = real(0.5)
    to_x, to_y = real(column) - line.x, real(row) - line.y
    s_x, s_y = to_x * line.vy, to_y * line.vx
    is_crossed_x, is_crossed_y = s_x >= s_y and to_x > 0.0, s_y >= s_x and to_y > 0.0
    beside = _pixel(field, line, column - is_crossed_x, row - is_crossed_y)
    if beside == pixel:
        return False
    right = half if is_crossed_x else real(0)
    down = half if is_crossed_y else real(0)
    if line.is_mirrored_x:
        right = -right
    if line.is_mirrored_y:
        down = -down
    here = field.planes[pixel, 0] - field.planes[pixel, 1] * right - field.planes[pixel, 2] * down
    there = field.planes[beside, 0] + field.planes[beside, 1] * right + field.planes[beside, 2] * down
    return here - there > field.largest_step[pixel]


@_inline
def _finish(field, line, s_end, s_vanish, ray, answers):
    """Let a ray that ends at its vanishing point over background escape; any other stays UNKNOWN."""
    if s_end != s_vanish:
        answers.distance[ray] = _distance(field, line, s_end)
        return
    column, row = np.floor(line.x + line.vx * s_end), np.floor(line.y + line.vy * s_end)
    if field.is_background[_pixel(field, line, np.int64(column), np.int64(row))]:
        answers.status[ray] = _ESCAPED


@_inline
def _pixel(field, line, column, row):
    """Return the flat pixel index of a mirrored level-0 cell; rounding at the border stays in the frame."""
    if line.is_mirrored_x:
        column = field.padded_width - 1 - column
    if line.is_mirrored_y:
        row = field.padded_height - 1 - row
    column, row = min(max(column, 0), field.width - 1), min(max(row, 0), field.height - 1)
    return row * field.width + column


@_inline
def _distance(field, line, s):
    """Convert s back to distance: t = s / q(s), orthographic t = s."""
    return s if field.is_orthographic else s / (line.q + line.vq * s)
