# SPDX-License-Identifier: GPL-3.0-or-later
"""What each preset makes of the picture of real scenes, against Cycles, and what it costs.

The picture is the captured direct light with our indirect light, the reference the same direct light with
Cycles' indirect passes; so the noise of the direct light is in neither. Run from the repository's root:

    python -m benchmarks.presets [--scenes bathroom ...] [--size 480x270] [--samples 128] [--output FILE.json]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.cycles_truth import CyclesTruth, cycles_truth, real_scenes
from benchmarks.inputs import parse_size
from benchmarks.variants import geometric_mean
from ssgi_addon.core import Settings, composite, render_indirect
from ssgi_addon.core.metrics import relmse, ssim
from ssgi_addon.core.settings import PRESETS
from ssgi_addon.core.types import FloatArray


@dataclass(frozen=True)
class Score:
    """What one preset gave on one scene.

    Attributes
    ----------
    scene, preset
        Names; preset ``"direct only"`` adds nothing.
    seconds
        Of all passes, without the capture.
    relmse, ssim
        Of the picture.
    known
        Mean of `IndirectLight.known`.
    """

    scene: str
    preset: str
    seconds: float
    relmse: float
    ssim: float
    known: float


def measure(name: str, truth: CyclesTruth) -> Iterator[Score]:
    """Yield the scores of a scene: of its direct light alone, then of each preset."""
    frame = truth.frame
    gbuffer = frame.gbuffer
    reference = gbuffer.direct + gbuffer.albedo * truth.diffuse_halves.mean(axis=0)
    reference += gbuffer.specular * truth.glossy_halves.mean(axis=0)

    def score(preset: str, picture: FloatArray, seconds: float, known: float) -> Score:
        return Score(name, preset, seconds, relmse(picture, reference), ssim(picture, reference), known)

    yield score("direct only", gbuffer.direct, 0.0, 0.0)
    for preset in PRESETS:
        light = render_indirect(
            gbuffer, frame.camera, Settings.preset(preset), frame.environment, frame.views
        )
        known = float(light.known.mean(dtype=np.float64))
        yield score(preset, composite(gbuffer, light), sum(light.seconds.values()), known)


def main() -> None:
    """Measure, print, and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=real_scenes(), help="real scenes")
    parser.add_argument("--size", type=parse_size, default=(480, 270), metavar="WIDTHxHEIGHT")
    parser.add_argument("--samples", type=int, default=128, help="of Cycles, per pixel")
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    arguments = parser.parse_args()
    print(f"{'scene':20}{'preset':12}{'seconds':>9}{'relMSE':>9}{'ratio':>8}{'SSIM':>7}{'known':>7}")
    scores: list[Score] = []
    ratios: dict[str, list[float]] = {}
    for name in arguments.scenes:
        direct = np.nan
        for found in measure(name, cycles_truth(name, arguments.size, arguments.samples, None)):
            direct = found.relmse if found.preset == "direct only" else direct
            ratio = found.relmse / direct
            ratios.setdefault(found.preset, []).append(ratio)
            scores.append(found)
            print(
                f"{name:20}{found.preset:12}{found.seconds:9.2f}{found.relmse:9.4f}{ratio:8.3f}"
                f"{found.ssim:7.3f}{found.known:7.1%}",
                flush=True,
            )
    means = {preset: geometric_mean(values) for preset, values in ratios.items()}
    print("relMSE relative to direct light alone, geometric means:", means)
    if arguments.output:
        parameters = {name: getattr(arguments, name) for name in ("scenes", "size", "samples")}
        results = {"ratios": means, "scores": [asdict(score) for score in scores]}
        record.store(arguments.output, parameters, results)


if __name__ == "__main__":
    main()
