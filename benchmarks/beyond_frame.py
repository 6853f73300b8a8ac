# SPDX-License-Identifier: GPL-3.0-or-later
"""What views beyond the frame bring: rays that they answer, how many rightly, and the error of the light.

Rays of the ``final`` preset against what they truly hit (`ray_truth`), and a preset's light against that of
Cycles. Run from the repository's root:

    python -m benchmarks.beyond_frame [--scenes bathroom ...] [--configurations frame surround]
        [--preset balanced] [--size 480x270] [--rays 4000] [--no-light] [--samples 128] [--output FILE.json]
    python -m benchmarks.beyond_frame --scenes cornell_box --bounces 1 --samples 512

The light's errors are relative to those of no indirect light at all and free of the noise of Cycles' light.
The picture is direct light with diffuse and glossy indirect light, the reference the same direct light with
Cycles' indirect light.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.cycles_truth import CyclesTruth, cycles_truth, real_scenes
from benchmarks.inputs import parse_size
from benchmarks.ray_truth import RAYS, RayTruth, ray_truth
from benchmarks.ray_verdicts import Judgement, RayScore, WrongHits
from benchmarks.variants import geometric_mean, relative_bias, relmse_without_noise
from benchmarks.wide_frame import wide_frame
from ssgi_addon.core import GBuffer, Settings, composite, render_indirect
from ssgi_addon.core.metrics import KNOWN_ENOUGH
from ssgi_addon.core.planner import is_colored
from ssgi_addon.core.scene import TraceScene
from ssgi_addon.core.settings import PRESETS
from ssgi_addon.frame import CapturedFrame

RAYS_PRESET = "final"
# Relative errors below this, or below 0, are noise: they count as this in means.
LEAST_ERROR = 1e-3


@dataclass(frozen=True)
class Configuration:
    """What is used of all that was captured.

    Attributes
    ----------
    views
        Names of the views, as in `CapturedFrame.view_names`.
    back_faces, behind, fill
        Whether the captured thickness, the layers behind and the fill are.
    """

    views: tuple[str, ...] = ()
    back_faces: bool = False
    behind: bool = False
    fill: bool = False

    def of(self, frame: CapturedFrame) -> CapturedFrame:
        """Return the frame without all else."""
        views = [
            (self._layers(gbuffer), camera)
            for (gbuffer, camera), name in zip(frame.views, frame.view_names, strict=True)
            if name in self.views
        ]
        return replace(
            frame,
            gbuffer=self._layers(frame.gbuffer),
            views=tuple(views),
            fill=frame.fill if self.fill else None,
        )

    def _layers(self, gbuffer: GBuffer) -> GBuffer:
        return replace(
            gbuffer,
            thickness=gbuffer.thickness if self.back_faces else None,
            behind=gbuffer.behind if self.behind else None,
        )


_OUT = ("surround",)
_AROUND = ("surround", "stations")
# Switch by switch, each beside what it is added to.
CONFIGURATIONS = {
    "frame": Configuration(),
    "overscan": Configuration(("overscan",)),
    "surround": Configuration(_OUT),
    "surround, overscan": Configuration(("surround", "overscan")),
    "surround, backs": Configuration(_OUT, back_faces=True),
    "surround, behind": Configuration(_OUT, behind=True),
    "surround, lights": Configuration(("surround", "lights")),
    "stations": Configuration(_AROUND),
    "stations, backs": Configuration(_AROUND, back_faces=True),
    "stations, lights": Configuration((*_AROUND, "lights")),
    "all": Configuration((*_AROUND, "overscan", "lights"), back_faces=True, behind=True),
    "fill": Configuration(fill=True),
    "surround, fill": Configuration(_OUT, fill=True),
    "stations, backs, fill": Configuration(_AROUND, back_faces=True, fill=True),
}


@dataclass(frozen=True)
class LightScore:
    """Errors of the light of one configuration, relative to no indirect light at all.

    Attributes
    ----------
    diffuse, picture
        relMSE of the diffuse light, over surfaces with a diffuse colour, and of the picture.
    diffuse_alone, picture_alone
        relMSE of no indirect light, which they are divided by.
    bias, known_bias
        Of the diffuse light, relative to the mean of the truth; and where at least nine tenths of the rays
        were answered, None where no pixel is.
    seconds
        Of all passes.
    """

    diffuse: float
    picture: float
    diffuse_alone: float
    picture_alone: float
    bias: float
    known_bias: float | None
    seconds: float


@dataclass(frozen=True)
class Score:
    """What one configuration gave on one scene; `light` is None where it was not asked for."""

    scene: str
    configuration: str
    rays: RayScore
    wrong: WrongHits
    light: LightScore | None


def score_rays(
    frame: CapturedFrame, configuration: Configuration, truth: RayTruth
) -> tuple[RayScore, WrongHits]:
    """Return what a configuration answers to the rays, and where its wrong hits come from."""
    used = configuration.of(frame)
    scene = TraceScene(used.gbuffer, used.camera, used.views, Settings.preset(RAYS_PRESET))
    judgement = Judgement(scene, truth)
    return judgement.score(), judgement.wrong_hits()


def score_light(
    frame: CapturedFrame, truth: CyclesTruth, configuration: Configuration, preset: str, bounces: int | None
) -> LightScore:
    """Return the errors of a preset's light.

    Parameters
    ----------
    frame
        With all views.
    truth
        The frame's light.
    configuration
        What is used of the frame.
    preset
        Name of the settings.
    bounces
        Of our diffuse light; None means the preset's.
    """
    used, settings = configuration.of(frame), Settings.preset(preset)
    if bounces is not None:
        settings = replace(settings, diffuse=replace(settings.diffuse, bounces=bounces))
    gbuffer = used.gbuffer
    start = time.perf_counter()
    light = render_indirect(gbuffer, used.camera, settings, used.environment, used.views, fill=used.fill)
    seconds = time.perf_counter() - start
    none = np.zeros_like(light.diffuse)
    everywhere = np.ones(gbuffer.shape, bool)
    counts = is_colored(gbuffer.albedo) & ~gbuffer.is_background
    pictures = np.stack(
        [
            composite(gbuffer, replace(light, diffuse=diffuse, glossy=glossy))
            for diffuse, glossy in zip(truth.diffuse_halves, truth.glossy_halves)
        ]
    )
    mean, known = truth.diffuse_halves.mean(axis=0), counts & (light.known_diffuse >= KNOWN_ENOUGH)
    diffuse_alone = relmse_without_noise(none, truth.diffuse_halves, counts)
    picture_alone = relmse_without_noise(gbuffer.direct, pictures, everywhere)
    return LightScore(
        diffuse=relmse_without_noise(light.diffuse, truth.diffuse_halves, counts) / diffuse_alone,
        picture=relmse_without_noise(composite(gbuffer, light), pictures, everywhere) / picture_alone,
        diffuse_alone=diffuse_alone,
        picture_alone=picture_alone,
        bias=relative_bias(light.diffuse, mean, counts),
        known_bias=relative_bias(light.diffuse, mean, known) if known.any() else None,
        seconds=seconds,
    )


def overall(scores: Sequence[Score]) -> dict[str, dict[str, float | None]]:
    """Return each configuration's figures over all scenes.

    Medians of the shares of rays, geometric means of the light's relative errors.
    """
    found: dict[str, dict[str, float | None]] = {}
    for name in dict.fromkeys(score.configuration for score in scores):
        own = [score for score in scores if score.configuration == name]
        found[name] = {}
        rays = [{**asdict(score.rays), **asdict(score.wrong)} for score in own]
        for key in rays[0]:
            shares = [row[key] for row in rays if row[key] is not None]
            found[name][key] = float(np.median(shares)) if shares else None
        lights = [score.light for score in own if score.light is not None]
        if lights:
            for key in ("diffuse", "picture"):
                found[name][key] = geometric_mean([max(getattr(light, key), LEAST_ERROR) for light in lights])
    return found


def _print_rays(scores: Sequence[Score], figures: Mapping[str, Mapping[str, float | None]]) -> None:
    names = [item.name for kind in (RayScore, WrongHits) for item in fields(kind) if item.name != "rays"]
    rows = [(one.scene, one.configuration, {**asdict(one.rays), **asdict(one.wrong)}) for one in scores]
    rows += [("median", name, dict(row)) for name, row in figures.items()]
    # Two lines of heads: the names are longer than the numbers
    heads = [name.rpartition("_") for name in names]
    print("\nshares of rays, %; from 'hits right' on of the hits (of the escapes: 'escapes right')")
    for place in (0, 2):
        print(f"{'':42}{''.join(f'{head[place]:>9}' for head in heads)}")
    for scene, configuration, row in rows:
        shares = ("" if row[name] is None else f"{100.0 * row[name]:.1f}" for name in names)
        print(f"{scene:20}{configuration:22}{''.join(f'{share:>9}' for share in shares)}")


def _print_light(scores: Sequence[Score], figures: Mapping[str, Mapping[str, float | None]]) -> None:
    print("\nrelMSE of the light, relative to that of no indirect light (which 'alone' tells)")
    print(f"{'':42}{'diffuse':>9}{'picture':>9}{'bias':>9}{'known':>9}{'alone':>18}{'seconds':>9}")
    for one in scores:
        if one.light is not None:
            light = one.light
            print(
                f"{one.scene:20}{one.configuration:22}{light.diffuse:9.4f}{light.picture:9.4f}{light.bias:+9.1%}"
                f"{'' if light.known_bias is None else f'{light.known_bias:+.1%}':>9}"
                f"{light.diffuse_alone:9.4f}{light.picture_alone:9.4f}{light.seconds:9.1f}"
            )
    for name, row in figures.items():
        print(f"{'geometric mean':20}{name:22}{row['diffuse']:9.4f}{row['picture']:9.4f}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=real_scenes(), help="real scenes")
    parser.add_argument("--configurations", nargs="+", choices=CONFIGURATIONS, default=list(CONFIGURATIONS))
    parser.add_argument("--size", type=parse_size, default=(480, 270), metavar="WIDTHxHEIGHT")
    parser.add_argument(
        "--rays", type=int, default=RAYS, help="per scene, whether their truth is certain or not"
    )
    parser.add_argument(
        "--no-light", dest="light", action="store_false", help="leave out the light, which is slow"
    )
    parser.add_argument("--preset", choices=PRESETS, default="balanced", help="of the light")
    parser.add_argument("--samples", type=int, default=128, help="of Cycles, per pixel")
    parser.add_argument("--bounces", type=int, help="of Cycles' light and ours; the scene's if left out")
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    return parser


def main() -> None:
    """Measure, print, and store where asked."""
    arguments = _parser().parse_args()
    scores = []
    for name in arguments.scenes:
        frame, truth = wide_frame(name, arguments.size), ray_truth(name, arguments.size, arguments.rays)
        agrees = f"depth agrees at {truth.depth_agrees.mean():.2%} of the pixels"
        print(f"{name}: {agrees}, truth is certain for {truth.counts.mean():.2%} of the rays", flush=True)
        target = None
        if arguments.light:
            target = cycles_truth(name, arguments.size, arguments.samples, arguments.bounces)
        for text in arguments.configurations:
            rays, wrong = score_rays(frame, CONFIGURATIONS[text], truth)
            light = target and score_light(
                frame, target, CONFIGURATIONS[text], arguments.preset, arguments.bounces
            )
            scores.append(Score(name, text, rays, wrong, light))
    figures = overall(scores)
    _print_rays(scores, figures)
    if arguments.light:
        _print_light(scores, figures)
    if arguments.output:
        names = ("scenes", "configurations", "preset", "size", "rays", "light", "samples", "bounces")
        parameters = {name: getattr(arguments, name) for name in names}
        results = {"overall": figures, "scores": [asdict(score) for score in scores]}
        record.store(arguments.output, parameters, results)


if __name__ == "__main__":
    main()
