# SPDX-License-Identifier: GPL-3.0-or-later
"""What each picture in ``docs/reflections.md`` shows: a scene, a part of it, and settings side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

DIFFERENCE_GAIN = 20

Crop = tuple[int, int, int, int]  # left, top, right, bottom


@dataclass(frozen=True)
class Panel:
    """One of the pictures side by side.

    Attributes
    ----------
    title
        Stands above it.
    options
        What differs from the default reflection settings.
    kind
        ``"ours"``, ``"direct"`` for the direct light alone, ``"cycles"`` for the reference, or
        ``"difference"`` for how far the two panels before it are apart.
    max_steps
        As in `Settings`.
    has_diffuse
        Add the diffuse light, too.
    """

    title: str
    options: Mapping[str, Any] = field(default_factory=dict)
    kind: str = "ours"
    max_steps: int | None = None
    has_diffuse: bool = False


@dataclass(frozen=True)
class Picture:
    """A file's name, the scene, the part of it (None: all), and what stands side by side."""

    name: str
    scene: str
    crop: Crop | None
    panels: tuple[Panel, ...]


def _switch(
    name: str, scene: str, crop: Crop | None, values: tuple[Any, ...], cycles: bool = False, **base: Any
) -> Picture:
    """Return a picture of one setting's values, all else being the same."""
    panels = [Panel(f"{name} {_shown(value)}", {**base, name: value}) for value in values]
    if cycles:
        panels.append(_CYCLES)
    return Picture(name, scene, crop, tuple(panels))


def _shown(value: Any) -> str:
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else str(value).removesuffix(".0")


_CYCLES = Panel("Cycles", kind="cycles")
# Nothing but each pixel's own thin rays
_BARE = {"reuse": 0, "color_pyramid": False, "filter": False}

# Parts of the scenes that several pictures show
_ROUGH_STRIPS, _BALL, _MIRROR = (210, 125, 370, 225), (90, 100, 250, 220), (60, 145, 124, 193)

PICTURES = (
    Picture(
        "overview", "room", (30, 75, 370, 240),
        (Panel("direct light", kind="direct"), Panel("with reflections"), _CYCLES),
    ),
    Picture("lobes", "strips", None, (Panel("defaults"), _CYCLES)),
    Picture(
        "per_pixel", "room", (225, 115, 385, 215), (Panel("rays 16", {"rays": 16}), _CYCLES)
    ),
    Picture(
        "method", "room", (20, 60, 380, 240),
        tuple(
            Panel(f"{name}, 32 cells", {"method": name}, max_steps=32)
            for name in ("linear", "min_z", "hierarchical")
        ),
    ),
    _switch("march_step", "room", _BALL, (0.0, 4.0, 24.0), method="linear"),
    _switch("bisections", "room", _BALL, (0, 2, 5), method="linear", march_step=16.0),
    _switch("rays", "strips", _ROUGH_STRIPS, (1, 4, 64), **_BARE),
    _switch("resolution", "room", (40, 120, 200, 240), ("full", "half", "quarter"), filter=False),
    _switch("roughness_tiers", "strips", _ROUGH_STRIPS, (False, True), True, filter=False),
    Picture(
        "roughness_cutoff", "varnished strips", _ROUGH_STRIPS,
        (
            *(
                Panel(f"roughness_cutoff {_shown(value)}", {"roughness_cutoff": value}, has_diffuse=True)
                for value in (1.0, 0.4)
            ),
            Panel(f"difference x {DIFFERENCE_GAIN}", kind="difference"),
        ),
    ),
    _switch("reuse", "strips", (130, 125, 290, 225), (0, 4, 24), rays=1, color_pyramid=False, filter=False),
    _switch(
        "color_pyramid", "checks", (205, 140, 365, 240), (False, True), True, rays=1, reuse=0, filter=False
    ),
    _switch("subpixel", "checks", _MIRROR, (False, True), True),
    Picture(
        "exact_mirrors", "checks", _MIRROR,
        (
            Panel("exact_mirrors off", {"exact_mirrors": False}),
            Panel("exact_mirrors on"),
            Panel(f"difference x {DIFFERENCE_GAIN}", kind="difference"),
        ),
    ),
    _switch("elongation", "road", (0, 40, 400, 240), (False, True), True, rays=16),
    _switch("edge_fade", "room", (30, 110, 370, 240), (0.0, 0.15), True),
    _switch("hidden_light", "hidden", (120, 90, 280, 210), (0.0, 1.0), True, rays=16),
    _switch("filter", "strips", _ROUGH_STRIPS, (False, True), True),
    _switch("contact_hardening", "checks", (210, 143, 290, 183), (False, True), True),
)  # fmt: skip
