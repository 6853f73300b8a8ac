# SPDX-License-Identifier: GPL-3.0-or-later
"""How far our glossy light is from Cycles' Glossy Indirect, and what each setting costs.

On the glossy floor, whose truth is one lobe, and on real scenes. Run from the repository's root:

    python -m benchmarks.reflection_quality [--roughness 0.1 0.4 ...] [--scenes bathroom ...] [--size 480x270]
        [--variant rays=1,reuse=8 --variant rays=64 ...] [--output FILE.json]

A variant names what differs from the default reflection settings. Errors are over glossy pixels of which at
least nine tenths were answered, by many rays of another seed: pixels that are chosen by their own rays are
brighter than they should be.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.cycles_truth import CyclesTruth, cycles_truth, floor_name, real_scenes
from benchmarks.inputs import Size, parse_size
from benchmarks.variants import geometric_mean, noise_of, parse_variant, relative_bias
from ssgi_addon.core import IndirectLight, ReflectionSettings, Settings, render_indirect
from ssgi_addon.core.metrics import KNOWN_ENOUGH, relmse

ROUGHNESS = (0.0, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
_ALONE = "reuse=0,color_pyramid=false,filter=false"
# The first is what the others are compared with.
VARIANTS = (
    f"rays=16,{_ALONE}",
    f"rays=64,{_ALONE}",
    "rays=1,reuse=16,color_pyramid=true,filter=false",
    "rays=1,reuse=32,color_pyramid=true,filter=false",
    "rays=1",
)
_CHOOSING_RAYS = 64
_CHOOSING_SEED = 7


@dataclass(frozen=True)
class Score:
    """What one variant gave on one scene.

    Attributes
    ----------
    scene, variant
        Names.
    seconds
        Of the reflection pass, best of all rounds.
    rays
        Traced in all.
    pixels
        Number of those that count.
    relmse, bias
        Against Cycles; the bias relative to the mean of what Cycles found.
    known_bias
        The same of pixels that are known to 99 %; None where there is none.
    noise
        What the noise of the reference adds to the relMSE.
    """

    scene: str
    variant: str
    seconds: float
    rays: int
    pixels: int
    relmse: float
    bias: float
    known_bias: float | None
    noise: float


def measure(
    scene: str, truth: CyclesTruth, variants: Mapping[str, ReflectionSettings], rounds: int
) -> Iterator[Score]:
    """Yield the score of each variant on one scene.

    Parameters
    ----------
    scene
        Its name.
    truth
        Frame and reference.
    variants
        By name.
    rounds
        Times to run each; the fastest counts.
    """
    choosing = replace(parse_variant(_ALONE, ReflectionSettings()), rays=_CHOOSING_RAYS)
    known = _light(truth, choosing, seed=_CHOOSING_SEED).known_glossy
    is_glossy = truth.frame.gbuffer.specular.max(axis=-1) > 0.0
    counts, surely = (is_glossy & (known >= least) for least in (KNOWN_ENOUGH, 0.99))
    if not counts.any():
        print(f"{scene}: the frame and its surround answer no glossy pixel well enough")
        return
    reference, noise = truth.glossy_halves.mean(axis=0), noise_of(truth.glossy_halves, counts)
    for name, reflections in variants.items():
        lights = [_light(truth, reflections) for _ in range(rounds)]
        glossy = lights[0].glossy
        yield Score(
            scene=scene,
            variant=name,
            seconds=min(light.seconds["reflections"] for light in lights),
            rays=lights[0].rays["reflections"],
            pixels=int(np.count_nonzero(counts)),
            relmse=relmse(glossy, reference, mask=counts),
            bias=relative_bias(glossy, reference, counts),
            known_bias=relative_bias(glossy, reference, surely) if surely.any() else None,
            noise=noise,
        )


def _light(truth: CyclesTruth, reflections: ReflectionSettings, seed: int = 0) -> IndirectLight:
    settings = Settings(reflections=reflections, seed=seed)
    if truth.is_floor:
        settings = replace(settings, diffuse=replace(settings.diffuse, enabled=False))
    frame = truth.frame
    return render_indirect(frame.gbuffer, frame.camera, settings, frame.environment, frame.views)


def summary(scores: list[Score], baseline: str) -> dict[str, dict[str, float]]:
    """Return each variant's error and time relative to the baseline: geometric means and the worst scene."""
    against = {score.scene: score for score in scores if score.variant == baseline}
    ratios: dict[str, dict[str, float]] = {}
    for variant in dict.fromkeys(score.variant for score in scores if score.variant != baseline):
        own = [score for score in scores if score.variant == variant]
        error = [score.relmse / against[score.scene].relmse for score in own]
        seconds = [score.seconds / against[score.scene].seconds for score in own]
        ratios[variant] = {
            "relmse": geometric_mean(error),
            "worst_relmse": max(error),
            "seconds": geometric_mean(seconds),
            "worst_seconds": max(seconds),
        }
    return ratios


def _print_score(score: Score) -> None:
    known_bias = "" if score.known_bias is None else f"{score.known_bias:+.2%}"
    print(
        f"{score.scene:20}{score.seconds:9.3f}{score.rays:11}{score.pixels:8}{score.relmse:9.4f}"
        f"{score.bias:+9.2%}{known_bias:>9}{score.noise:9.4f}  {score.variant}",
        flush=True,
    )


def _run(names: list[str], size: Size, samples: int, variants: list[str], rounds: int) -> list[Score]:
    header = f"{'seconds':>9}{'rays':>11}{'pixels':>8}{'relMSE':>9}{'bias':>9}{'at 99 %':>9}{'noise':>9}"
    print(f"{size[0]} x {size[1]}, Cycles with {samples} samples\n{'scene':20}{header}  variant")
    settings = {text: parse_variant(text, ReflectionSettings()) for text in variants}
    scores = []
    for name in names:
        truth = cycles_truth(name, size, samples)
        for score in measure(name, truth, settings, rounds):
            _print_score(score)
            scores.append(score)
    return scores


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=parse_size, default=(480, 270), metavar="WIDTHxHEIGHT")
    parser.add_argument("--roughness", type=float, nargs="*", default=ROUGHNESS, help="of the glossy floor")
    parser.add_argument("--scenes", nargs="*", default=real_scenes(), help="real scenes")
    parser.add_argument("--samples", type=int, default=128, help="of Cycles, per pixel")
    parser.add_argument("--variant", action="append", metavar="NAME=VALUE,...", help="settings to measure")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each variant; the fastest counts")
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    arguments = parser.parse_args()
    variants = arguments.variant or list(VARIANTS)
    names = [*map(floor_name, arguments.roughness), *arguments.scenes]
    scores = _run(names, arguments.size, arguments.samples, variants, arguments.rounds)
    ratios = summary(scores, variants[0])
    for variant, ratio in ratios.items():
        print(
            f"{variant}: {ratio['relmse']:.2f} x the error (worst {ratio['worst_relmse']:.2f}) in "
            f"{ratio['seconds']:.2f} x the time (worst {ratio['worst_seconds']:.2f}) of {variants[0]}"
        )
    if arguments.output:
        parameters = {
            name: getattr(arguments, name) for name in ("size", "roughness", "scenes", "samples", "rounds")
        }
        results = {"ratios": ratios, "scores": [asdict(score) for score in scores]}
        record.store(arguments.output, {**parameters, "variants": variants}, results)


if __name__ == "__main__":
    main()
