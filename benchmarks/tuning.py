# SPDX-License-Identifier: GPL-3.0-or-later
"""Tune what is a heuristic against Cycles on one half of the real scenes, and verify it on the other.

A coordinate search: one parameter after another takes the value that lowers the picture's error, over a few
values in a first pass, then around those that helped. A change is taken only if it passes `Verdict.is_taken`.
Run from the repository's root:

    python -m benchmarks.tuning [--parameters thickness ...] [--size 480x270] [--output FILE.json]

Nothing is changed in the code: the script tells what would be better. What it may turn stands in
`benchmarks.tuned_parameters`. Errors are those of `beyond_frame`: of the picture, relative to direct light
alone, without the noise of Cycles.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import record
from benchmarks.beyond_frame import CONFIGURATIONS
from benchmarks.cycles_truth import cycles_truth, real_scenes
from benchmarks.inputs import Size, parse_size
from benchmarks.tuned_parameters import CASES, PARAMETERS, Changes, applied, settings_of
from benchmarks.variants import geometric_mean, relmse_without_noise
from benchmarks.wide_frame import wide_frame
from ssgi_addon.core import IndirectLight, composite, render_indirect
from ssgi_addon.core.pipeline import level_by_fill
from ssgi_addon.core.planner import plan_passes
from ssgi_addon.core.types import FloatArray
from ssgi_addon.frame import CapturedFrame

SEEDS = (0, 1, 2)
# A change has to gain this much, and more than what the seed makes of the mean.
LEAST_GAIN = 0.01
# No picture of the tuning half may become worse by more than this.
MOST_LOSS = 0.02
# Second pass: around values that gained half of that.
_PROMISING = 0.5 * LEAST_GAIN
# What all that was taken is verified by.
_VERIFIED = ("draft", "balanced", "final", "stations")
# Relative errors below this, or below 0, are noise: they count as this.
_LEAST = 1e-3

# Relative errors of pictures by scene and whether they are without or with a fill.
Errors = dict[tuple[str, str], float]


def halves() -> tuple[list[str], list[str]]:
    """Return the scenes to tune on and those held out: by name, every other one."""
    names = real_scenes()
    return names[0::2], names[1::2]


class Bench:
    """Scenes of one size with their truths, and what was rendered last."""

    def __init__(self, size: Size, samples: int) -> None:
        self.size, self.samples = size, samples
        self.traced = lru_cache(maxsize=64)(self._traced)
        self.scene = lru_cache(maxsize=None)(self._scene)

    def errors(self, case: str, changes: Changes, scenes: Sequence[str], seed: int) -> tuple[Errors, float]:
        """Return the errors of a case with changes, and the seconds that it took."""
        on_light = {name: value for name, value in changes.items() if not PARAMETERS[name].is_of_fill}
        found: Errors = {}
        seconds = 0.0
        for name in scenes:
            frame, pictures, alone = self.scene(name, CASES[case].configuration)
            light, took = self.traced(case, tuple(on_light.items()), name, seed)
            start = time.perf_counter()
            with applied(changes):
                levelled = levelled_light(frame, light, settings_of(case, changes, seed))
            seconds += took + time.perf_counter() - start
            for kind, of in (("frame", light), ("fill", levelled)):
                error = relmse_without_noise(composite(frame.gbuffer, of), pictures, np.ones_like(alone[0]))
                found[name, kind] = max(error / alone[1], _LEAST)
        return found, seconds

    def _scene(self, name: str, configuration: str) -> tuple[CapturedFrame, FloatArray, Any]:
        """Return what is used of a frame, its picture in halves, and what errors are relative to."""
        frame = CONFIGURATIONS[configuration].of(wide_frame(name, self.size))
        truth, gbuffer = cycles_truth(name, self.size, self.samples), frame.gbuffer
        pictures = gbuffer.direct + gbuffer.albedo * truth.diffuse_halves
        pictures += gbuffer.specular * truth.glossy_halves
        everywhere = np.ones(gbuffer.shape, bool)
        return frame, pictures, (everywhere, relmse_without_noise(gbuffer.direct, pictures, everywhere))

    def _traced(
        self, case: str, changes: tuple[tuple[str, Any], ...], name: str, seed: int
    ) -> tuple[IndirectLight, float]:
        """Return the light without the fill, and its seconds."""
        frame, *_ = self.scene(name, CASES[case].configuration)
        settings = settings_of(case, dict(changes), seed)
        start = time.perf_counter()
        with applied(dict(changes)):
            light = render_indirect(frame.gbuffer, frame.camera, settings, frame.environment, frame.views)
        return light, time.perf_counter() - start


def levelled_light(frame: CapturedFrame, light: IndirectLight, settings: Any) -> IndirectLight:
    """Return light at the level of the frame's fill, as `render_indirect` does, without a second trace."""
    plan = plan_passes(frame.gbuffer, settings, frame.environment)
    images = {kind: getattr(light, kind).copy() for kind in ("diffuse", "glossy")}
    place = frame.gbuffer, frame.camera
    for kind, pixel, values in level_by_fill(vars(light), plan, place, frame.fill, settings.threads):
        images[kind].reshape(-1, 3)[pixel] = values
    return replace(light, **images)


@dataclass(frozen=True)
class Verdict:
    """What a change does to the errors.

    Attributes
    ----------
    gain, held_out_gain
        By how much it lowers the geometric mean of the tuning and of the held-out half, 0.01 = 1 %.
    worst, held_out_worst
        By how much it raises the error of the picture that it harms most.
    slower
        How many times the seconds on the tuning half.
    """

    gain: float
    worst: float
    slower: float
    held_out_gain: float | None = None
    held_out_worst: float | None = None

    def is_promising(self, noise: float) -> bool:
        """Return whether it is better on the tuning half."""
        return self.gain >= max(LEAST_GAIN, noise) and self.worst <= MOST_LOSS

    def is_taken(self, noise: float) -> bool:
        """Return whether it is better on the tuning half, harms nothing there, and the other half agrees."""
        return self.is_promising(noise) and self.held_out_gain is not None and self.held_out_gain > 0.0


def gain_and_worst(before: Errors, after: Errors) -> tuple[float, float]:
    """Return by how much the geometric mean falls, and by how much the worst error rises."""
    gain = 1.0 - geometric_mean(list(after.values())) / geometric_mean(list(before.values()))
    return gain, max(after[key] / before[key] for key in before) - 1.0


class Search:
    """The coordinate search: what was taken so far, and all points that were looked at."""

    def __init__(self, bench: Bench, tuning: Sequence[str], held_out: Sequence[str]) -> None:
        self.bench, self.tuning, self.held_out = bench, tuning, held_out
        self.taken: dict[str, Any] = {}
        self.noise: dict[str, float] = {}
        self.points: list[dict[str, Any]] = []

    def turn(self, name: str, values: Sequence[Any], number: int) -> bool:
        """Try values of one parameter in a pass; return whether looking around them is worth it."""
        if not values:
            return False
        noise = self._seed_noise(name)
        before, seconds = self._errors(name, self.taken, self.tuning)
        tried: list[tuple[float, Any]] = []
        for value in values:
            after, took = self._errors(name, self.taken | {name: value}, self.tuning)
            verdict = Verdict(*gain_and_worst(before, after), took / seconds)
            tried.append((verdict.gain if verdict.worst <= MOST_LOSS else -1.0, value))
            self._note(name, value, number, verdict, after, is_taken=False)
        best_gain, best = max(tried, key=lambda one: one[0])
        if best_gain >= max(LEAST_GAIN, noise):
            self._check(name, best, number)
        return best_gain >= _PROMISING

    def _check(self, name: str, value: Any, number: int) -> None:
        """Take a value if all seeds and the other half agree."""
        before, after = (
            [self._over_seeds(name, changes, scenes) for scenes in (self.tuning, self.held_out)]
            for changes in (self.taken, self.taken | {name: value})
        )
        gain, held_out = (gain_and_worst(*pair) for pair in zip(before, after))
        slower = next(one["slower"] for one in reversed(self.points) if one["value"] == value)
        verdict = Verdict(*gain, slower, *held_out)
        is_taken = verdict.is_taken(self._seed_noise(name))
        self._note(name, value, number, verdict, after[0] | after[1], is_taken=is_taken)
        if is_taken:
            self.taken[name] = value

    def _errors(
        self, name: str, changes: Changes, scenes: Sequence[str], seed: int = SEEDS[0]
    ) -> tuple[Errors, float]:
        """Return the errors of the pictures that a parameter acts on, and the seconds."""
        parameter = PARAMETERS[name]
        found, seconds = self.bench.errors(parameter.case, changes, scenes, seed)
        return {key: of for key, of in found.items() if key[1] == "fill" or not parameter.is_of_fill}, seconds

    def _over_seeds(self, name: str, changes: Changes, scenes: Sequence[str]) -> Errors:
        """Return the means of the errors over seeds."""
        found = [self._errors(name, changes, scenes, seed)[0] for seed in SEEDS]
        return {key: float(np.mean([errors[key] for errors in found])) for key in found[0]}

    def _seed_noise(self, name: str) -> float:
        """Return how far apart the means of the seeds lie, relative, before any change."""
        case = PARAMETERS[name].case + (", fill" if PARAMETERS[name].is_of_fill else "")
        if case not in self.noise:
            found = [self._errors(name, {}, self.tuning, seed)[0] for seed in SEEDS]
            means = [geometric_mean(list(errors.values())) for errors in found]
            self.noise[case] = max(means) / min(means) - 1.0
            print(f"{case}: seeds differ by {self.noise[case]:.2%}", flush=True)
        return self.noise[case]

    def _note(
        self, name: str, value: Any, number: int, verdict: Verdict, errors: Errors, *, is_taken: bool
    ) -> None:
        self.points.append(
            {
                "pass": number,
                "parameter": name,
                "present": PARAMETERS[name].present(),
                "value": value,
                "taken": is_taken,
                "mean": geometric_mean(list(errors.values())),
                **asdict(verdict),
                "errors": nested(errors),
            }
        )
        held_out = "" if verdict.held_out_gain is None else f", held out {verdict.held_out_gain:+.2%}"
        print(
            f"{number} {name:34}{value!s:>22} gains {verdict.gain:+7.2%}, worst {verdict.worst:+7.2%}, "
            f"{verdict.slower:.2f} x time{held_out}{', TAKEN' if is_taken else ''}",
            flush=True,
        )


def nested(errors: Errors) -> dict[str, dict[str, float]]:
    """Return errors by scene, then by whether a fill was used."""
    found: dict[str, dict[str, float]] = {}
    for (scene, kind), error in errors.items():
        found.setdefault(scene, {})[kind] = error
    return found


def verify(search: Search, cases: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Yield what all that was taken does together, case by case, on both halves."""
    for case in cases:
        for half, scenes in (("tuning", search.tuning), ("held out", search.held_out)):
            before, after = (
                search.bench.errors(case, changes, scenes, SEEDS[0])[0] for changes in ({}, search.taken)
            )
            gain, worst = gain_and_worst(before, after)
            means = [geometric_mean(list(errors.values())) for errors in (before, after)]
            print(f"{case:10}{half:10}{means[0]:.4f} -> {means[1]:.4f}, worst {worst:+.2%}", flush=True)
            yield {
                "case": case, "half": half, "before": nested(before), "after": nested(after),
                "gain": gain, "worst": worst,
            }  # fmt: skip


def main() -> None:
    """Search, verify, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parameters", nargs="+", choices=PARAMETERS, default=list(PARAMETERS))
    parser.add_argument("--cases", nargs="*", choices=CASES, default=_VERIFIED, help="to verify all with")
    parser.add_argument("--size", type=parse_size, default=(480, 270), metavar="WIDTHxHEIGHT")
    parser.add_argument("--samples", type=int, default=128, help="of Cycles, per pixel")
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    arguments = parser.parse_args()
    tuning, held_out = halves()
    search = Search(Bench(arguments.size, arguments.samples), tuning, held_out)
    verified: list[dict[str, Any]] = []

    def store() -> None:
        """Keep what there is: the search takes half an hour."""
        if arguments.output:
            parameters = {"size": arguments.size, "samples": arguments.samples, "seeds": SEEDS}
            parameters |= {"tuning": tuning, "held_out": held_out}
            results = {"noise": search.noise, "taken": search.taken, "points": search.points}
            record.store(arguments.output, parameters, results | {"verified": verified})

    around = []
    for name in arguments.parameters:
        if search.turn(name, PARAMETERS[name].others(), 1):
            around.append(name)
        store()
    for name in around:
        value = search.taken.get(name, best_value(search.points, name))
        # Beside what else was taken it may be worth more than alone
        again = [] if name in search.taken else [value]
        search.turn(name, again + PARAMETERS[name].around(value), 2)
    store()
    for found in verify(search, arguments.cases if search.taken else ()):
        verified.append(found)
    print("taken:", search.taken or "nothing")
    store()


def best_value(points: Sequence[Mapping[str, Any]], name: str) -> Any:
    """Return the value of a parameter that gained most without harm."""
    own = [one for one in points if one["parameter"] == name and one["worst"] <= MOST_LOSS]
    return max(own, key=lambda one: one["gain"])["value"]


if __name__ == "__main__":
    main()
