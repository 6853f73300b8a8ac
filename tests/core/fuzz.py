# SPDX-License-Identifier: GPL-3.0-or-later
"""What fuzz tests draw from: arrays, settings, cameras and lights, good ones and others."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from hypothesis import strategies as st

from ssgi_addon.core import Camera, DiffuseSettings, Environment, GBuffer, ReflectionSettings, Settings

Draw = Callable[..., Any]

SEEDS = st.integers(0, 2**32 - 1)
SIZES = ((1, 1), (1, 2), (1, 9), (7, 1), (3, 5), (5, 3), (11, 13), (17, 16), (33, 5))
# What a pixel may hold besides a number of use: no number, no light, too much, too little to count with.
GARBAGE = (
    math.nan, math.inf, -math.inf, -1.0, -0.0, 0.0, 1e300, 1e30, 1.1e15, 9e14, 1e5, 1e-15, 1e-38, 1e-45,
)  # fmt: skip
_SHARES = (0.0, 0.0, 0.01, 0.3, 1.0)
# Range of good values of each pass, and what a pixel has of it.
PASSES: dict[str, tuple[float, float, tuple[int, ...]]] = {
    "depth": (1.0, 9.0, ()),
    "normal": (-1.0, 1.0, (3,)),
    "albedo": (0.0, 1.0, (3,)),
    "specular": (0.0, 1.0, (3,)),
    "roughness": (0.0, 1.0, ()),
    "direct": (0.0, 2.0, (3,)),
    "source": (0.0, 2.0, (3,)),
    "glossy_source": (0.0, 2.0, (3,)),
    "thickness": (0.0, 1.0, ()),
    "reflectance": (0.0, 1.0, (3,)),
}
OPTIONAL = ("source", "glossy_source", "thickness", "reflectance")


def _reversed_view(image: np.ndarray) -> np.ndarray:
    """The same values by negative strides."""
    return np.flip(np.flip(image).copy())


def _every_other(image: np.ndarray) -> np.ndarray:
    """The same values in memory with gaps."""
    wide = np.repeat(image, 2, axis=1)
    return wide[:, ::2]


def _read_only(image: np.ndarray) -> np.ndarray:
    image = image.copy()
    image.setflags(write=False)
    return image


def _whole_numbers(image: np.ndarray) -> np.ndarray:
    return np.nan_to_num(image, posinf=9e18, neginf=-9e18).clip(-9e18, 9e18).astype(np.int64)


FORMS: dict[str, Callable[[np.ndarray], Any]] = {
    "double": lambda image: image,
    "single": lambda image: image.astype(np.float32),
    "half": lambda image: image.astype(np.float16),
    "long double": lambda image: image.astype(np.longdouble),
    "other byte order": lambda image: image.astype(np.dtype(np.float32).newbyteorder()),
    "columns first": np.asfortranarray,
    "reversed": _reversed_view,
    "gaps": _every_other,
    "read-only": _read_only,
    "one pixel, repeated": lambda image: np.broadcast_to(image[:1, :1], image.shape),
    "whole numbers": _whole_numbers,
    "bytes": lambda image: np.nan_to_num(image).clip(0, 255).astype(np.uint8),
    "lists": lambda image: image.tolist(),
    "masked": lambda image: np.ma.masked_less(image, 0.5),
}
WRONG_FORMS: dict[str, Callable[[np.ndarray], Any]] = {
    "booleans": lambda image: image > 0.5,
    "complex": lambda image: image.astype(complex),
    "objects": lambda image: image.astype(object),
    "texts": lambda image: np.full(image.shape, "bright"),
    "dates": lambda image: np.zeros(image.shape, dtype="datetime64[s]"),
    "records": lambda image: np.zeros(image.shape, dtype=[("red", np.float32)]),
    "one row more": lambda image: np.concatenate([image, image[:1]]),
    "one column more": lambda image: np.concatenate([image, image[:, :1]], axis=1),
    "an axis more": lambda image: image[..., None],
    "flat": np.ravel,
    "no pixels": lambda image: image[:0],
    "a number": lambda image: 1.0,
    "ragged lists": lambda image: [[1.0, 2.0], [3.0]],
    "endless numbers": lambda image: [[10**400]],
    "a text": lambda image: "albedo",
    "a mapping": lambda image: {},
}


def _damaged(draw: Draw, shape: Sequence[int], low: float, high: float) -> np.ndarray:
    """Return noise, some of it garbage."""
    rng = np.random.default_rng(draw(SEEDS))
    image = rng.uniform(low, high, shape)
    share = draw(st.sampled_from(_SHARES))
    if share:
        values = draw(st.lists(st.sampled_from(GARBAGE), min_size=1, max_size=3))
        is_bad = rng.random(shape) < share
        image[is_bad] = rng.choice(values, int(is_bad.sum()))
    return image


@st.composite
def images(draw: Draw, shape: Sequence[int], low: float, high: float) -> Any:
    """Numbers of a shape in any form that can be taken."""
    with np.errstate(over="ignore", invalid="ignore"):
        return FORMS[draw(st.sampled_from(sorted(FORMS)))](_damaged(draw, shape, low, high))


@st.composite
def no_images(draw: Draw, shape: Sequence[int]) -> Any:
    """What cannot be taken for numbers of a shape."""
    image = np.random.default_rng(draw(SEEDS)).random(shape)
    return WRONG_FORMS[draw(st.sampled_from(sorted(WRONG_FORMS)))](image)


@st.composite
def passes(draw: Draw, shape: tuple[int, int]) -> dict[str, Any]:
    """The arguments of a G-buffer, each in its own form."""
    return {
        name: draw(images((*shape, *channels), low, high))
        for name, (low, high, channels) in PASSES.items()
        if name not in OPTIONAL or draw(st.booleans())
    }


@st.composite
def gbuffers(draw: Draw, shape: tuple[int, int], layers: int = 2) -> GBuffer:
    """G-buffers of such passes, with or without one behind."""
    behind = draw(gbuffers(shape, layers - 1)) if layers > 1 and draw(st.booleans()) else None
    return GBuffer(**draw(passes(shape)), behind=behind)


# Settings. What costs minutes on the smallest frame is left out.

_COSTLY = {
    "rays": (1, 2, 7),
    "sky_rays": (0, 1, 3),
    "slices": (1, 3),
    "steps": (1, 2, 9),
    "bounces": (1, 2, 64),
}
_NO_NUMBERS = ("3", None, (1,), math.nan, 1j, b"1", np.array([1.0, 2.0]), object(), 10**400, -(10**400))
_OF_ANOTHER_KIND = (1, None, "yes", 1.0, ("full",), ["full"], np.array(["full", "half"]), {}, math.nan)


def good_values(item: Any) -> Sequence[Any]:
    """Return values within the range of a setting: both ends, the default, and some between."""
    rule = item.metadata
    if rule["choices"] is not None:
        return tuple(rule["choices"])
    if isinstance(item.default, bool):
        return (False, True)
    if item.name in _COSTLY:
        return _COSTLY[item.name]
    values = [item.default, *(bound for bound in (rule["min"], rule["max"]) if bound is not None)]
    if isinstance(item.default, float):
        values += [value for value in (0.3, 1e-12, 1e30, 1e300, math.inf) if value >= rule["min"]]
        values = [value for value in values if rule["max"] is None or value <= rule["max"]]
    return tuple(values)


def bad_values(item: Any) -> Sequence[Any]:
    """Return values that a setting must refuse."""
    rule = item.metadata
    if rule["choices"] is not None or isinstance(item.default, bool):
        return tuple(value for value in _OF_ANOTHER_KIND if not isinstance(value, type(item.default)))
    beyond = [rule["min"] - 1] + ([rule["max"] + 1] if rule["max"] is not None else [])
    endless = 10**400 if rule["max"] is None else None
    values = (*beyond, *_NO_NUMBERS, True, "", -math.inf)
    return tuple(value for value in values if value is not endless and not (value is None is item.default))


def variants(kind: type) -> st.SearchStrategy[dict[str, Any]]:
    """Return some good values of a class of settings, by name."""
    options = {
        item.name: st.sampled_from(good_values(item))
        for item in fields(kind)
        if item.metadata and item.name != "threads"
    }
    return st.fixed_dictionaries({}, optional=options)


@st.composite
def settings(draw: Draw) -> Settings:
    """Settings with any values that they may have."""
    return Settings(
        reflections=ReflectionSettings(**draw(variants(ReflectionSettings))),
        diffuse=DiffuseSettings(**draw(variants(DiffuseSettings))),
        threads=draw(st.sampled_from([1, 3])),
        **draw(variants(Settings)),
    )


# Cameras and lights.

_NUMBERS = (1e-300, 1e-30, 1e-12, 1e-6, 1e-3, 0.3, 1.0, 1.9, 3.0, 3.141, 30.0, 1e6, 1e12, 1e30, 1e300)
NUMBERS = st.sampled_from(_NUMBERS)
ANY_NUMBER = st.one_of(
    NUMBERS, st.sampled_from((0.0, -1.0, math.nan, math.inf, None, "1", True, 1j, 10**400))
)


@st.composite
def poses(draw: Draw) -> Any:
    """Poses: rigid, scaled, sheared, far away; and what is none."""
    rng = np.random.default_rng(draw(SEEDS))
    pose = np.eye(4)
    kind = draw(st.sampled_from(["none", "identity", "rigid", "scaled", "sheared", "flat", "bad", "shape"]))
    if kind == "none":
        return None
    if kind in ("rigid", "scaled"):
        pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        pose[:3, 3] = rng.normal(size=3) * draw(NUMBERS)
    if kind == "scaled":
        pose[:3, :3] *= draw(NUMBERS)
    if kind == "sheared":
        pose[:3] = rng.normal(size=(3, 4))
    if kind == "flat":
        pose[1, 1] = 0.0
    if kind == "bad":
        pose[rng.integers(3), rng.integers(4)] = draw(st.sampled_from(GARBAGE))
    return pose[:2] if kind == "shape" else pose


@st.composite
def lenses(draw: Draw, width: Any, height: Any) -> tuple[Callable[..., Camera], dict[str, Any]]:
    """A maker of cameras and its arguments, which need not mean anything."""
    is_orthographic = draw(st.booleans())
    arguments: dict[str, Any] = {"width": width, "height": height}
    arguments["width_units" if is_orthographic else "fov_x"] = draw(st.one_of(st.just(1.1), ANY_NUMBER))
    if draw(st.booleans()):
        arguments["shift_px"] = (draw(ANY_NUMBER), draw(ANY_NUMBER))
    if draw(st.booleans()):
        arguments["pixel_aspect"] = draw(ANY_NUMBER)
    if draw(st.booleans()):
        arguments["world_from_view"] = draw(poses())
    return (Camera.orthographic if is_orthographic else Camera.perspective), arguments


def plain_camera(shape: tuple[int, int], is_orthographic: bool) -> Camera:
    """A camera that nothing is wrong with."""
    make = Camera.orthographic if is_orthographic else Camera.perspective
    return make(shape[1], shape[0], 1.1)


@st.composite
def skies(draw: Draw) -> Environment | None:
    """Environments of any light."""
    kind = draw(st.sampled_from(["none", "white", "image"]))
    if kind == "none":
        return None
    if kind == "white":
        return Environment.constant((1.0, 1.0, 1.0))
    shape = draw(st.sampled_from([(1, 1), (1, 5), (4, 8), (7, 3)]))
    return Environment.equirectangular(draw(images((*shape, 3), 0.0, 2.0)), np.eye(4))
