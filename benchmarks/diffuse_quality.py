# SPDX-License-Identifier: GPL-3.0-or-later
"""How far each method of the diffuse pass is from what it approximates, and what it costs.

Either from the hemispheres of the frame alone, integrated by many traced rays (`hemisphere_truth`), over all
pixels with a diffuse colour; or, with ``--cycles``, from Cycles' Diffuse Indirect, with the surround and all
bounces, over pixels of which at least nine tenths were answered. Run from the repository's root:

    python -m benchmarks.diffuse_quality [--scenes bathroom ...] [--size 480x270] [--rounds 3]
        [--variant rays=4,filter=false --variant method=hemisphere,rays=8 ...] [--output FILE.json]
        [--plot docs/images/diffuse_frontier.png]
    python -m benchmarks.diffuse_quality --cycles [--samples 128] [--bounces 1] ...

A variant names what differs from the default diffuse settings; their bounces are those of the reference: one,
with ``--cycles`` four, or as ``--bounces`` says.

With the scene's own bounces Cycles counts light that surfaces on the way reflect by their gloss, which the
pass hands on only as far as a capture puts it into the first bounce. And a pixel whose rays are known still
lacks what is unknown at its hits. ``--bounces 1`` compares without both: light that was reflected once.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks import hemisphere_truth, record
from benchmarks.cycles_truth import captured_frame, cycles_truth, real_scenes
from benchmarks.frontier_plot import Point, draw_frontiers
from benchmarks.hemisphere_truth import diffuse_light
from benchmarks.inputs import Size, parse_size
from benchmarks.variants import geometric_mean, noise_of, parse_variant, relative_bias
from ssgi_addon.core import DiffuseSettings, IndirectLight
from ssgi_addon.core.metrics import KNOWN_ENOUGH, relmse
from ssgi_addon.core.planner import is_colored
from ssgi_addon.core.types import BoolArray, FloatArray
from ssgi_addon.frame import CapturedFrame

# Interiors, a corridor and an object before a backdrop.
SCENES = ("living_room", "bathroom", "classroom", "sponza_crytek_aisle", "spaceship")
# Each with more and more samples: a line of the plot.
VARIANTS = (
    *(f"method=hemisphere,filter=false,rays={rays}" for rays in (1, 4, 16)),
    *(f"method=hemisphere,rays={rays}" for rays in (1, 2, 4, 8, 16, 32)),
    *(f"method={method},slices={slices}" for method in ("horizon", "bitmask") for slices in (1, 2, 4)),
    *(f"traced=false,rays={rays}" for rays in (2, 8, 32)),
    "method=ssao,rays=16",
)
CYCLES_VARIANTS = ("method=hemisphere,rays=32,filter=false", "method=hemisphere,rays=6,filter=true")
# Diffuse bounces of a new scene in Blender; none of the real ones has another number.
CYCLES_BOUNCES = 4
_CHOOSING_RAYS = 64
_CHOOSING_SEED = 7


@dataclass(frozen=True, eq=False)
class Target:
    """A frame and what its diffuse light should be.

    Attributes
    ----------
    scene
        Its name.
    frame
        What the pass is given.
    halves : (2, H, W, 3)
        The light, in halves that differ by noise alone.
    visibility : (H, W), optional
        None where the reference has none.
    counts : (H, W) bool
        The pixels to judge.
    """

    scene: str
    frame: CapturedFrame
    halves: FloatArray
    visibility: FloatArray | None
    counts: BoolArray


@dataclass(frozen=True)
class Score:
    """What one variant gave on one scene.

    Attributes
    ----------
    scene, variant
        Names.
    seconds, spread
        Of the diffuse pass: the best of all rounds, and (slowest - fastest) / fastest.
    rays
        Traced in the frame.
    pixels
        Number of those that count.
    relmse, bias, rms
        Of the light; bias and root mean square relative to the mean of the reference.
    visibility_error, visibility_bias
        Mean absolute and mean signed error; None where the reference has no visibility.
    noise
        What the noise of the reference adds to the relMSE.
    """

    scene: str
    variant: str
    seconds: float
    spread: float
    rays: int
    pixels: int
    relmse: float
    bias: float
    rms: float
    visibility_error: float | None
    visibility_bias: float | None
    noise: float


def frame_alone(name: str, size: Size, rays: int) -> Target:
    """Return what the frame itself can answer, by so many rays per pixel."""
    truth = hemisphere_truth.hemisphere_truth(name, captured_frame(name, size), rays)
    return Target(name, truth.frame, truth.halves[..., :3], truth.visibility, _has_light(truth.frame))


def against_cycles(name: str, size: Size, samples: int, bounces: int | None) -> Target:
    """Return what Cycles finds, at pixels that frame and surround can answer.

    Rays of a seed of their own choose them: pixels that are chosen by the rays that light them are brighter
    than they should be.
    """
    truth = cycles_truth(name, size, samples, bounces)
    choosing = DiffuseSettings(method="hemisphere", rays=_CHOOSING_RAYS, bounces=1, filter=False)
    known = diffuse_light(truth.frame, choosing, seed=_CHOOSING_SEED).known_diffuse
    counts = _has_light(truth.frame) & (known >= KNOWN_ENOUGH)
    return Target(name, truth.frame, truth.diffuse_halves, None, counts)


def _has_light(frame: CapturedFrame) -> BoolArray:
    """Return where the pass has something to do."""
    return ~frame.gbuffer.is_background & is_colored(frame.gbuffer.albedo)


def measure(target: Target, variants: Mapping[str, DiffuseSettings], rounds: int) -> Iterator[Score]:
    """Yield the score of each variant on one scene.

    Parameters
    ----------
    target
        Frame and reference.
    variants
        By name; they take turns, so that a slow minute meets them all.
    rounds
        Times to run each; the fastest counts.
    """
    if not target.counts.any():
        print(f"{target.scene}: no pixel is answered well enough")
        return
    lights = {name: diffuse_light(target.frame, diffuse) for name, diffuse in variants.items()}
    seconds = {name: [light.seconds["diffuse"]] for name, light in lights.items()}
    for _ in range(rounds - 1):
        for name, diffuse in variants.items():
            seconds[name].append(diffuse_light(target.frame, diffuse).seconds["diffuse"])
    for name, light in lights.items():
        yield _score(target, name, light, seconds[name])


def _score(target: Target, variant: str, light: IndirectLight, seconds: list[float]) -> Score:
    truth, counts = target.halves.mean(axis=0), target.counts
    error = (light.diffuse - truth)[counts].astype(np.float64)
    opener = None
    if target.visibility is not None:
        opener = (light.visibility - target.visibility)[counts].astype(np.float64)
    return Score(
        scene=target.scene,
        variant=variant,
        seconds=min(seconds),
        spread=max(seconds) / min(seconds) - 1.0,
        rays=light.rays["diffuse"],
        pixels=int(np.count_nonzero(counts)),
        relmse=relmse(light.diffuse, truth, mask=counts),
        bias=relative_bias(light.diffuse, truth, counts),
        rms=float(np.sqrt((error**2).mean()) / truth[counts].mean(dtype=np.float64)),
        visibility_error=None if opener is None else float(np.abs(opener).mean()),
        visibility_bias=None if opener is None else float(opener.mean()),
        noise=noise_of(target.halves, counts),
    )


def overall(scores: list[Score]) -> dict[str, dict[str, float | None]]:
    """Return each variant's figures over all scenes.

    Geometric means of seconds and relMSE, median and worst of the bias, the mean error of the visibility.
    """
    found = {}
    for variant in dict.fromkeys(score.variant for score in scores):
        own = [score for score in scores if score.variant == variant]
        visibility = [score.visibility_error for score in own if score.visibility_error is not None]
        found[variant] = {
            "seconds": geometric_mean([score.seconds for score in own]),
            "relmse": geometric_mean([score.relmse for score in own]),
            "median_bias": float(np.median([abs(score.bias) for score in own])),
            "worst_bias": max((score.bias for score in own), key=abs),
            "visibility_error": float(np.mean(visibility)) if visibility else None,
        }
    return found


def frontier_points(scores: list[Score]) -> list[Point]:
    """Return the plot's points: a panel for each scene and one for all, a line for each ladder of rays."""
    points = [Point(score.scene, _line(score.variant), score.seconds, score.relmse) for score in scores]
    mean = "geometric mean"
    for variant, figures in overall(scores).items():
        points.append(Point(mean, _line(variant), figures["seconds"], figures["relmse"]))
    return points


def _line(variant: str) -> str:
    """Return what a variant is but for its number of samples."""
    kept = (part for part in variant.split(",") if not part.startswith(("rays=", "slices=")))
    return ",".join(kept) or "default"


def _print_score(score: Score) -> None:
    visibility = "" if score.visibility_error is None else f"{score.visibility_error:.4f}"
    visibility_bias = "" if score.visibility_bias is None else f"{score.visibility_bias:+.4f}"
    print(
        f"{score.scene:20}{score.seconds:9.3f}{score.spread:8.0%}{score.pixels:8}{score.relmse:10.5f}"
        f"{score.bias:+9.2%}{score.rms:8.3f}{visibility:>11}{visibility_bias:>9}{score.noise:9.5f}"
        f"  {score.variant}",
        flush=True,
    )


def _run(arguments: argparse.Namespace, names: list[str]) -> list[Score]:
    base = DiffuseSettings(bounces=(arguments.bounces or CYCLES_BOUNCES) if arguments.cycles else 1)
    variants = {text: parse_variant(text, base) for text in names}
    bounces = arguments.bounces or "the scene's"
    of_what = (
        f"Cycles, {arguments.samples} samples, {bounces} bounces" if arguments.cycles else "the frame alone"
    )
    print(f"{arguments.size[0]} x {arguments.size[1]}, against {of_what}")
    print(
        f"{'scene':20}{'seconds':>9}{'spread':>8}{'pixels':>8}{'relMSE':>10}{'bias':>9}{'rms':>8}"
        f"{'visibility':>11}{'bias':>9}{'noise':>9}  variant"
    )
    scores = []
    for name in arguments.scenes or (real_scenes() if arguments.cycles else SCENES):
        if arguments.cycles:
            target = against_cycles(name, arguments.size, arguments.samples, arguments.bounces)
        else:
            target = frame_alone(name, arguments.size, arguments.truth_rays)
        for score in measure(target, variants, arguments.rounds):
            _print_score(score)
            scores.append(score)
    return scores


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", action="store_true", help="against Cycles, with surround and all bounces")
    parser.add_argument("--size", type=parse_size, default=(480, 270), metavar="WIDTHxHEIGHT")
    parser.add_argument("--scenes", nargs="+", help="real scenes")
    parser.add_argument("--samples", type=int, default=128, help="of Cycles, per pixel")
    parser.add_argument("--bounces", type=int, help="of Cycles' light and ours; the scene's if left out")
    parser.add_argument("--truth-rays", type=int, default=hemisphere_truth.RAYS, help="of the integral")
    parser.add_argument("--variant", action="append", metavar="NAME=VALUE,...", help="settings to measure")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each variant; the fastest counts")
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw error over time there")
    return parser


def main() -> None:
    """Measure, print, and store and draw where asked."""
    parser = _parser()
    arguments = parser.parse_args()
    variants = arguments.variant or list(CYCLES_VARIANTS if arguments.cycles else VARIANTS)
    scores = _run(arguments, variants)
    figures = overall(scores)
    for variant, found in figures.items():
        print(
            f"{variant}: relMSE {found['relmse']:.5f} in {found['seconds']:.3f} s (geometric means), "
            f"|bias| {found['median_bias']:.2%} (median; worst {found['worst_bias']:+.2%})"
        )
    if arguments.output:
        names = ("cycles", "size", "scenes", "samples", "bounces", "truth_rays", "rounds")
        parameters = {name: getattr(arguments, name) for name in names}
        results = {"overall": figures, "scores": [asdict(score) for score in scores]}
        record.store(arguments.output, {**parameters, "variants": variants}, results)
    if arguments.plot:
        draw_frontiers(frontier_points(scores), arguments.plot)


if __name__ == "__main__":
    main()
