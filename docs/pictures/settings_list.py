# SPDX-License-Identifier: GPL-3.0-or-later
"""What each picture of `settings_pairs` shows: a setting's values side by side, all else being the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from docs.pictures.array_room import build_sky
from ssgi_addon.core import Environment

_GREY_SKY = (0.30, 0.33, 0.40)


@dataclass(frozen=True)
class Panel:
    """One of the pictures side by side.

    Attributes
    ----------
    title
        Stands above it.
    settings
        What differs from the default settings, by names such as ``diffuse.rays``.
    kinds
        Views that are captured beside the frame.
    with_fill
        Take the path-traced fill.
    layers
        Of the frame's own: ``back_faces``, ``behind``.
    """

    title: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    kinds: tuple[str, ...] = ()
    with_fill: bool = False
    layers: Mapping[str, bool] = field(default_factory=dict)


@dataclass(frozen=True)
class Picture:
    """Panels of one setting.

    Attributes
    ----------
    panels
        From the left.
    shows
        ``picture``, ``diffuse``, ``glossy`` or ``visibility``.
    outdoors
        Take the yard in place of the room.
    environment
        Makes what escaping rays bring.
    gain
        How many times as large as it is a last panel shows the difference of two; 0 shows none.
    """

    panels: tuple[Panel, ...]
    shows: str = "diffuse"
    outdoors: bool = False
    environment: Callable[[], Environment] | None = None
    gain: int = 0


def _pair(name: str, values: Sequence[Any], shows: str = "diffuse", **base: Any) -> Picture:
    """Return a picture of one setting's values, all else being the same; dots in names are written as __."""
    shared = {key.replace("__", "."): value for key, value in base.items()}
    label = name.rpartition(".")[2]
    panels = [Panel(f"{label} {_shown(value)}", {**shared, name: value}) for value in values]
    return Picture(tuple(panels), shows)


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return value if isinstance(value, str) else f"{value:g}"


def _views(title: str, *kinds: str, **settings: Any) -> Panel:
    return Panel(title, {"diffuse.rays": 16, **{k.replace("__", "."): v for k, v in settings.items()}}, kinds)


_SURROUNDED = ("surround",)
_ALL_AROUND = ("surround", "stations")
_MANY = {"diffuse.rays": 16}

PICTURES: Mapping[str, Picture] = {
    "diffuse/method": Picture(
        (
            Panel("hemisphere, 16 rays", {"diffuse.rays": 16}),
            Panel("horizon, 4 slices", {"diffuse.method": "horizon", "diffuse.slices": 4}),
        )
    ),
    "diffuse/rays": _pair("diffuse.rays", (1, 32), diffuse__filter=False),
    "diffuse/adaptive": _pair("diffuse.adaptive", (0.0, 0.5), diffuse__rays=64, diffuse__filter=False),
    "diffuse/resolution": _pair("diffuse.resolution", ("full", "quarter"), diffuse__rays=4),
    "diffuse/traced": _pair("diffuse.traced", (True, False), diffuse__rays=16),
    "diffuse/radius": _pair(
        "diffuse.radius", (0.05, 0.5), "visibility", diffuse__method="ssao", diffuse__rays=32
    ),
    "diffuse/slices": _pair("diffuse.slices", (1, 8), diffuse__method="bitmask", diffuse__filter=False),
    "diffuse/steps": _pair("diffuse.steps", (3, 48), diffuse__method="bitmask", diffuse__slices=4),
    "diffuse/bounces": _pair("diffuse.bounces", (1, 6), diffuse__rays=16),
    "diffuse/sky_rays": replace(
        _pair("diffuse.sky_rays", (0, 8), "picture", diffuse__rays=4), outdoors=True, environment=build_sky
    ),
    "diffuse/filter": _pair("diffuse.filter", (False, True), diffuse__rays=2),
    "shared/unknown": Picture(
        tuple(Panel(name, {**_MANY, "unknown": name}) for name in ("nothing", "environment", "mean")),
        environment=lambda: Environment.constant(_GREY_SKY),
    ),
    "shared/fill_mode": Picture(
        tuple(
            Panel(f"fill_mode {mode}", {"fill_mode": mode, "diffuse.rays": 2}, with_fill=True)
            for mode in ("level", "replace")
        )
    ),
    "shared/filled_roughness": Picture(
        tuple(
            Panel(
                f"filled_roughness {value:g}",
                {"fill_mode": "replace", "filled_roughness": value, "reflections.rays": 4},
                _ALL_AROUND,
                with_fill=True,
            )
            for value in (0.0, 0.3)
        ),
        "glossy",
        gain=4,
    ),
    "shared/visibility": Picture(
        tuple(
            Panel(
                f"visibility {_shown(value)}", {"fill_mode": "replace", "visibility": value}, with_fill=True
            )
            for value in (False, True)
        ),
        "visibility",
    ),
    "shared/thickness": _pair("thickness", (0.01, 1.0), diffuse__rays=16),
    "shared/max_distance": _pair("max_distance", (0.4, 4.0), diffuse__rays=16),
    "shared/max_steps": _pair("max_steps", (8, 96), diffuse__rays=16),
    "shared/seed": _pair("seed", (0, 1), diffuse__rays=2, diffuse__filter=False),
    "beyond_the_frame/budget": Picture(
        (_views("budget 0: the frame alone"), _views("enough: surround, stations", *_ALL_AROUND))
    ),
    "beyond_the_frame/fill": Picture((Panel("fill 0"), Panel("fill, level", with_fill=True))),
    "beyond_the_frame/mirrors_only": Picture(
        tuple(
            Panel(title, {"fill_mode": "replace", "reflections.rays": 4}, kinds, with_fill=True)
            for title, kinds in (("no view for the mirror", ()), ("views for the mirror", _ALL_AROUND))
        ),
        "picture",
    ),
    "beyond_the_frame/surround": Picture((_views("surround 0"), _views("surround 128", *_SURROUNDED))),
    "beyond_the_frame/overscan": Picture((_views("overscan 1"), _views("overscan 1.5", "overscan"))),
    "beyond_the_frame/stations": Picture(
        (_views("stations 0", *_SURROUNDED), _views("stations 8", *_ALL_AROUND)), gain=4
    ),
    "beyond_the_frame/light_views": Picture((_views("light_views 0"), _views("light_views 1", "lamp"))),
    "beyond_the_frame/back_faces": Picture(
        tuple(
            Panel(f"back_faces {_shown(value)}", _MANY, _ALL_AROUND, layers={"back_faces": value})
            for value in (False, True)
        ),
        gain=4,
    ),
    "beyond_the_frame/behind": Picture(
        tuple(
            Panel(f"behind {_shown(value)}", _MANY, layers={"back_faces": True, "behind": value})
            for value in (False, True)
        ),
        gain=4,
    ),
}
