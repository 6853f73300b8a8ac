# SPDX-License-Identifier: GPL-3.0-or-later
"""The diffuse pass as its definition reads: one pixel, one direction at a time, over an even grid.

No sequences, no chunks, no pyramid. The truth that every method of the diffuse pass is tested against.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssgi_addon.core import Camera, Environment, GBuffer, tracer
from ssgi_addon.core.depth_field import DepthField
from tests.reference.scalar_tracer import trace_ray


@dataclass(frozen=True)
class Hemisphere:
    """What a pixel's hemisphere brings: RGB of hits and environment, the open and the answered part."""

    bounce: np.ndarray
    environment: np.ndarray
    visibility: float
    known: float


def gather(
    gbuffer: GBuffer,
    camera: Camera,
    pixel: tuple[int, int],
    handed_on: np.ndarray,
    *,
    thickness: float,
    environment: Environment | None = None,
    unknown: str = "environment",
    steps: int = 16,
    field: DepthField | None = None,
) -> Hemisphere:
    """Integrate over ``steps * 2 steps`` directions of equal weight above pixel (row, column).

    `handed_on` (H, W, 3) is the radiance that each pixel sends to the others. `unknown` is what unanswered
    directions bring: the environment or nothing.
    """
    if field is None:
        field = DepthField.build(gbuffer, camera, thickness)
    row, column = pixel
    normal = gbuffer.normal[row, column].astype(np.float64)
    origin = camera.pixel_to_view(column + 0.5, row + 0.5, float(gbuffer.depth[row, column]))
    across = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.7 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    handed_on = handed_on.reshape(-1, 3)
    bounce, sky = np.zeros(3), np.zeros(3)
    visible = known = 0
    for i in range(steps):
        for j in range(2 * steps):
            # Equal steps of sin^2 carry equal shares of cos / pi
            sine = math.sqrt((i + 0.5) / steps)
            angle = math.pi * (j + 0.5) / steps
            direction = (
                sine * (math.cos(angle) * across + math.sin(angle) * along)
                + math.sqrt(1.0 - sine * sine) * normal
            )
            status, hit, _, _ = trace_ray(field, origin, direction)
            visible += status in (tracer.ESCAPED, tracer.UNKNOWN)
            known += status in (tracer.ESCAPED, tracer.HIT)
            if status == tracer.HIT:
                bounce += handed_on[hit]
            elif environment is not None and (status == tracer.ESCAPED or unknown == "environment"):
                sky += environment.radiance(*direction.reshape(3, 1))[0]
    count = 2 * steps * steps
    return Hemisphere(bounce / count, sky / count, visible / count, known / count)
