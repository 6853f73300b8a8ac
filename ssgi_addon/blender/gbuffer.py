# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' passes to the G-buffer of the core."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..blender_passes import FARTHEST_SURFACE
from ..core import Camera, GBuffer

FloatArray = NDArray[np.float32]

GEOMETRY_PASSES = ("Depth", "Normal")
LIGHT_PASSES = ("Combined", "Diffuse Direct", "Diffuse Color", "Glossy Direct", "Glossy Color")


def gbuffer_from_passes(layers: Mapping[str, FloatArray], roughness: FloatArray, camera: Camera) -> GBuffer:
    """Combine geometry and light that were rendered without diffuse and glossy bounces.

    Parameters
    ----------
    layers
        `GEOMETRY_PASSES` and `LIGHT_PASSES` as Cycles writes them: normals in world space, light divided
        by the surface's colour.
    roughness : (H, W)
        Of the glossy lobe.
    camera
        That the passes were rendered with.

    Returns
    -------
    GBuffer
        What surfaces hand on holds no emission: emissive meshes are lamps in Cycles' direct passes.
    """
    depth = layers["Depth"]
    source = layers["Diffuse Direct"] * layers["Diffuse Color"]
    return GBuffer(
        depth=np.where(depth < FARTHEST_SURFACE, depth, np.float32(np.inf)),
        normal=_world_to_view(layers["Normal"], camera),
        albedo=layers["Diffuse Color"],
        specular=layers["Glossy Color"],
        roughness=roughness,
        direct=layers["Combined"],
        source=source,
        glossy_source=source + layers["Glossy Direct"] * layers["Glossy Color"],
    )


def _world_to_view(normal_ws: FloatArray, camera: Camera) -> FloatArray:
    """Rotate world-space normals into view space; rows times the pose are columns times its transpose."""
    rotation = camera.world_from_view[:3, :3].astype(np.float32)
    return np.einsum("hwi,ij->hwj", normal_ws, rotation)
