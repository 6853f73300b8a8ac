# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays in, arrays out: the passes of screen-space global illumination on numpy alone."""

from .camera import Camera
from .environment import Environment
from .fill import Fill
from .gbuffer import GBuffer
from .light import IndirectLight, composite
from .pipeline import render_indirect
from .settings import DiffuseSettings, ReflectionSettings, Settings

__all__ = [
    "Camera",
    "DiffuseSettings",
    "Environment",
    "Fill",
    "GBuffer",
    "IndirectLight",
    "ReflectionSettings",
    "Settings",
    "composite",
    "render_indirect",
]
