# SPDX-License-Identifier: GPL-3.0-or-later
"""The G-buffer: what the camera sees, one surface sample per pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .types import BoolArray, FloatArray

# Above this a value is garbage from a broken pixel, not light (Blender writes 1e10 and 1e11 for "nothing").
LARGEST = 1e15
# Below this a depth is garbage too: its inverse must stay a number.
_SMALLEST_DEPTH = 1.0 / LARGEST
_SHORTEST_NORMAL = 1e-3


@dataclass(frozen=True, eq=False)
class GBuffer:
    """One visible surface per pixel, with the light that reaches the camera without any bounce.

    Construction validates shapes and cleans values: a pixel of a pass that holds something non-finite,
    negative (where that has no meaning) or above 1e15 becomes black, or background for depth and normal;
    nothing else changes, and the arrays passed in are never modified.

    Attributes
    ----------
    depth : (H, W) float32
        Distance along the view axis, scene units; +inf on background.
    normal : (H, W, 3) float32
        Unit shading normal, view space; zero on background.
    albedo : (H, W, 3) float32
        Diffuse colour.
    specular : (H, W, 3) float32
        Glossy colour: the directional albedo of the glossy lobe, Fresnel included.
    roughness : (H, W) float32
        As on the Principled BSDF, 0..1; GGX alpha is its square.
    direct : (H, W, 3) float32
        Radiance toward the camera without any bounce, scene-linear.
    source : (H, W, 3) float32, optional
        Radiance that a surface hands on to diffuse rays; None means `direct`.
    glossy_source : (H, W, 3) float32, optional
        Radiance that a surface hands on to reflection rays; None means `source`.
    thickness : (H, W) float32, optional
        Distance from the front to the back face along the view axis; None means relative to depth.
    behind : GBuffer, optional
        The next layer behind this one, seen from the same camera.
    reflectance : (H, W, 3) float32, optional
        Share of the light of earlier bounces that a surface hands on; None means `albedo`. With gloss it is
        more than the albedo, and does not depend on the camera's angle.

    Raises
    ------
    ValueError
        If an array has the wrong shape or does not hold real numbers.
    """

    depth: FloatArray
    normal: FloatArray
    albedo: FloatArray
    specular: FloatArray
    roughness: FloatArray
    direct: FloatArray
    source: FloatArray | None = None
    glossy_source: FloatArray | None = None
    thickness: FloatArray | None = None
    behind: GBuffer | None = None
    reflectance: FloatArray | None = None

    def __post_init__(self) -> None:
        given = as_array("depth", self.depth)
        shape = given.shape
        if len(shape) != 2 or 0 in shape:
            raise ValueError(f"depth: expected shape (H, W) with H, W >= 1, got {shape}")
        depth = as_float32("depth", given, shape)
        normal = as_float32("normal", self.normal, (*shape, 3))
        depth, normal = _clean_geometry(depth, normal)
        set_field = object.__setattr__  # the dataclass is frozen
        set_field(self, "depth", depth)
        set_field(self, "normal", normal)
        for name in ("albedo", "specular", "direct", "source", "glossy_source", "reflectance"):
            value = getattr(self, name)
            if value is not None or name in ("albedo", "specular", "direct"):
                set_field(self, name, _clean_light(as_float32(name, value, (*shape, 3))))
        roughness = _clean_light(as_float32("roughness", self.roughness, shape))
        set_field(self, "roughness", np.minimum(roughness, 1.0))
        if self.thickness is not None:
            thickness = as_float32("thickness", self.thickness, shape)
            is_solid = np.isposinf(thickness)
            set_field(self, "thickness", np.where(is_solid, np.float32(np.inf), _clean_light(thickness)))
        if self.behind is not None:
            if not isinstance(self.behind, GBuffer):
                raise ValueError(f"behind: expected a GBuffer, got {type(self.behind).__name__}")
            if self.behind.depth.shape != shape:
                raise ValueError(
                    f"behind: expected a GBuffer of shape {shape}, got {self.behind.depth.shape}"
                )

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W), pixels."""
        return self.depth.shape[0], self.depth.shape[1]

    @property
    def is_background(self) -> BoolArray:
        """(H, W) True where no surface is seen."""
        return np.isinf(self.depth)

    @property
    def diffuse_source(self) -> FloatArray:
        """(H, W, 3) radiance handed on to diffuse rays, that is `source`, or `direct` where there is none."""
        return self.direct if self.source is None else self.source

    @property
    def bounce_albedo(self) -> FloatArray:
        """(H, W, 3) share of earlier bounces' light that is handed on, that is `reflectance`, or `albedo`."""
        return self.albedo if self.reflectance is None else self.reflectance

    @property
    def reflection_source(self) -> FloatArray:
        """(H, W, 3) radiance handed on to reflection rays, that is `glossy_source`, or `diffuse_source`."""
        return self.diffuse_source if self.glossy_source is None else self.glossy_source


def as_float32(name: str, value: object, shape: tuple[int, ...]) -> FloatArray:
    """Return a C-contiguous float32 array, or raise ValueError naming what is not one of that shape."""
    array = as_array(name, value)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: expected real numbers, got dtype {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    with np.errstate(over="ignore"):  # float64 beyond float32's range becomes inf, which is cleaned
        return np.ascontiguousarray(array, dtype=np.float32)


def as_array(name: str, value: object) -> np.ndarray[Any, Any]:
    """Return an array, or raise ValueError naming what is none."""
    try:
        return np.asarray(value)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(
            f"{name}: expected an array of numbers, got {type(value).__name__}: {error}"
        ) from error


def _is_good(array: FloatArray) -> BoolArray:
    return (array >= 0.0) & (array <= LARGEST)  # False for NaN


def _clean_light(array: FloatArray) -> FloatArray:
    """Return `array` with bad pixels black; a pixel is bad when any of its channels is."""
    is_good = _is_good(array)
    if is_good.all():
        return array
    if array.ndim == 3:
        is_good = is_good.all(axis=-1, keepdims=True)
    return np.where(is_good, array, np.float32(0.0))


def _clean_geometry(depth: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return depth with +inf and unit normals with zero on background and on bad pixels."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt((normal * normal).sum(axis=-1))
    is_surface = (depth >= _SMALLEST_DEPTH) & (depth <= LARGEST)
    is_surface &= (length > _SHORTEST_NORMAL) & (length <= LARGEST)
    depth = np.where(is_surface, depth, np.float32(np.inf))
    safe_length = np.where(is_surface, length, np.float32(1.0))
    normal = np.where(is_surface[..., None], normal, np.float32(0.0)) / safe_length[..., None]
    return depth, normal
