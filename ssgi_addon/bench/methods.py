# SPDX-License-Identifier: GPL-3.0-or-later
"""What is measured: each way to a picture, with its samples, as one list that follows the presets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ..core.settings import PRESETS
from ..job_options import DEFAULT_PRESET, JobOptions

DENOISERS = {"raw": "", "fastest": " + fastest denoise", "best": " + best denoise"}
GI_LADDER = (1, 2, 4, 8, 16, 32, 64)
FAST_GI_LADDER = (1, 4, 16)
OURS_LADDER = (1, 2, 4, 8, 16, 32)
EEVEE_SAMPLES = 16
# A quick run: fewer steps of each ladder, by denoiser.
_QUICK_LADDERS = {"raw": (1, 4), "fastest": (1, 2, 4, 8, 16), "best": (4,)}
_QUICK_OURS_LADDER = (1, 4)
_QUICK_SWITCHES = ("bitmask", "without fill")
# A layer that is off is switched on so, and a layer that is on is switched off so.
_ON: dict[str, Any] = {
    "fill": 16, "surround": 128, "stations": 8, "back_faces": True, "overscan": 1.5, "light_views": 4,
    "behind": True,
}  # fmt: skip
_OFF: dict[str, Any] = {
    "fill": 0, "surround": 0, "stations": 0, "back_faces": False, "overscan": 1.0, "light_views": 0,
    "behind": False,
}  # fmt: skip
_METHODS = {
    "reflections": ("linear", "min_z", "hierarchical"),
    "diffuse": ("hemisphere", "horizon", "bitmask"),
}
# No layer is too dear, or for mirrors alone.
_UNLIMITED: dict[str, Any] = {"budget": 1000.0, "mirrors_only": False}


@dataclass(frozen=True)
class Method:
    """One way to a picture.

    Attributes
    ----------
    name
        Unique; for people.
    line
        What methods share that differ in samples alone.
    kind
        ``"cycles"``, ``"eevee"`` or ``"ours"``.
    samples
        Of Cycles or EEVEE per pixel; of the direct light for ours.
    light
        Cycles: ``"gi"``, ``"direct"`` or ``"fast gi"``; EEVEE: ``"plain"`` or ``"raytracing"``.
    denoiser
        Of Cycles' methods: one of `DENOISERS`; ours take what their preset says.
    preset, changes
        Of ours: the preset, and options that differ from it, by names like ``"stations"`` or
        ``"diffuse.method"``.
    role
        ``"ladder"``, ``"preset"`` (as it is shipped), ``"switch"``.
    headline
        Measured cold, too, shown as a picture, and first when time is short.
    """

    name: str
    line: str
    kind: str
    samples: int
    light: str = ""
    denoiser: str = "raw"
    preset: str | None = None
    changes: tuple[tuple[str, Any], ...] = ()
    role: str = "ladder"
    headline: bool = False

    @property
    def direct_partner(self) -> str | None:
        """Name of Cycles' direct light of the same samples and denoising; None where there is none."""
        has_one = self.kind == "cycles" and self.light != "direct"
        return cycles_method("direct", self.samples, self.denoiser).name if has_one else None

    def job_options(self, resolution: tuple[int, int]) -> JobOptions:
        """Return what our job is to render; of ours alone."""
        assert self.preset is not None
        base = JobOptions.preset(self.preset, Path("."), resolution=resolution)
        return replace(_changed(base, self.changes), samples=self.samples)

    def identity(self, resolution: tuple[int, int]) -> dict[str, Any]:
        """Return all that decides what this method renders, as plain data."""
        own = asdict(self)
        if self.kind == "ours":
            own["options"] = {**asdict(self.job_options(resolution)), "output": None}
        return own


def cycles_method(light: str, samples: int, denoiser: str) -> Method:
    """Return a method of Cycles."""
    title = {"gi": "Cycles GI", "direct": "Cycles direct only", "fast gi": "Cycles Fast GI"}[light]
    headline = denoiser == "fastest" and light != "fast gi" and samples in (1, 4)
    return Method(
        name=f"{title} {samples}{DENOISERS[denoiser]}",
        line=f"{title}{DENOISERS[denoiser]}",
        kind="cycles",
        samples=samples,
        light=light,
        denoiser=denoiser,
        headline=headline,
    )


def all_methods(*, quick: bool = False) -> list[Method]:
    """Return every method in the order of the report; a quick run has fewer steps of the same ladders."""
    methods = _rivals(quick)
    for preset in PRESETS:
        ladder = OURS_LADDER
        if quick:
            ladder = _QUICK_OURS_LADDER if preset == DEFAULT_PRESET else ()
        methods += _preset_ladder(preset, ladder)
    switches = _switches(DEFAULT_PRESET)
    if quick:
        switches = [method for method in switches if method.name.endswith(_QUICK_SWITCHES)]
    return methods + switches


def chosen(methods: Iterable[Method], words: Sequence[str]) -> list[Method]:
    """Return the methods whose name or line holds one of the words, and the direct light that they need."""
    methods = list(methods)
    if not words:
        return methods
    wanted = [
        method
        for method in methods
        if any(word.lower() in f"{method.name}\n{method.line}".lower() for word in words)
    ]
    partners = {method.direct_partner for method in wanted}
    return [method for method in methods if method in wanted or method.name in partners]


def tiers(methods: Iterable[Method]) -> list[list[Method]]:
    """Split methods into those that matter most, the other steps of the ladders, and the switches."""
    methods = list(methods)
    main = [method for method in methods if method.headline]
    ladders = [method for method in methods if not method.headline and method.role != "switch"]
    return [tier for tier in (main, ladders, [m for m in methods if m.role == "switch"]) if tier]


def _rivals(quick: bool) -> list[Method]:
    methods = []
    # Each GI method's indirect light is told against direct light of the same samples
    for light in ("direct", "gi"):
        for denoiser in DENOISERS:
            ladder = _QUICK_LADDERS[denoiser] if quick else GI_LADDER
            methods += [cycles_method(light, samples, denoiser) for samples in ladder]
    methods += [
        cycles_method("fast gi", samples, "fastest") for samples in FAST_GI_LADDER[: 2 if quick else 3]
    ]
    if not quick:
        for light, line in (("plain", "EEVEE"), ("raytracing", "EEVEE + raytracing")):
            methods.append(Method(f"{line} {EEVEE_SAMPLES}", line, "eevee", EEVEE_SAMPLES, light=light))
    return methods


def shipped_preset(preset: str) -> Method:
    """Return a preset as it is."""
    samples = JobOptions.preset(preset, Path(".")).samples
    return Method(
        f"ours, {preset} ({samples})", f"ours, {preset}", "ours", samples,
        preset=preset, role="preset", headline=True,
    )  # fmt: skip


def _preset_ladder(preset: str, ladder: Sequence[int]) -> list[Method]:
    """The preset as it is, and with other samples of the direct light."""
    shipped = shipped_preset(preset)
    others = [
        Method(f"{shipped.line} {samples}", shipped.line, "ours", samples, preset=preset)
        for samples in ladder
        if samples != shipped.samples
    ]
    return sorted([shipped, *others], key=lambda method: method.samples)


def _switches(preset: str) -> list[Method]:
    """Each switch that matters, flipped alone."""
    base = JobOptions.preset(preset, Path("."))
    flips: list[tuple[str, dict[str, Any]]] = []
    for group, choices in _METHODS.items():
        own = getattr(base.settings, group).method
        flips += [(f"{group} {choice}", {f"{group}.method": choice}) for choice in choices if choice != own]
    flips += [
        (f"denoiser {name}", {"denoiser": name}) for name in ("fast", "accurate") if name != base.denoiser
    ]
    title = "geometry with the light" if base.own_geometry else "own geometry"
    flips.append((title, {"own_geometry": not base.own_geometry}))
    is_on = {name: getattr(base, name) != off for name, off in _OFF.items()}
    flips += [(f"without {_words(name)}", {name: _OFF[name]}) for name, on in is_on.items() if on]
    # What is added must not be left out, and is told against the same without it
    flips.append(("without limits", _UNLIMITED))
    flips += [
        (f"without limits, with {_words(name)}", {**_UNLIMITED, name: _ON[name]})
        for name, on in is_on.items()
        if not on
    ]
    return [
        Method(
            f"ours, {preset}: {title}", f"ours, {preset}: {title}", "ours", base.samples,
            preset=preset, changes=tuple(changes.items()), role="switch",
        )
        for title, changes in flips
    ]  # fmt: skip


def _words(name: str) -> str:
    return name.replace("_", " ")


def _changed(options: JobOptions, changes: Iterable[tuple[str, Any]]) -> JobOptions:
    for name, value in changes:
        group, _, own = name.rpartition(".")
        if not group:
            options = replace(options, **{name: value})
            continue
        part = replace(getattr(options.settings, group), **{own: value})
        options = replace(options, settings=replace(options.settings, **{group: part}))
    return options
