# SPDX-License-Identifier: GPL-3.0-or-later
"""A program that uses the package, for a type checker that sees the installed package alone."""

from dataclasses import replace
from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

from ssgi_addon.core import (
    Camera,
    DiffuseSettings,
    Environment,
    Fill,
    GBuffer,
    IndirectLight,
    ReflectionSettings,
    Settings,
    composite,
    render_indirect,
)


def light_of(gbuffer: GBuffer, camera: Camera, fill: Fill | None = None) -> IndirectLight:
    """Compute the light with settings and an environment of one's own."""
    settings = replace(Settings.preset("draft"), diffuse=DiffuseSettings(rays=4), threads=1)
    assert_type(settings.reflections, ReflectionSettings)
    return render_indirect(gbuffer, camera, settings, Environment.constant((0.1, 0.1, 0.1)), fill=fill)


camera = Camera.perspective(16, 9, fov_x=1.0)
black = np.zeros((9, 16, 3), np.float32)
gbuffer = GBuffer(black[..., 0] + 1.0, black, black, black, black[..., 0], black)
picture = composite(gbuffer, light_of(gbuffer, camera))
assert_type(picture, NDArray[np.floating[Any]])
