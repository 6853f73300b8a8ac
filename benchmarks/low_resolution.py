# SPDX-License-Identifier: GPL-3.0-or-later
"""What light at lower resolution costs and what it is worth, against Cycles: resolution x rays x bounces.

The picture is direct light with diffuse and glossy indirect light; its relMSE is relative to no indirect
light at all and free of the noise of Cycles' light. All variants of a scene are timed in turn, several
rounds; seconds are of the best round, ratios (of wall time, and of processor time) those to the first
variant. Run from the repository's root:

    python -m benchmarks.low_resolution [--scenes bathroom ...] [--configurations frame fill]
        [--variants "full 1 3 full" "quarter 4 3 half tiers"] [--rounds 3] [--output FILE.json]

A variant names resolution, rays and bounces of diffuse light, the resolution of reflections, then any of
``tiers`` (fewer rays on rough surfaces), ``reuse=N`` (of neighbours' reflection rays) and ``steps=N``
(`Settings.max_steps`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.beyond_frame import CONFIGURATIONS, LEAST_ERROR
from benchmarks.cycles_truth import CyclesTruth, cycles_truth
from benchmarks.variants import geometric_mean, relmse_without_noise
from benchmarks.wide_frame import wide_frame
from ssgi_addon.core import IndirectLight, Settings, composite, render_indirect
from ssgi_addon.core.planner import is_colored
from ssgi_addon.frame import CapturedFrame

SCENES = ("living_room", "bathroom", "classroom", "hotel_room", "spaceship", "bridge_garden")
VARIANTS = (
    "full 1 3 full",
    "half 1 3 full", "half 2 3 full", "half 4 3 full",
    "quarter 1 3 full", "quarter 2 3 full", "quarter 4 3 full", "quarter 8 3 full",
    "quarter 4 1 full", "quarter 4 2 full", "quarter 4 6 full",
    "full 1 3 half tiers", "full 1 3 quarter",
    "quarter 2 3 half tiers", "quarter 2 3 quarter", "quarter 2 3 half tiers reuse=3 steps=96",
    "quarter 4 3 half tiers reuse=3 steps=96", "quarter 4 6 half tiers reuse=3 steps=96",
)  # fmt: skip
_SIZE, _SAMPLES = (480, 270), 128


@dataclass(frozen=True)
class Score:
    """What one variant gave on one scene; errors are relative to no indirect light.

    Attributes
    ----------
    diffuse, picture
        relMSE of the diffuse light, over surfaces with a diffuse colour, and of the picture.
    seconds, processor
        Of `render_indirect`, best round: wall time, and that of all threads; `steps` are parts of the former.
    rays
        Traced by each pass.
    """

    scene: str
    configuration: str
    variant: str
    diffuse: float
    picture: float
    seconds: float
    processor: float
    steps: dict[str, float]
    rays: dict[str, int]


def settings_of(text: str) -> Settings:
    """Return the settings that a variant names."""
    resolution, rays, bounces, reflections, *more = text.split()
    base, options = Settings.preset("draft"), dict(word.partition("=")[::2] for word in more)
    steps = options.get("steps")
    return replace(
        base,
        diffuse=replace(base.diffuse, resolution=resolution, rays=int(rays), bounces=int(bounces)),
        reflections=replace(
            base.reflections,
            resolution=reflections,
            roughness_tiers="tiers" in options,
            reuse=int(options.get("reuse", base.reflections.reuse)),
        ),
        max_steps=None if steps is None else int(steps),
    )


def measure(
    name: str,
    frame: CapturedFrame,
    truth: CyclesTruth,
    configuration: str,
    variants: Sequence[str],
    rounds: int,
) -> Iterator[Score]:
    """Yield the scores of all variants on one scene."""
    used = CONFIGURATIONS[configuration].of(frame)
    lights: dict[str, IndirectLight] = {}
    seconds, processor = dict.fromkeys(variants, np.inf), dict.fromkeys(variants, np.inf)
    for _ in range(rounds):
        for text in variants:
            settings = settings_of(text)
            start, busy = time.perf_counter(), time.process_time()
            light = render_indirect(
                used.gbuffer, used.camera, settings, used.environment, used.views, fill=used.fill
            )
            spent = time.perf_counter() - start
            processor[text] = min(processor[text], time.process_time() - busy)
            if spent < seconds[text]:
                seconds[text], lights[text] = spent, light
    gbuffer = used.gbuffer
    everywhere = np.ones(gbuffer.shape, bool)
    counts = is_colored(gbuffer.albedo) & ~gbuffer.is_background
    pictures = np.stack(
        [
            composite(gbuffer, replace(light, diffuse=diffuse, glossy=glossy))
            for diffuse, glossy in zip(truth.diffuse_halves, truth.glossy_halves)
        ]
    )
    dark = relmse_without_noise(np.zeros_like(gbuffer.direct), truth.diffuse_halves, counts)
    direct = relmse_without_noise(gbuffer.direct, pictures, everywhere)
    for text, light in lights.items():
        diffuse = relmse_without_noise(light.diffuse, truth.diffuse_halves, counts) / dark
        picture = relmse_without_noise(composite(gbuffer, light), pictures, everywhere) / direct
        yield Score(
            name, configuration, text, diffuse, picture, seconds[text], processor[text], dict(light.seconds),
            dict(light.rays),
        )  # fmt: skip


def overall(scores: Sequence[Score]) -> dict[str, dict[str, dict[str, float]]]:
    """Return, by configuration and variant, geometric means: of seconds, of ratios of time, and of errors."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for configuration in dict.fromkeys(score.configuration for score in scores):
        own = [score for score in scores if score.configuration == configuration]
        first = {score.scene: score for score in own if score.variant == own[0].variant}
        found[configuration] = {}
        for text in dict.fromkeys(score.variant for score in own):
            rows = [score for score in own if score.variant == text]
            found[configuration][text] = {
                "seconds": geometric_mean([row.seconds for row in rows]),
                "ratio": geometric_mean([row.seconds / first[row.scene].seconds for row in rows]),
                "processor": geometric_mean([row.processor / first[row.scene].processor for row in rows]),
                "diffuse": geometric_mean([max(row.diffuse, LEAST_ERROR) for row in rows]),
                "picture": geometric_mean([max(row.picture, LEAST_ERROR) for row in rows]),
            }
    return found


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), help="real scenes")
    parser.add_argument("--configurations", nargs="+", choices=CONFIGURATIONS, default=["frame", "fill"])
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    arguments = parser.parse_args()
    scores: list[Score] = []
    for name in arguments.scenes:
        frame, truth = wide_frame(name, _SIZE), cycles_truth(name, _SIZE, _SAMPLES)
        for configuration in arguments.configurations:
            found = list(measure(name, frame, truth, configuration, arguments.variants, arguments.rounds))
            scores += found
            for one in found:
                print(
                    f"{name:16}{configuration:16}{one.variant:42}{one.seconds:7.3f}"
                    f"{one.diffuse:9.4f}{one.picture:9.4f}",
                    flush=True,
                )
    figures = overall(scores)
    for configuration, rows in figures.items():
        print(f"\n{configuration}, geometric means")
        print(f"{'':42}{'seconds':>9}{'ratio':>7}{'processor':>11}{'diffuse':>9}{'picture':>9}")
        for text, row in rows.items():
            print(
                f"{text:42}{row['seconds']:9.3f}{row['ratio']:7.2f}{row['processor']:11.2f}{row['diffuse']:9.4f}{row['picture']:9.4f}"
            )
    if arguments.output:
        parameters = {
            key: getattr(arguments, key) for key in ("scenes", "configurations", "variants", "rounds")
        }
        results = {"overall": figures, "scores": [asdict(score) for score in scores]}
        record.store(arguments.output, parameters, results)


if __name__ == "__main__":
    main()
