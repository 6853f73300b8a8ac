# SPDX-License-Identifier: GPL-3.0-or-later
"""What `tuning` may turn: settings and constants that are heuristics, and on which light each is judged.

Constants stay constants: they are set for the time of one evaluation, and none is a user's setting.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

from ssgi_addon.core import (
    Settings,
    bounces,
    carry,
    denoise,
    depth_field,
    fill_level,
    hit_colors,
    pipeline,
    reflections,
    resolve,
)

Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Case:
    """A light to judge by: settings, and what of the frame is used; each without and with a fill."""

    preset: str
    configuration: str = "fill"
    is_traced: bool = True


CASES = {
    "draft": Case("draft"),
    "balanced": Case("balanced"),
    "final": Case("final"),
    # What a job captures by default
    "stations": Case("balanced", "stations, backs, fill"),
    "not traced": Case("balanced", is_traced=False),
}


@dataclass(frozen=True)
class Parameter:
    """A setting or a constant, and the values that it may take.

    Attributes
    ----------
    name
        Of the setting, ``reflections.reuse``; of the constant, ``denoise._PLANE_WIDTH``.
    values
        To try, in order.
    owner
        What holds the constant; None for a setting.
    make
        What a constant is set to for a value, where that is not the value; the values are factors then.
    case
        Which light it is judged by.
    is_of_fill
        It acts where light is brought to the level of a fill, nowhere else; others do not count.
    """

    name: str
    values: tuple[Any, ...]
    owner: Any = None
    make: Callable[[Any], Any] | None = None
    case: str = "balanced"
    is_of_fill: bool = False

    @property
    def attribute(self) -> str:
        """Name within the owner."""
        return self.name.rpartition(".")[2]

    def present(self) -> Any:
        """Return the value that the code has."""
        if self.owner is None:
            return reduce(getattr, self.name.split("."), settings_of(self.case, {}, 0))
        return getattr(self.owner, self.attribute) if self.make is None else 1.0

    def others(self) -> list[Any]:
        """Return the values to try in the first pass."""
        return [value for value in self.values if value != self.present()]

    def around(self, value: Any) -> list[Any]:
        """Return values halfway from one to its neighbours, or beyond it where it is the last."""
        if isinstance(value, (str, tuple)):
            return []
        known = sorted({*self.values, self.present()})
        at = known.index(value)
        # A step beyond the last is as long as the one before it
        before = known[at - 1] if at else 2 * value - known[1]
        after = known[at + 1] if at + 1 < len(known) else 2 * value - before
        found = {before, _between(before, value), _between(value, after), after}
        return sorted(number for number in found - set(known) if number > 0)


def _between(low: Any, high: Any) -> Any:
    """Return the number halfway: whole between whole ones, else the geometric mean where there is one."""
    if isinstance(low, int) and isinstance(high, int):
        return (low + high) // 2
    return round((low * high) ** 0.5 if low > 0.0 else 0.5 * (low + high), 4)


def _constant(owner: Any, name: str, *values: Any, **rest: Any) -> Parameter:
    return Parameter(f"{owner.__name__.rpartition('.')[2]}.{name}", values, owner, **rest)


def _scaled_steps(factor: float) -> tuple[float, ...]:
    return tuple(factor * step for step in _STEPS)


_STEPS = pipeline._LOBE_STEPS

PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter("thickness", (0.025, 0.05, 0.1, 0.2, 0.4)),
        Parameter("unknown", ("environment", "nothing", "mean")),
        Parameter("reflections.edge_fade", (0.0, 0.05, 0.1)),
        Parameter("reflections.hidden_light", (0.0, 0.25, 0.5, 1.0)),
        Parameter("reflections.reuse", (2, 4, 8, 12)),
        Parameter("diffuse.radius", (0.05, 0.1, 0.2, 0.4, 0.8), case="not traced"),
        _constant(denoise, "_LUMINANCE_WIDTH", 2.0, 3.0, 4.0, 6.0, 8.0),
        _constant(denoise, "_PLANE_WIDTH", 0.5, 1.0, 2.0, 4.0),
        _constant(denoise, "_NORMAL_SQUARINGS", 3, 4, 5, 6),
        _constant(denoise, "_NOISE_RADIUS", 2, 3, 5),
        # Of the frame's diffuse light; the default of the filter itself is for glossy light
        _constant(bounces, "GEOMETRIC_LEVELS", 1, 2, 3, 4),
        _constant(denoise.filter_light, "__defaults__", (0,), (1,), (2,), (3,), (4,)),
        _constant(bounces, "_LEVELS", 3, 4, 5),
        _constant(pipeline, "_LOBE_STEPS", 0.5, 0.7, 1.0, 1.4, 2.0, make=_scaled_steps),
        _constant(pipeline, "_BLUR_PER_ALPHA", 0.5, 1.0, 2.0, 4.0),
        _constant(resolve, "_PLANE_WIDTH", 0.5, 1.0, 2.0, 4.0),
        _constant(resolve, "_NORMAL_SQUARINGS", 3, 4, 5, 6),
        _constant(resolve, "_MOST_WEIGHT", 1.5, 2.0, 4.0, 8.0),
        _constant(reflections, "_LEAST_DENSITY", 0.03, 0.1, 0.3, 1.0),
        _constant(hit_colors, "_MOST_LEVEL", 3, 5, 6),
        _constant(hit_colors, "_SURFACE_STEP", 0.02, 0.05, 0.1),
        _constant(depth_field, "_LARGEST_STEP", 0.05, 0.1, 0.2),
        _constant(carry, "_REACH", 1, 2, 3, is_of_fill=True),
        _constant(carry, "_PLANE_WIDTH", 0.5, 1.0, 2.0, 4.0, is_of_fill=True),
        _constant(carry, "_NORMAL_SQUARINGS", 2, 3, 4, 5, 6, is_of_fill=True),
        _constant(carry, "_NEAR", 2.0, 4.0, 8.0, 16.0, is_of_fill=True),
        _constant(fill_level, "_BRIGHTEST", 4.0, 8.0, 16.0, is_of_fill=True),
        _constant(fill_level, "_UNKNOWN_ERROR", 1.0, 2.0, 3.0, 6.0, is_of_fill=True),
        _constant(fill_level, "_LEAST_ERROR", 0.06, 0.13, 0.25, is_of_fill=True),
        _constant(fill_level, "_LEVELS", 1, 2, 3, 4, is_of_fill=True),
        # Nothing but `final` has as many rays: as if no number were many, and as if any were
        _constant(bounces, "_MANY_RAYS", 16, 64, case="final"),
        _constant(bounces, "_SOME_RAYS", 8, 64, case="final"),
    )
}


def settings_of(case: str, changes: Changes, seed: int) -> Settings:
    """Return a case's settings with the changes that are settings, on one thread."""
    settings = replace(Settings.preset(CASES[case].preset), seed=seed, threads=1, fill_mode="level")
    settings = replace(settings, diffuse=replace(settings.diffuse, traced=CASES[case].is_traced))
    for name, value in changes.items():
        if PARAMETERS[name].owner is None:
            group, _, own = name.rpartition(".")
            if group:
                value = replace(getattr(settings, group), **{own: value})
            settings = replace(settings, **{group or own: value})
    return settings


@contextmanager
def applied(changes: Changes) -> Iterator[None]:
    """Set constants for the time of a block."""
    with ExitStack() as stack:
        for name, value in changes.items():
            parameter = PARAMETERS[name]
            owner, attribute = parameter.owner, parameter.attribute
            if owner is not None:
                stack.callback(setattr, owner, attribute, getattr(owner, attribute))
                setattr(owner, attribute, parameter.make(value) if parameter.make else value)
        yield
