# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's passes to the G-buffer of the core."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..blender_passes import FARTHEST_SURFACE
from ..core import Camera, GBuffer
from ..surface_light import handed_on, reflectance

FloatArray = NDArray[np.float32]

GEOMETRY_PASSES = ("Depth", "Normal")
LIGHT_PASSES = ("Combined", "Diffuse Direct", "Diffuse Color", "Glossy Direct", "Glossy Color")
# What tells the sum of the reflected light, for who need not know how it is split
SUM_PASSES = ("Combined", "Emission", "Diffuse Color", "Glossy Color")
# The rest of what Combined holds, each with the colour that it is divided by.
_OTHER_LIGHT = (
    ("Transmission Direct", "Transmission Color"),
    ("Transmission Indirect", "Transmission Color"),
    ("Volume Direct", None),
    ("Volume Indirect", None),
    ("Emission", None),
    ("Environment", None),
)
OTHER_LIGHT_PASSES = tuple(dict.fromkeys(name for pair in _OTHER_LIGHT for name in pair if name))
# Where more of a pixel than this is other light, what is left of its denoised sum is the denoiser's error.
_MOST_OTHER_LIGHT = 0.5
# Light is divided by no smaller colour, and shares by no smaller sum.
_LEAST_COLOR, _TINY = np.float32(1e-4), np.float32(1e-20)


def gbuffer_from_passes(
    layers: Mapping[str, FloatArray],
    roughness: FloatArray,
    camera: Camera,
    *,
    is_denoised: bool = False,
    emission: FloatArray | None = None,
) -> GBuffer:
    """Combine geometry and light that were rendered without diffuse and glossy bounces.

    Parameters
    ----------
    layers
        `GEOMETRY_PASSES` and `LIGHT_PASSES` as Blender writes them: normals in world space, light divided
        by the surface's colour. `SUM_PASSES` do, too: what surfaces hand on is what they show, then.
    roughness : (H, W)
        Of the glossy lobe.
    camera
        That the passes were rendered with.
    is_denoised
        Combined is denoised, and `layers` holds `OTHER_LIGHT_PASSES`: what surfaces hand on is clean then.
    emission : (H, W, 3)
        What surfaces hand on besides, at the pixels' centres: emitters whose edges are smoothed look larger
        to rays. None where emissive meshes are lamps already, as in Cycles' direct passes.
    """
    depth, normal = surfaces_from_passes(layers, camera)
    source: FloatArray
    glossy_source: FloatArray | None
    if "Diffuse Direct" in layers:
        if is_denoised:
            layers = {**layers, **_denoised_light(layers)}
        source = handed_on(layers, roughness)
        glossy_source = layers["Diffuse Direct"] * layers["Diffuse Color"]
        glossy_source = glossy_source + layers["Glossy Direct"] * layers["Glossy Color"]
    else:
        # Emitters are lamps already
        source, glossy_source = np.maximum(layers["Combined"] - layers["Emission"], 0.0), None
    if emission is not None:
        source = source + emission
        glossy_source = None if glossy_source is None else glossy_source + emission
    return GBuffer(
        depth=depth,
        normal=normal,
        albedo=layers["Diffuse Color"],
        specular=layers["Glossy Color"],
        roughness=roughness,
        direct=layers["Combined"],
        source=source,
        glossy_source=glossy_source,
        reflectance=reflectance(layers["Diffuse Color"], layers["Glossy Color"], normal, camera),
    )


def surfaces_from_passes(layers: Mapping[str, FloatArray], camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return depth (H, W), +inf on background, and view-space normals (H, W, 3) from `GEOMETRY_PASSES`."""
    depth = layers["Depth"]
    depth = np.where(depth < FARTHEST_SURFACE, depth, np.float32(np.inf))
    return depth, _world_to_view(layers["Normal"], camera)


def _denoised_light(layers: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return Diffuse and Glossy Direct from the denoised sum of all light where they are most of it.

    Rays that meet a small bright thing all carry the noise of its few pixels, and mirrors show single ones.
    The noise of both passes is that of the same lamps, so that their shares of the sum have little.
    """
    other = np.zeros_like(layers["Combined"])
    for light, color in _OTHER_LIGHT:
        other += layers[light] if color is None else layers[light] * layers[color]
    combined = layers["Combined"]
    is_clean = (other.sum(axis=-1) <= _MOST_OTHER_LIGHT * combined.sum(axis=-1))[..., None]
    clean = np.maximum(combined - other, 0.0)
    colors = {name: layers[f"{name} Color"] for name in ("Diffuse", "Glossy")}
    noisy = {name: layers[f"{name} Direct"] * color for name, color in colors.items()}
    total, white = noisy["Diffuse"] + noisy["Glossy"], colors["Diffuse"] + colors["Glossy"]
    found = {}
    for name, color in colors.items():
        # A pixel whose samples met no lamp has no shares of its own
        share = np.where(
            total > 0.0, noisy[name] / np.maximum(total, _TINY), color / np.maximum(white, _TINY)
        )
        light = np.where(color > _LEAST_COLOR, clean * share / np.maximum(color, _LEAST_COLOR), 0.0)
        found[f"{name} Direct"] = np.where(is_clean, light, layers[f"{name} Direct"])
    return found


def _world_to_view(normal_ws: FloatArray, camera: Camera) -> FloatArray:
    """Rotate world-space normals into view space; rows times the pose are columns times its transpose."""
    rotation = camera.world_from_view[:3, :3].astype(np.float32)
    return np.einsum("hwi,ij->hwj", normal_ws, rotation)
