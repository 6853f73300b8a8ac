# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames from multilayer EXR files that Cycles wrote, long ago perhaps and without us."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .core import Camera, GBuffer
from .core.pose import solve_camera
from .errors import SSGIError
from .exr import FloatArray
from .frame import CapturedFrame
from .surface_light import handed_on, reflectance

# Cycles writes 1e10 for sky and 1e11 outside a render border.
FARTHEST_SURFACE = 1e9
# Names of a value AOV that a user may have sent the roughness to.
ROUGHNESS_PASSES = ("SSGI Roughness", "Roughness")
ROUGHNESS_UNKNOWN = 0.5
DARKEST_GLOSSY = 1e-4

GEOMETRY = ("Depth", "Normal")
LIGHT = ("Diffuse Color", "Diffuse Direct", "Glossy Color", "Glossy Direct")
# Either pair says what is neither diffuse nor glossy: the passes, or the picture without its bounces.
OTHER_LIGHT = ("Emission", "Environment")
BOUNCES = ("Combined", "Diffuse Indirect", "Glossy Indirect")
# What comes through glass and fog, where the file has it
THROUGH = ("Transmission Color", "Transmission Direct", "Transmission Indirect", "Volume Direct")

Passes = Mapping[str, FloatArray]


def frame_from_blender(path: Path, layers: Passes, camera: Camera | None) -> CapturedFrame:
    """Make a captured frame from the passes of a Cycles render.

    Direct light is the sum of the direct passes with emission, environment and what came through glass,
    so the file may be a render with or without bounces.

    Parameters
    ----------
    path
        Names the file in messages.
    layers
        Passes by their long names, ``<view layer>.<pass>`` where the file has several view layers: the
        one that lacks the fewest passes counts.
    camera
        None: solved from Position and Depth.

    Raises
    ------
    SSGIError
        If passes are missing (each is named) or no camera fits.
    """
    passes = _complete_layer(path, layers, needs_position=camera is None)
    _check_channels(path, passes)
    depth = np.where(passes["Depth"] < FARTHEST_SURFACE, passes["Depth"], np.float32(np.inf))
    if camera is None:
        camera = _solve(path, passes["Position"], depth)
    if (camera.height, camera.width) != depth.shape:
        height, width = depth.shape
        raise SSGIError(
            f"{path} has {width} x {height} pixels, its camera {camera.width} x {camera.height}: "
            "use the camera of this picture"
        )
    with np.errstate(all="ignore"):  # bad pixels, which the G-buffer cleans
        roughness, notes = _roughness(passes)
        gbuffer = _gbuffer(passes, depth, roughness, camera)
    return CapturedFrame(
        gbuffer=gbuffer,
        camera=camera,
        environment=None,
        engine="cycles",
        emission_in_direct=True,
        world_in_direct=True,
        layers={name: values for name, values in passes.items() if values.shape[2:] in ((), (3,))},
        notes=tuple(notes),
    )


def _gbuffer(passes: Passes, depth: FloatArray, roughness: FloatArray, camera: Camera) -> GBuffer:
    diffuse = passes["Diffuse Color"] * passes["Diffuse Direct"]
    glossy = passes["Glossy Color"] * passes["Glossy Direct"]
    normal = passes["Normal"] @ camera.world_from_view[:3, :3]  # Blender's pass is in world space
    return GBuffer(
        depth=depth,
        normal=normal,
        albedo=passes["Diffuse Color"],
        specular=passes["Glossy Color"],
        roughness=roughness,
        direct=_direct_light(passes, diffuse + glossy),
        source=handed_on(passes, roughness),
        glossy_source=diffuse + glossy,
        reflectance=reflectance(passes["Diffuse Color"], passes["Glossy Color"], normal, camera),
    )


def _check_channels(path: Path, passes: Passes) -> None:
    """Refuse passes with other channels than Blender's: three, but for depth and roughness."""
    for name in (*GEOMETRY, "Position", *LIGHT, *OTHER_LIGHT, *BOUNCES, *THROUGH, "Denoising Roughness"):
        expected = 1 if name in ("Depth", "Denoising Roughness") else 3
        found = 1 if passes.get(name, np.empty(0)).ndim < 3 else passes[name].shape[2]
        if name in passes and found != expected:
            raise SSGIError(
                f"{path}: {name} has {found} channels, expected {expected}; write the passes with Blender's "
                "own names and channels"
            )


def _complete_layer(path: Path, layers: Passes, *, needs_position: bool) -> dict[str, FloatArray]:
    """Passes of the view layer that lacks the fewest; refuse with their names if it lacks any."""
    by_layer: dict[str, dict[str, FloatArray]] = {}
    for name, values in layers.items():
        layer, _, pass_name = name.rpartition(".")
        by_layer.setdefault(layer, {})[pass_name] = values
    passes = min(by_layer.values(), key=lambda found: len(_missing(found, needs_position=needs_position)))
    missing = _missing(passes, needs_position=needs_position)
    if missing:
        hint = ", or give the camera with --camera" if missing == ["Position"] else ""
        raise SSGIError(
            f"{path} lacks the {'passes' if len(missing) > 1 else 'pass'} {', '.join(missing)}: "
            f"switch them on under View Layer > Passes and render it again{hint}"
        )
    return passes


def _missing(passes: Passes, *, needs_position: bool) -> list[str]:
    needed = [*GEOMETRY, *(["Position"] if needs_position else []), *LIGHT]
    if not passes.keys() >= set(BOUNCES):
        needed += OTHER_LIGHT
    return [name for name in needed if name not in passes]


def _solve(path: Path, position_ws: FloatArray, depth: FloatArray) -> Camera:
    if position_ws.shape != (*depth.shape, 3):
        raise SSGIError(f"{path}: Position has shape {position_ws.shape}; write it as Blender does")
    try:
        with np.errstate(all="ignore"):  # positions may be anything, and a camera that fits none is refused
            return solve_camera(position_ws, depth)
    except ValueError as error:
        raise SSGIError(f"{path}: {error}; give the camera with --camera FILE.json") from error


def _direct_light(passes: Passes, diffuse_and_glossy: FloatArray) -> FloatArray:
    """Everything that reaches the camera but for diffuse and glossy bounces."""
    if not passes.keys() >= set(OTHER_LIGHT):
        indirect = (
            passes["Diffuse Color"] * passes["Diffuse Indirect"]
            + passes["Glossy Color"] * passes["Glossy Indirect"]
        )
        return np.maximum(passes["Combined"] - indirect, 0.0)
    direct = diffuse_and_glossy + passes["Emission"] + passes["Environment"]
    if "Transmission Color" in passes:
        for name in ("Transmission Direct", "Transmission Indirect"):
            if name in passes:
                direct = direct + passes["Transmission Color"] * passes[name]
    if "Volume Direct" in passes:
        direct = direct + passes["Volume Direct"]
    return direct


def _roughness(passes: Passes) -> tuple[FloatArray, list[str]]:
    for name in ROUGHNESS_PASSES:
        if name in passes and passes[name].ndim == 2:
            return passes[name], []
    if "Denoising Roughness" in passes:
        # Cycles mixes 1 for the diffuse share with the glossy lobe's roughness, by their albedo.
        diffuse = passes["Diffuse Color"].mean(axis=-1)
        glossy = passes["Glossy Color"].mean(axis=-1)
        mixed = passes["Denoising Roughness"] * (diffuse + glossy) - diffuse
        is_glossy = glossy > DARKEST_GLOSSY
        unmixed = np.divide(mixed, glossy, out=np.ones_like(mixed), where=is_glossy)
        return np.clip(unmixed, 0.0, 1.0), []
    note = f"no roughness pass was found, so every surface counts as {ROUGHNESS_UNKNOWN} rough"
    return np.full_like(passes["Depth"], ROUGHNESS_UNKNOWN), [note]
