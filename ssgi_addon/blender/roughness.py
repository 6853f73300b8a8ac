# SPDX-License-Identifier: GPL-3.0-or-later
"""The roughness of every pixel's glossy lobe, which Blender has no pass for.

Since 5.2 Cycles' denoising passes tell it without touching a material. Before, and in EEVEE, every material
gets AOV Output nodes for the time of one render.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from . import compat
from .restore import Restorer
from .roughness_nodes import RoughnessNodes
from .shader_trees import output_target, shaded_materials

FloatArray = NDArray[np.float32]

# What a surface without a glossy lobe counts as.
FULLY_ROUGH = np.float32(1.0)
# What Cycles shades objects without a material with, where that is glossy at all.
DEFAULT_SURFACE = np.float32(0.5)
# The settings of a view layer by which Cycles' denoising passes tell the roughness of the first hit.
FIRST_HIT = {
    "denoising_store_passes": True,
    "denoising_pass_follow_reflections": False,
    "denoising_pass_use_albedo_roughness_weighting": False,
}
# Below this share of glossy light the roughness does not matter, and its division means nothing.
_LEAST_GLOSSY = 1e-5


@dataclass(frozen=True)
class RoughnessSource:
    """The passes to render for the roughness, and how to read it from them.

    Attributes
    ----------
    passes
        Names of the passes to ask Cycles for.
    read
        Rendered passes to roughness, ``(H, W)`` float32 in 0..1; 1 where nothing is glossy.
    """

    passes: tuple[str, ...]
    read: Callable[[Mapping[str, FloatArray]], FloatArray]


def borrow_roughness(restorer: Restorer, view_layer: bpy.types.ViewLayer) -> RoughnessSource:
    """Make the next renders of `view_layer` carry their roughness, until `restorer` closes."""
    is_cycles = output_target(view_layer.id_data) == "CYCLES"
    if is_cycles and compat.has_roughness_pass(view_layer):
        return borrow_denoising_roughness(restorer, view_layer)
    return borrow_aov_roughness(restorer, view_layer)


def borrow_denoising_roughness(restorer: Restorer, view_layer: bpy.types.ViewLayer) -> RoughnessSource:
    """Read the roughness from Cycles' denoising passes of the first hit (Blender 5.2 and later)."""
    restorer.change(view_layer.cycles, **FIRST_HIT)
    restorer.change(view_layer, use_pass_diffuse_color=True, use_pass_glossy_color=True)
    return RoughnessSource(("Denoising Roughness", "Diffuse Color", "Glossy Color"), _from_denoising_passes)


def borrow_aov_roughness(restorer: Restorer, view_layer: bpy.types.ViewLayer) -> RoughnessSource:
    """Write the roughness to an AOV from temporary nodes in all materials (any Blender, any engine)."""
    restorer.callback(setattr, view_layer, "active_aov_index", view_layer.active_aov_index)
    aov = view_layer.aovs.add()
    restorer.callback(view_layer.aovs.remove, aov)
    aov.name = "SSGI Roughness"  # Blender appends a number where the name is taken
    aov.type = "COLOR"

    nodes = RoughnessNodes(restorer)
    target = output_target(view_layer.id_data)
    for material in shaded_materials():
        nodes.write_aov(material.node_tree, aov.name, target)
    name = aov.name
    restorer.change(view_layer, use_pass_glossy_color=True)
    return RoughnessSource(
        (name, "Glossy Color"), lambda layers: _from_aov(layers[name], layers["Glossy Color"])
    )


def _from_denoising_passes(layers: Mapping[str, FloatArray]) -> FloatArray:
    """Undo the weighting of the pass: it counts diffuse light as roughness 1, by the colours' means."""
    diffuse = layers["Diffuse Color"].mean(axis=-1)
    glossy = layers["Glossy Color"].mean(axis=-1)
    is_glossy = glossy > _LEAST_GLOSSY
    weighted = layers["Denoising Roughness"] * (diffuse + glossy) - diffuse
    return _divide(weighted, glossy, is_glossy)


def _from_aov(lobes: FloatArray, glossy_color: FloatArray) -> FloatArray:
    """Divide roughness times weight by weight."""
    roughness = _divide(lobes[..., 0], lobes[..., 1], lobes[..., 1] > _LEAST_GLOSSY)
    is_default_surface = (lobes[..., 1] == 0.0) & (glossy_color.mean(axis=-1) > _LEAST_GLOSSY)
    return np.where(is_default_surface, DEFAULT_SURFACE, roughness)


def _divide(weighted: FloatArray, weight: FloatArray, is_glossy: NDArray[np.bool_]) -> FloatArray:
    roughness = np.full_like(weighted, FULLY_ROUGH)
    np.divide(weighted, weight, out=roughness, where=is_glossy)
    return np.clip(roughness, 0.0, 1.0, out=roughness)
