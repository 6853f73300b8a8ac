# SPDX-License-Identifier: GPL-3.0-or-later
"""What a capture hands to the passes: one neutral description, with no Blender in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .core import Camera, Environment, Fill, GBuffer


@dataclass(frozen=True, eq=False)
class CapturedFrame:
    """One frame's G-buffer, its camera and which light its direct passes already count.

    Attributes
    ----------
    gbuffer, camera
        The frame; normals in view space, depth +inf on background.
    environment
        What escaping rays bring; None where the direct passes already hold the world's light.
    engine
        ``"cycles"`` or ``"eevee"``.
    emission_in_direct
        True where emissive meshes light other surfaces in the direct passes, so that hits must not
        hand on emission (Cycles samples them as lights at the first bounce).
    world_in_direct
        True where the world lights every surface in the direct passes with true visibility, so that
        escaping rays must bring nothing (Cycles).
    views
        Further G-buffers and cameras that rays continue in.
    view_names
        What each of them is, by the capture that took it: ``"surround"``, ``"stations"`` and so on.
    layers
        Captured passes by Blender's long names, ``(H, W, 3)`` or ``(H, W)``.
    seconds
        Wall time of each capture step.
    gains
        By how much smaller the share of lost rays is (`core.stations.LostRays`) for each kind of view.
    skipped
        What was not captured and why, as (what, why).
    notes
        What the user should know about this capture, one sentence each.
    fill
        Path-traced indirect light of a small image, for what the views cannot answer; None where none was
        rendered.
    """

    gbuffer: GBuffer
    camera: Camera
    environment: Environment | None
    engine: str
    emission_in_direct: bool
    world_in_direct: bool
    views: tuple[tuple[GBuffer, Camera], ...] = ()
    view_names: tuple[str, ...] = ()
    layers: Mapping[str, np.ndarray[Any, Any]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    gains: Mapping[str, float] = field(default_factory=dict)
    skipped: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    fill: Fill | None = None
