# SPDX-License-Identifier: GPL-3.0-or-later
"""Every setting once: default, range, unit and help text.

The Blender properties, the command-line options and the documentation are made from the metadata here.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

# As far as depth goes: squares of distances must stay numbers in single precision.
_FARTHEST = 1e15


def option(
    default: Any,
    help: str,
    *,
    label: str,
    unit: str = "",
    min: float | None = None,
    max: float | None = None,
    soft_max: float | None = None,
    choices: Mapping[str, str] | None = None,
    methods: Sequence[str] | None = None,
) -> Any:
    """Declare one setting of a settings dataclass.

    `choices` maps the values that may be chosen to their help texts; `methods` are those methods that the
    setting is for, None means all.
    """
    metadata = {
        "label": label,
        "help": help,
        "unit": unit,
        "min": min,
        "max": max,
        "soft_max": soft_max,
        "choices": None if choices is None else tuple(choices),
        "choice_help": dict(choices or {}),
        "methods": None if methods is None else tuple(methods),
    }
    return field(default=default, metadata=metadata)


def _validate(settings: Any) -> None:
    """Raise ValueError for the first field whose value is of the wrong type or out of range."""
    for item in fields(settings):
        if not item.metadata:
            continue
        name, rule = f"{type(settings).__name__}.{item.name}", item.metadata
        value = getattr(settings, item.name)
        if rule["choices"] is not None:
            if not (isinstance(value, str) and value in rule["choices"]):
                raise ValueError(f"{name}: expected one of {', '.join(rule['choices'])}, got {value!r}")
        elif isinstance(item.default, bool):
            if not isinstance(value, bool):
                raise ValueError(f"{name}: expected True or False, got {value!r}")
        elif value is None:
            if item.default is not None:
                raise ValueError(f"{name}: expected a number, got None")
        else:
            is_integer = isinstance(item.default, int) or item.default is None
            _validate_number(name, value, rule, is_integer=is_integer)


def _validate_number(name: str, value: Any, rule: Any, *, is_integer: bool) -> None:
    if not (_is_integer(value) if is_integer else _is_real(value)):
        raise ValueError(f"{name}: expected {'an integer' if is_integer else 'a number'}, got {value!r}")
    if rule["min"] is not None and value < rule["min"]:
        raise ValueError(f"{name}: expected at least {rule['min']}, got {value!r}")
    if rule["max"] is not None and value > rule["max"]:
        raise ValueError(f"{name}: expected at most {rule['max']}, got {value!r}")


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_real(value: Any) -> bool:
    """Return whether a value is a number that a float can hold."""
    if _is_integer(value):
        return bool(abs(value) <= sys.float_info.max)
    return isinstance(value, float) and not math.isnan(value)


@dataclass(frozen=True)
class ReflectionSettings:
    """Screen-space reflections: the glossy indirect light.

    Raises
    ------
    ValueError
        If a value is out of its range; the text names the field.
    """

    enabled: bool = option(True, "Trace reflection rays", label="Reflections")
    method: str = option(
        "hierarchical",
        "Way in which rays walk the depth buffer. Without steps of their own all find the same hits",
        label="Method",
        choices={
            "linear": "Look into pixel by pixel, or take steps",
            "min_z": "Skip empty space by a pyramid of nearest depths",
            "hierarchical": "Skip by a pyramid of nearest and farthest depths, the fastest",
        },
    )
    march_step: float = option(
        0.0,
        "Distance of the samples along a ray, for the linear method alone. 0 looks into every pixel that the "
        "ray crosses; longer steps are faster and miss what lies between them. Below 1/32 counts as 1/32",
        label="March Step",
        unit="pixels",
        min=0.0,
        max=1024.0,
        soft_max=16.0,
        methods=("linear",),
    )
    bisections: int = option(
        5,
        "Times that the step which holds a hit is halved, where the linear method takes steps",
        label="Bisections",
        min=0,
        max=16,
        methods=("linear",),
    )
    rays: int = option(
        1,
        "Reflection rays per pixel; mirrors always take one exact ray",
        label="Rays",
        unit="rays/pixel",
        min=1,
        max=4096,
        soft_max=64,
    )
    resolution: str = option(
        "full",
        "Pixels that trace rays; those between take the rays around them by their own depth, normal and "
        "roughness. Mirrors are always traced in full",
        label="Resolution",
        choices={
            "full": "Trace rays from every pixel",
            "half": "Trace rays from one of every 2 x 2 pixels",
            "quarter": "Trace rays from one of every 4 x 4 pixels",
        },
    )
    roughness_tiers: bool = option(
        False,
        "Trace rough surfaces at half the resolution: their reflections are wide",
        label="Fewer Rays on Rough Surfaces",
    )
    roughness_cutoff: float = option(
        1.0,
        "Surfaces rougher than this, except metals, trace no reflection rays and take their diffuse light "
        "as glossy light: their lobes are nearly as wide as the hemisphere. 1 traces them all",
        label="Roughness Cutoff",
        min=0.0,
        max=1.0,
    )
    reuse: int = option(
        4,
        "Neighboring pixels whose rays each pixel takes too, weighted by its own lobe",
        label="Reuse",
        unit="pixels",
        min=0,
        max=48,
        soft_max=24,
    )
    color_pyramid: bool = option(
        True,
        "Read what a ray finds as wide as the part of the lobe that the ray stands for",
        label="Cone Footprint",
    )
    subpixel: bool = option(
        True, "Read what a ray finds between pixels, not at the nearest one's center", label="Subpixel Hits"
    )
    exact_mirrors: bool = option(
        True, "Trace one exact ray from mirrors; otherwise they have very narrow lobes", label="Exact Mirrors"
    )
    elongation: bool = option(
        True,
        "Stretch reflections toward the viewer at grazing angles, as microfacets do; "
        "otherwise lobes are round",
        label="Elongation",
    )
    edge_fade: float = option(
        0.0,
        "Fade reflections of what lies nearer to the border of the frame than this fraction of its width; "
        "never where further views go on beyond it",
        label="Edge Fade",
        min=0.0,
        max=0.5,
    )
    hidden_light: float = option(
        0.0,
        "Light of rays that end behind something, as a fraction of what the pixel's other rays find",
        label="Hidden Light",
        min=0.0,
        max=1.0,
    )
    filter: bool = option(
        True, "Smooth the noise of rough reflections along surfaces; mirrors stay untouched", label="Denoise"
    )
    contact_hardening: bool = option(
        True,
        "Smooth less where what is reflected is near, so that reflections stay sharp at the contact",
        label="Contact Hardening",
    )

    def __post_init__(self) -> None:
        _validate(self)


@dataclass(frozen=True)
class DiffuseSettings:
    """Screen-space directional occlusion: the diffuse indirect light and the visibility.

    Raises
    ------
    ValueError
        If a value is out of its range; the text names the field.
    """

    enabled: bool = option(True, "Trace diffuse rays", label="Diffuse")
    method: str = option(
        "hemisphere",
        "Way in which the hemisphere above each pixel is sampled",
        label="Method",
        choices={
            "hemisphere": "Follow rays to what they meet",
            "horizon": "March slices of the hemisphere up to a horizon: everything is infinitely thick",
            "bitmask": "March slices of the hemisphere, in sectors that single things cover",
            "ssao": "Test points for whether they lie within surfaces: visibility alone, no light",
        },
    )
    rays: int = option(
        2,
        "Directions over the hemisphere per pixel",
        label="Rays",
        unit="rays/pixel",
        min=1,
        max=4096,
        soft_max=128,
        methods=("hemisphere", "ssao"),
    )
    adaptive: float = option(
        0.0,
        "Error of a pixel's light, as a fraction of the picture, below which it takes no more rays: each has "
        "4, and then as many more as it needs, up to all. 0 traces all of them",
        label="Adaptive",
        min=0.0,
        soft_max=1.0,
        methods=("hemisphere",),
    )
    resolution: str = option(
        "full",
        "Pixels that are sampled; those between take what is around them by their own depth and normal, and "
        "what has nothing on its own surface is sampled too",
        label="Resolution",
        choices={
            "full": "Sample every pixel",
            "half": "Sample one of every 2 x 2 pixels",
            "quarter": "Sample one of every 4 x 4 pixels",
        },
        methods=("hemisphere", "ssao"),
    )
    traced: bool = option(
        True,
        "Follow the hemisphere's directions to what they meet; otherwise test one point along each, as "
        "screen-space directional occlusion was published",
        label="Traced",
        methods=("hemisphere",),
    )
    radius: float = option(
        0.2,
        "Largest distance of the points that are tested, relative to the surface's distance from the camera "
        "(orthographic: to the width of the view); for ssao, and for a hemisphere that is not traced",
        label="Radius",
        min=1e-4,
        max=10.0,
        soft_max=1.0,
        methods=("hemisphere", "ssao"),
    )
    slices: int = option(
        1,
        "Slices of the hemisphere per pixel, for the horizon and the bitmask method",
        label="Slices",
        unit="slices/pixel",
        min=1,
        max=64,
        soft_max=8,
        methods=("horizon", "bitmask"),
    )
    steps: int = option(
        16,
        "Pixels that are read along each side of a slice, ever farther apart, up to the frame's border",
        label="Steps",
        unit="pixels/side",
        min=1,
        max=256,
        soft_max=64,
        methods=("horizon", "bitmask"),
    )
    bounces: int = option(
        6,
        "Number of times that light is reflected before it reaches the visible surface; "
        "1 is light that was reflected once",
        label="Bounces",
        min=1,
        max=64,
        soft_max=8,
        methods=("hemisphere", "horizon", "bitmask"),
    )
    sky_rays: int = option(
        2,
        "Shadow rays per pixel toward what is much brighter than the rest of an environment, such as the sun "
        "in an image of a sky. 0 leaves it to the rays over the hemisphere, few of which meet it; a single "
        "one is not smoothed, since it takes two to tell noise from a shadow",
        label="Bright Sky Rays",
        unit="rays/pixel",
        min=0,
        max=4096,
        soft_max=16,
    )
    filter: bool = option(True, "Smooth the noise of few rays along surfaces", label="Denoise")

    def __post_init__(self) -> None:
        _validate(self)


@dataclass(frozen=True)
class Settings:
    """All settings of `render_indirect`; frozen, so `dataclasses.replace` makes variants.

    Raises
    ------
    ValueError
        If a value is out of its range, or a group of the wrong type; the text names the field.
    """

    reflections: ReflectionSettings = field(default_factory=ReflectionSettings)
    diffuse: DiffuseSettings = field(default_factory=DiffuseSettings)
    unknown: str = option(
        "environment",
        "Light of samples that neither the frame nor another view can answer",
        label="Unknown",
        choices={
            "environment": "Take the environment's light",
            "nothing": "Take no light",
            "mean": "Take the mean of the samples that were answered",
        },
    )
    fill_mode: str = option(
        "level",
        "What a fill is for. Presets take its light in place of rays; one that is not denoised only ever "
        "sets the level",
        label="Fill Mode",
        choices={
            "level": "Rays find the light everywhere, and the fill sets its level",
            "replace": "A denoised fill brings the light; rays are left to sharp reflections and visibility",
        },
    )
    filled_roughness: float = option(
        0.2,
        "Where a fill brings the light, surfaces rougher than this trace no reflection rays and take the "
        "fill's glossy light. 1 traces them all",
        label="Filled Roughness",
        min=0.0,
        max=1.0,
    )
    visibility: bool = option(
        True,
        "Where a fill brings the light, trace a few diffuse rays all the same, for the visibility and for "
        "what is known",
        label="Visibility",
    )
    thickness: float = option(
        0.1,
        "Depth behind a visible surface that counts as solid, relative to its distance from the camera "
        "(orthographic: to the width of the view), where no thickness was captured",
        label="Thickness",
        min=0.0,
        max=1e6,
        soft_max=1.0,
    )
    max_distance: float = option(
        math.inf,
        "Distance that rays reach, in scene units",
        label="Distance",
        unit="scene units",
        min=0.0,
        soft_max=1000.0,
    )
    max_steps: int | None = option(
        None,
        "Cells of the depth pyramid that a ray may look at; one that is not done by then brings no answer",
        label="Steps",
        min=1,
        max=1_000_000,
    )
    seed: int = option(0, "Seed of the sampling pattern", label="Seed", min=0, max=2**31 - 1)
    threads: int | None = option(
        None,
        "Worker threads; their number never changes a result",
        label="Threads",
        min=1,
        max=1024,
    )

    def __post_init__(self) -> None:
        for name, kind in (("reflections", ReflectionSettings), ("diffuse", DiffuseSettings)):
            if not isinstance(getattr(self, name), kind):
                raise ValueError(f"Settings.{name}: expected {kind.__name__}, got {getattr(self, name)!r}")
        _validate(self)

    @property
    def reach(self) -> float:
        """`max_distance`, endless where that is more than single precision can count with."""
        return float(self.max_distance) if self.max_distance <= _FARTHEST else math.inf

    @classmethod
    def preset(cls, name: str) -> Settings:
        """Return one of the named points between speed and accuracy.

        Parameters
        ----------
        name
            ``"draft"``, ``"balanced"`` or ``"final"``.

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        if name not in PRESETS:
            raise ValueError(f"preset: expected one of {', '.join(PRESETS)}, got {name!r}")
        changes = dict(PRESETS[name])
        base = cls()
        return replace(
            base,
            diffuse=replace(base.diffuse, **changes.pop("diffuse")),
            reflections=replace(base.reflections, **changes.pop("reflections")),
            **changes,
        )


# What presets change: points on the frontier of error against time over real scenes together (ADR 21, 22).
PRESETS: dict[str, dict[str, Any]] = {
    "draft": {
        "diffuse": {"resolution": "quarter", "rays": 4, "bounces": 6},
        "reflections": {"rays": 1, "roughness_cutoff": 0.7},
        "fill_mode": "replace",
        "filled_roughness": 0.0,
        "visibility": False,
        "max_steps": 96,
    },
    "balanced": {
        "diffuse": {"rays": 2, "bounces": 6},
        "reflections": {"rays": 1, "roughness_cutoff": 0.7},
        "fill_mode": "replace",
    },
    "final": {
        "diffuse": {"rays": 32, "bounces": 8},
        "reflections": {"rays": 16},
        "fill_mode": "replace",
    },
}
