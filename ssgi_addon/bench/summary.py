# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is nearer to the truth at equal time, over all scenes: means, the worst scene, wins and losses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ..core.settings import PRESETS
from ..job_options import DEFAULT_PRESET
from .frontier import error_at, geometric_mean, seconds_for
from .methods import cycles_method, shipped_preset
from .points import Dot, Point, dots

Points = Mapping[str, Sequence[Point]]

# What artists render with today when they are in a hurry.
YARDSTICKS = tuple(cycles_method("gi", samples, "fastest").name for samples in (1, 4))
QUESTIONS = {
    "picture": "the whole picture, all seconds",
    "replaced": "the indirect light alone, seconds beyond direct",
}


@dataclass(frozen=True)
class Comparison:
    """One figure of ours against Cycles' over all scenes; ratios below 1 are ours to win.

    Attributes
    ----------
    title
        What is compared.
    ratios
        Ours over theirs, by scene; None where one of the two has nothing to compare with, as `missing` says.
    missing
        What None means.
    none_wins
        Where there is no ratio, ours won: theirs has nothing as fast. Otherwise ours lost.
    """

    title: str
    ratios: Mapping[str, float | None]
    missing: str
    none_wins: bool = False

    @property
    def known(self) -> dict[str, float]:
        """Ratios of the scenes that have one."""
        return {scene: ratio for scene, ratio in self.ratios.items() if ratio is not None}

    @property
    def mean(self) -> float | None:
        """Geometric mean of the ratios that there are."""
        return geometric_mean(list(self.known.values()))

    @property
    def worst(self) -> tuple[str, float] | None:
        """The scene with the largest ratio."""
        return max(self.known.items(), key=lambda item: item[1]) if self.known else None

    @property
    def wins(self) -> int:
        """Scenes where ours is better."""
        missing = len(self.ratios) - len(self.known)
        return sum(ratio < 1.0 for ratio in self.known.values()) + (missing if self.none_wins else 0)

    @property
    def losses(self) -> int:
        """All other scenes."""
        return len(self.ratios) - self.wins


def compare_all(points: Points) -> dict[str, list[Comparison]]:
    """Return the comparisons of each question; those that no scene has the points for are left out."""
    found = {}
    for target in QUESTIONS:
        by_scene = {scene: dots(own, target) for scene, own in points.items()}
        rows = [*_at_yardsticks(by_scene), *_at_presets(by_scene)]
        found[target] = [row for row in rows if row.ratios]
    return found


def mean_dots(points: Points) -> list[Dot]:
    """Return each method over all scenes: time and error of the picture relative to the first yardstick's.

    Geometric means over the scenes that have the yardstick; methods that one of those lacks are left out, as
    all are where there are fewer than two.
    """
    own = {
        scene: {dot.point.method: dot for dot in dots(found, "picture")} for scene, found in points.items()
    }
    own = {scene: by_method for scene, by_method in own.items() if YARDSTICKS[0] in by_method}
    if len(own) < 2:
        return []
    first, *others = own.values()
    found = []
    for method, dot in first.items():
        if dot.point.role == "switch" or not all(method in by_method for by_method in others):
            continue
        of = [(by_method[method], by_method[YARDSTICKS[0]]) for by_method in own.values()]
        seconds = geometric_mean([dot.seconds / yardstick.seconds for dot, yardstick in of])
        error = geometric_mean([dot.error / yardstick.error for dot, yardstick in of])
        assert seconds is not None
        assert error is not None
        found.append(Dot(dot.point, seconds, error))
    return found


def _at_yardsticks(by_scene: Mapping[str, Sequence[Dot]]) -> list[Comparison]:
    """Compare the frontier of our presets and their samples with single points of Cycles."""
    rows = []
    for name in YARDSTICKS:

        def ratios(of: Callable[[list[Dot], Dot], float | None], name: str = name) -> dict[str, float | None]:
            found = {}
            for scene, own in by_scene.items():
                yardstick = next((dot for dot in own if dot.point.method == name), None)
                ours = [dot for dot in own if dot.point.kind == "ours" and dot.point.role != "switch"]
                if yardstick is not None and ours:
                    found[scene] = of(ours, yardstick)
            return found

        errors = ratios(lambda ours, rival: _ratio(error_at(ours, rival.seconds), rival.error))
        times = ratios(lambda ours, rival: _ratio(seconds_for(ours, rival.error), rival.seconds))
        rows.append(Comparison(f"error at the time of {name}", errors, "ours is never as fast"))
        rows.append(Comparison(f"time for the error of {name}", times, "ours is never as near"))
    return rows


def _at_presets(by_scene: Mapping[str, Sequence[Dot]]) -> list[Comparison]:
    """Compare each preset as it is shipped with the frontier of all of Cycles' ways."""
    rows = []
    for preset in PRESETS:
        name = shipped_preset(preset).name
        found = {}
        for scene, own in by_scene.items():
            ours = next((dot for dot in own if dot.point.method == name), None)
            theirs = [dot for dot in own if dot.point.kind == "cycles"]
            if ours is not None and theirs:
                rival = error_at(theirs, ours.seconds)
                found[scene] = None if rival is None else ours.error / rival
        title = f"error of {name} against Cycles' best at its time"
        rows.append(Comparison(title, found, "Cycles is never as fast", none_wins=True))
    return rows


@dataclass(frozen=True)
class Switch:
    """What one switch does around the default preset, as geometric means over scenes.

    Attributes
    ----------
    method, base
        With the switch, and without.
    error, replaced, seconds
        Ratios to the base: of the picture's error, of the error of the indirect light alone, of time.
    scenes
        How many count.
    """

    method: str
    base: str
    error: float | None
    replaced: float | None
    seconds: float | None
    scenes: int


def compare_switches(points: Points) -> list[Switch]:
    """Return what each switch does."""
    own_base = shipped_preset(DEFAULT_PRESET).name
    names = list(
        dict.fromkeys(point.method for own in points.values() for point in own if point.role == "switch")
    )
    found = []
    for name in names:
        head, comma, _ = name.partition(", with ")
        base = head if comma else own_base
        pairs = []
        for own in points.values():
            by_name = {point.method: point for point in own}
            if name in by_name and base in by_name:
                pairs.append((by_name[name], by_name[base]))
        errors, replaced = (
            [ratio for ratio in (_ratio(a.score(t), b.score(t)) for a, b in pairs) if ratio]
            for t in ("picture", "replaced")
        )
        times = [a.seconds / b.seconds for a, b in pairs]
        means = [geometric_mean(values) for values in (errors, replaced, times)]
        found.append(Switch(name, base, *means, scenes=len(pairs)))
    return found


def _ratio(value: float | None, by: float | None) -> float | None:
    return None if value is None or not by else value / by
