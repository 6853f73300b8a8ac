# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's tables as rows of texts, for the page and for Markdown alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..tables import NOTHING, Table, number
from .points import REFERENCE_MARGIN, Point
from .store import SceneState
from .summary import QUESTIONS, Comparison, Switch

_SOFTWARE_GL = ("llvmpipe", "softpipe", "swrast", "software")


def facts_line(facts: Mapping[str, Any]) -> str:
    """Return machine and versions as one line."""
    machine, versions, options = facts["machine"], facts["versions"], facts["options"]
    size = "x".join(str(side) for side in options["resolution"])
    memory = f", {machine['memory_gb']:g} GB" if machine["memory_gb"] else ""
    known = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    how = "quick run, " if options["quick"] else ""
    where = f"{machine['cpu']}, {machine['cores']} cores{memory}, {machine['system']}"
    reference = f"reference of 2 × {options['reference_samples']} samples"
    return f"{where}; {known}; {how}{size} pixels, best of {options['repeats']}, {reference}; {facts['date']}"


def comparison_tables(comparisons: Mapping[str, Sequence[Comparison]]) -> list[Table]:
    """Return one table a question: ratios of ours to theirs, below 1 ours is better."""
    head = ("Ours over theirs", "Geometric mean", "Worst scene", "Wins", "Losses", "Without a ratio")
    return [
        Table(QUESTIONS[target].capitalize(), head, tuple(_comparison_row(row) for row in rows))
        for target, rows in comparisons.items()
        if rows
    ]


def _comparison_row(row: Comparison) -> tuple[str, ...]:
    worst = f"{number(row.worst[1])} ({row.worst[0]})" if row.worst else NOTHING
    missing = len(row.ratios) - len(row.known)
    without = f"{missing}: {row.missing}" if missing else "0"
    return row.title, number(row.mean), worst, str(row.wins), str(row.losses), without


def switch_table(switches: Sequence[Switch]) -> Table | None:
    """Return what the switches do, relative to the same without."""
    head = ("Switch", "Against", "Picture's error ×", "Indirect light's error ×", "Seconds ×", "Scenes")
    rows = tuple(
        (row.method, row.base, number(row.error), number(row.replaced), number(row.seconds), str(row.scenes))
        for row in switches
    )
    return Table("Each switch alone, geometric means", head, rows) if rows else None


def scene_table(points: Sequence[Point]) -> Table:
    """Return every method of a scene: time, memory, and errors of the picture and of what is replaced."""
    head = (
        "Method", "Seconds", "Spread", "Beyond direct", "Passes", "Cold", "Peak MB", "Cold MB", "relMSE",
        "with worst", "Bias", "SSIM", "FLIP", "Indirect relMSE", "Diffuse relMSE", "Glossy relMSE",
    )  # fmt: skip
    return Table("Every method", head, tuple(_point_row(point) for point in points))


def _point_row(point: Point) -> tuple[str, ...]:
    mark = "" if point.is_above_reference else " *"
    spread = f"{point.spread:.0%} of {point.runs}" if point.runs > 1 else "1 run"
    return (
        point.method, number(point.seconds), spread, number(point.beyond_direct), number(point.passes),
        number(point.cold_seconds), number(point.memory_mb, 4), number(point.cold_memory_mb, 4),
        number(point.score("picture")) + mark, number(point.score("picture", "relmse_untrimmed")),
        number(point.score("picture", "bias"), 2), number(point.score("picture", "ssim")),
        number(point.score("picture", "flip")), number(point.score("replaced")),
        number(point.score("diffuse")), number(point.score("glossy")),
    )  # fmt: skip


def subset_table(points: Sequence[Point], state: SceneState) -> Table:
    """Return relMSE over the parts of the pixels: what a method does wrong, and what it cannot see."""
    shares = state.facts["known"]
    targets = (("picture", "picture"), ("diffuse", "diffuse"), ("glossy", "glossy"))
    subsets = ("known", "silhouettes", "rest")
    head = ("Method", *(f"{title}: {subset}" for _, title in targets for subset in subsets))
    rows = tuple(
        (
            point.method,
            *(number(point.score(target, "relmse", subset)) for target, _ in targets for subset in subsets),
        )
        for point in points
    )
    known = ", ".join(f"{name} {share:.0%}" for name, share in shares.items())
    return Table(f"relMSE over parts of the pixels (known: {known})", head, rows)


def apply_table(points: Sequence[Point]) -> Table | None:
    """Return the third figure: our passes alone, on what is captured already."""
    rows = tuple(
        (point.method, number(point.passes), number(point.score("picture")), number(point.score("replaced")))
        for point in points
        if point.role == "preset"
    )
    head = ("Preset", "Seconds of the passes", "relMSE of the picture", "Indirect relMSE")
    return Table("With the passes at hand (apply)", head, rows) if rows else None


def flicker_table(state: SceneState) -> Table | None:
    """Return the frame-to-frame change of the error, where it was measured."""
    found = state.flicker.get("methods", {})
    rows = tuple((name, number(own["rms"]), number(own["seconds"])) for name, own in found.items())
    return (
        Table("Flicker over a slow camera move", ("Method", "RMS, of 255", "Seconds a frame"), rows)
        if rows
        else None
    )


def measured_line(state: SceneState) -> str:
    """Return when a scene was measured, and by what EEVEE drew."""
    dates = sorted(record.date for record in state.records.values() if record.date)
    drawn = state.facts.get("opengl", "")
    is_software = any(name in drawn.lower() for name in _SOFTWARE_GL)
    eevee = f" EEVEE by {drawn}{', software GL' if is_software else ''}." if drawn else ""
    return f"Measured from {dates[0]} to {dates[-1]}.{eevee}" if dates else eevee.strip()


def reference_line(state: SceneState) -> str:
    """Return how good the reference is."""
    reference = state.reference
    own = reference["own_error"]
    errors = ", ".join(
        f"{number(own[name], 2)} ({title})"
        for name, title in (
            ("combined", "picture"),
            ("diffuse", "Diffuse Indirect"),
            ("glossy", "Glossy Indirect"),
        )
    )
    return (
        f"Reference: {reference['samples']} samples in two halves, {reference['seconds']:.0f} s. By what the "
        f"halves differ its own relMSE is {errors}; points less than {REFERENCE_MARGIN:g} times above it are "
        "marked *."
    )


def gaps(state: SceneState) -> list[str]:
    """Return what was not measured, and why."""
    found = [f"{name}: {why}" for name, why in state.left_out.items()]
    found += [f"{name}: {record.failure}" for name, record in state.records.items() if record.failure]
    return found
