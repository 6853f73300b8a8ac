# SPDX-License-Identifier: GPL-3.0-or-later
"""The hit definition, one ray and one cell at a time, in plain Python floats.

Slow and obvious on purpose: it keeps no pyramid and no mirrored coordinates, and is what every
accelerated walk is tested against.
"""

from __future__ import annotations

import math

from ssgi_addon.core import tracer
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.slabs import JUST_BEFORE


def trace_ray(field: DepthField, origin, direction, max_distance=math.inf, starts_on_surface=True):
    """Return (status, flat pixel or -1, distance, hidden) of one view-space ray.

    `hidden` is the distance at which it enters the first cell that it passes behind, or just before it enters
    a slab other than through its front, +inf for neither. A ray that starts on a surface has its origin over
    the frame; others may come in from outside.
    """
    camera = field.camera
    width, height = camera.width, camera.height
    ox, oy, oz = (float(v) for v in origin)
    dx, dy, dz = (float(v) for v in direction)
    if camera.is_orthographic:
        q0, vq = oz, dz
        x0, y0 = camera.cx + camera.fx * ox, camera.cy - camera.fy * oy
        vx, vy = camera.fx * dx, -camera.fy * dy
        s_vanish = (field.q_end - q0) / vq if vq < 0 else math.inf
        s_limit = (
            min(max_distance, -oz / dz) if dz > 0 else max_distance
        )  # no farther than the camera's plane
    else:
        q0 = -1.0 / oz
        x0, y0 = camera.cx + camera.fx * ox * q0, camera.cy - camera.fy * oy * q0
        vx, vy = camera.fx * (dx + ox * dz * q0), -camera.fy * (dy + oy * dz * q0)
        vq = dz * q0
        s_vanish = -1.0 / dz if dz < 0 else math.inf
        s_limit = math.inf
        if math.isfinite(max_distance) and -oz - max_distance * dz > 0.0:
            s_limit = max_distance / (-oz - max_distance * dz)
    s = max(_entry(x0, vx, width), _entry(y0, vy, height))
    s_stop = min(s_vanish, s_limit)
    if s >= s_vanish or not _is_over(x0 + vx * s, width) or not _is_over(y0 + vy * s, height):
        return tracer.UNKNOWN, -1, math.inf, math.inf
    if s >= s_limit:
        return (
            tracer.UNKNOWN,
            -1,
            s_limit if camera.is_orthographic else s_limit / (q0 + vq * s_limit),
            math.inf,
        )
    ix, iy = math.floor(x0 + vx * s), math.floor(y0 + vy * s)
    if s > 0.0:  # over the border just now
        ix, iy = min(max(ix, 0), width - 1), min(max(iy, 0), height - 1)
    home = (ix, iy) if starts_on_surface else None
    hidden, before = math.inf, (ix, iy)

    def distance_at(s):
        return s if camera.is_orthographic else s / (q0 + vq * s)

    while True:
        next_x = ix + 1 if vx > 0 else ix
        next_y = iy + 1 if vy > 0 else iy
        s_x = (next_x - x0) / vx if vx else math.inf
        s_y = (next_y - y0) / vy if vy else math.inf
        s_out = min(s_x, s_y, s_stop)
        if math.isinf(s_out):  # straight at the camera
            return tracer.UNKNOWN, -1, s_out if camera.is_orthographic else 1.0 / vq, hidden
        if (ix, iy) != home:
            line = (x0, y0, q0), (vx, vy, vq)
            answer = _meet(field, (ix, iy), before, *line, (dx, dy, dz), s, s_out, home)
            if answer is not None:
                status, s_hit = answer
                distance = distance_at(s_hit)
                if _height(field, ix, iy, (x0, y0, q0), (vx, vy, vq), s) <= 0.0:  # not through the front
                    hidden = min(hidden, distance * JUST_BEFORE)
                return status, iy * width + ix, distance, hidden
            if hidden == math.inf and _passes_behind(field, ix, iy, (x0, y0, q0), (vx, vy, vq), s, s_out):
                hidden = distance_at(s)
        if s_out >= s_stop == s_vanish:
            column = min(max(_cell_of(x0 + vx * s_out, vx), 0), width - 1)
            row = min(max(_cell_of(y0 + vy * s_out, vy), 0), height - 1)
            escaped = bool(field.is_background[row * width + column])
            return (tracer.ESCAPED if escaped else tracer.UNKNOWN), -1, math.inf, hidden
        if s_out >= s_stop:
            return tracer.UNKNOWN, -1, distance_at(s_out), hidden
        s, before = s_out, (ix, iy)
        if s_x <= s_out:
            ix += 1 if vx > 0 else -1
        if s_y <= s_out:
            iy += 1 if vy > 0 else -1
        if not (0 <= ix < width and 0 <= iy < height):
            return tracer.UNKNOWN, -1, distance_at(s_out), hidden


def _entry(position, speed, size):
    """Return s at which a coordinate comes into the frame: 0 from within, +inf for never."""
    if 0.0 <= position <= size:
        return 0.0
    border = 0.0 if position < 0.0 else size
    s = (border - position) / speed if speed else -1.0
    return s if s > 0.0 else math.inf


def _cell_of(position, speed):
    """Return the cell of a coordinate; on a border the one that the ray moves into."""
    return math.ceil(position) - 1 if speed < 0.0 else math.floor(position)


def _is_over(position, size):
    return -1e-9 * size <= position <= size * (1.0 + 1e-9)


def _meet(field, cell, before, start, velocity, direction, s_in, s_out, home):
    """Return (status, s) where the ray meets the slab of one cell, or None."""
    ix, iy = cell
    pixel = iy * field.camera.width + ix
    if field.is_background[pixel]:
        return None
    h_in, h_out = (_height(field, ix, iy, start, velocity, s) for s in (s_in, s_out))
    slab = float(field.slab[pixel])
    faces = sum(float(n) * d for n, d in zip(field.normal[pixel], direction, strict=True)) < 0.0
    away = math.inf if home is None else max(abs(ix - home[0]), abs(iy - home[1]))
    is_own = not faces and away <= 2
    reach = float(field.reach[pixel])
    if comes_over_edge(field, cell, before):
        reach = min(reach, float(field.footprint[pixel]))
    if away <= 1:  # the origin's own patch reaches half a pixel
        own = home[1] * field.camera.width + home[0]
        reach += 0.5 * (abs(float(field.gradient_x[own])) + abs(float(field.gradient_y[own])))
    if h_in > 0.0 and h_out <= 0.0:
        answer = (tracer.HIT if faces else tracer.BLOCKED, s_in + (s_out - s_in) * h_in / (h_in - h_out))
    elif -slab <= h_in <= 0.0:
        is_step = h_in >= -reach
        answer = (tracer.HIT if faces and is_step else tracer.BLOCKED, s_in)
    elif h_in < -slab and h_out >= -slab:
        answer = (tracer.BLOCKED, s_in)
    else:
        return None
    return None if is_own else answer


def _passes_behind(field, ix, iy, start, velocity, s_in, s_out):
    """Return whether the ray is behind the slab of a cell from entry to exit."""
    pixel = iy * field.camera.width + ix
    if field.is_background[pixel]:
        return False
    heights = (_height(field, ix, iy, start, velocity, s) for s in (s_in, s_out))
    return max(heights) < -float(field.slab[pixel])


def _height(field, ix, iy, start, velocity, s):
    """Return how far in front of a cell's plane the ray is at s, in q."""
    pixel = iy * field.camera.width + ix
    gx, gy = float(field.gradient_x[pixel]), float(field.gradient_y[pixel])
    front = float(field.front[pixel])
    front += gx * (start[0] + velocity[0] * s - ix - 0.5) + gy * (start[1] + velocity[1] * s - iy - 0.5)
    return start[2] + velocity[2] * s - front


def comes_over_edge(field, cell, before):
    """Return whether the surface in the cell that the ray came from is more than a step behind."""
    width, height = field.camera.width, field.camera.height
    column, row = min(max(before[0], 0), width - 1), min(max(before[1], 0), height - 1)
    here, there = cell[1] * width + cell[0], row * width + column
    if here == there:
        return False
    right, down = 0.5 * (cell[0] - before[0]), 0.5 * (cell[1] - before[1])

    def front(pixel, right, down):
        gradient = float(field.gradient_x[pixel]), float(field.gradient_y[pixel])
        return float(field.front[pixel]) + gradient[0] * right + gradient[1] * down

    return front(here, -right, -down) - front(there, right, down) > float(field.largest_step[here])
