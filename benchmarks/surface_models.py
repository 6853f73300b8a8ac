# SPDX-License-Identifier: GPL-3.0-or-later
"""Which meaning of a depth pixel shows mirrors best: the tracer's patches, or what others use?

Planes and spheres with closed-form reflections, one ray per mirror pixel. Run from the repository's root:

    python -m benchmarks.surface_models [--quick] [--output FILE.json]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path

import numpy as np

from benchmarks import record
from benchmarks.filtered_depth import FilteredDepth, trace_filtered
from ssgi_addon.core import Camera, Settings, tracer
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.frame_points import surface_points, toward_camera
from ssgi_addon.core.types import FloatArray, IntArray
from tests.core.mirror_scenes import LENSES, SCENES
from tests.core.synthetic import Surface, capture
from tests.reference.mirror_truth import mirror_at, surfaces_seen

SIZES = ((480, 270), (960, 540))
# More mirror pixels than this are thinned out, evenly.
_MOST_RAYS = 30_000
# A mirrored ray that is this short on the screen shows a contact, pixels.
_CONTACT_PX = 4.0

Trace = Callable[[FloatArray, FloatArray], tracer.TraceResult]


@dataclass(frozen=True)
class Score:
    """How well one model shows one mirror.

    Attributes
    ----------
    known, contact
        Share of the visible reflections that are hits, %: of all, and of those at most four pixels long
        (None where there are none).
    at_pixel, between, at_place
        Mean error of the light of known visible reflections, % of the texture's contrast: of the hit pixel's
        colour, of colours interpolated at the place that was found, and of the true texture there.
    mean_px, p95_px
        Distance between the place that was found and the true one, pixels.
    wrong
        Share of the known visible reflections that show another surface, %.
    false, itself
        Share of the reflections that the camera does not see and that are hits all the same, %; and of
        all rays that hit the mirror which they leave.
    cells
        Pixels from the origin to the hit, as a linear walk crosses them.
    """

    known: float
    contact: float | None
    at_pixel: float
    between: float
    at_place: float
    mean_px: float
    p95_px: float
    wrong: float
    false: float
    itself: float
    cells: float


class MirrorScene:
    """A mirror, the rays that leave it and what they should find.

    Parameters
    ----------
    camera
        Who looks.
    surfaces
        The scene.
    mirror
        Index of the surface whose pixels are measured.
    """

    def __init__(self, camera: Camera, surfaces: list[Surface], mirror: int) -> None:
        self.camera, self.surfaces = camera, surfaces
        self.gbuffer = capture(camera, surfaces)
        everywhere = np.arange(camera.width * camera.height)
        self.owner, _ = surfaces_seen(
            camera, surfaces, everywhere % camera.width + 0.5, everywhere // camera.width + 0.5
        )
        self.image = self.gbuffer.reflection_source.astype(np.float64).reshape(-1, 3)
        is_textured = (self.gbuffer.specular[..., 0] == 0.0) & ~self.gbuffer.is_background
        self.contrast = np.ptp(self.gbuffer.direct[is_textured], axis=0)
        pixel = np.flatnonzero(self.owner == mirror)
        self.pixel = pixel[:: -(-pixel.size // _MOST_RAYS)]
        self.truth = mirror_at(camera, surfaces, self.pixel)
        self.origin, normal = surface_points(self.gbuffer, camera, self.pixel)
        view = toward_camera(camera, self.origin)
        self.direction = 2.0 * (normal * view).sum(axis=0) * normal - view

    def score(self, trace: Trace) -> Score:
        """Trace the mirror's rays and compare what they find with the truth."""
        found, truth = trace(self.origin, self.direction), self.truth
        is_hit = found.status == tracer.HIT
        shown = np.flatnonzero(truth.is_visible & is_hit)
        x, y = found.x_px[shown].astype(np.float64), found.y_px[shown].astype(np.float64)
        seen, there = surfaces_seen(self.camera, self.surfaces, x, y)
        pixel = found.pixel[shown]
        off = np.hypot(x - truth.x_px[shown], y - truth.y_px[shown])
        across, down = self._way(self.pixel, truth.x_px, truth.y_px)
        is_contact = truth.is_visible & (np.hypot(across, down) <= _CONTACT_PX)
        hits = np.flatnonzero(is_hit)
        crossed = np.abs(self._way(self.pixel[shown], np.floor(x) + 0.5, np.floor(y) + 0.5)).sum(axis=0)
        return Score(
            known=_percent(is_hit[truth.is_visible]),
            contact=_percent(is_hit[is_contact]) if is_contact.any() else None,
            at_pixel=self._error(shown, self.image[pixel]),
            between=self._error(shown, self._between(pixel, x, y)),
            at_place=self._error(shown, there),
            mean_px=float(off.mean()),
            p95_px=float(np.quantile(off, 0.95)),
            wrong=_percent(seen != truth.surface[shown]),
            false=_percent(is_hit[~truth.is_visible]),
            itself=float(100.0 * (self.owner[found.pixel[hits]] == truth.owner[hits]).sum() / is_hit.size),
            cells=float(crossed.mean()),
        )

    def _between(self, pixel: IntArray, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
        """Return colours (N, 3) at places in pixels, interpolated between pixels of the same surface."""
        width, height = self.camera.width, self.camera.height
        left, top = np.floor(x_px - 0.5).astype(np.int64), np.floor(y_px - 0.5).astype(np.int64)
        u, v = x_px - 0.5 - left, y_px - 0.5 - top
        total, weights = np.zeros((pixel.size, 3)), np.zeros((pixel.size, 1))
        for down, row_weight in ((0, 1.0 - v), (1, v)):
            for right, column_weight in ((0, 1.0 - u), (1, u)):
                row, column = np.clip(top + down, 0, height - 1), np.clip(left + right, 0, width - 1)
                other = row * width + column
                weight = row_weight * column_weight * (self.owner[other] == self.owner[pixel])
                total += weight[:, None] * self.image[other]
                weights += weight[:, None]
        mean: FloatArray = total / weights
        return mean

    def _error(self, shown: IntArray, radiance: FloatArray) -> float:
        """Return the mean error of colours, % of the contrast among what is no mirror."""
        return float(100.0 * (np.abs(radiance - self.truth.radiance[shown]) / self.contrast).mean())

    def _way(self, pixel: IntArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the way on the screen from the centres of pixels to places (2, N)."""
        return np.stack([x - (pixel % self.camera.width + 0.5), y - (pixel // self.camera.width + 0.5)])


def pyramid_steps(scene: MirrorScene) -> float:
    """Return how many cells of any level the tracer's walk looks at per ray, from what step budgets leave."""
    field = DepthField.build(scene.gbuffer, scene.camera, Settings().thickness)
    whole = tracer.trace_rays(field, scene.origin, scene.direction)
    steps, budget, last, left = 0.0, 1, 0, 1.0
    while left > 0.0:
        cut = tracer.trace_rays(field, scene.origin, scene.direction, max_steps=budget)
        still = float(((cut.status != whole.status) | (cut.distance != whole.distance)).mean())
        steps += (budget - last) * 0.5 * (left + still)
        last, left, budget = budget, still, budget + max(1, budget // 4)
    return steps


def models(scene: MirrorScene) -> dict[str, Trace]:
    """Return one way to trace rays for each meaning of a depth pixel."""
    field = DepthField.build(scene.gbuffer, scene.camera, Settings().thickness, max_level=0)
    # The bounds of level 0 hold the tilted patches, and hold level ones all the more
    level = field.planes.copy()
    level[:, 1:3] = 0.0

    def walk_through(patches: DepthField) -> Trace:
        return lambda origin, direction: tracer.trace_rays(patches, origin, direction)

    def march_over(depth: FilteredDepth) -> Trace:
        return lambda origin, direction: trace_filtered(depth, origin, direction)

    return {
        "constant": walk_through(replace(field, planes=level)),
        "patch": walk_through(field),
        "pair": march_over(FilteredDepth.of(field, is_pair=True)),
        "bilinear": march_over(FilteredDepth.of(field, is_pair=False)),
    }


def _percent(share: FloatArray) -> float:
    return float(100.0 * share.mean())


def main() -> None:
    """Measure all models on all scenes, print one table and store it."""
    parser = argparse.ArgumentParser(description="Which meaning of a depth pixel shows mirrors best?")
    parser.add_argument("--quick", action="store_true", help="the smaller frame alone")
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="store the results there")
    arguments = parser.parse_args()
    columns = [*(field.name for field in fields(Score)), "steps"]
    print(f"{'scene':17}{'lens':13}{'size':>9}  {'model':9}" + "".join(f"{name:>9}" for name in columns))
    rows = []
    for width, height in SIZES[:1] if arguments.quick else SIZES:
        for lens, camera in LENSES.items():
            for name, (build, mirror) in SCENES.items():
                scene = MirrorScene(camera(width, height), build(), mirror)
                for model, trace in models(scene).items():
                    # The others are measured as linear walks: their steps are the cells
                    steps = pyramid_steps(scene) if model == "patch" else None
                    values = [*astuple(scene.score(trace)), steps]
                    texts = "".join(f"{'':9}" if value is None else f"{value:9.3f}" for value in values)
                    print(f"{name:17}{lens:13}{width:>5}x{height}  {model:9}{texts}", flush=True)
                    row = {"scene": name, "lens": lens, "size": [width, height], "model": model}
                    rows.append({**row, **dict(zip(columns, values, strict=True))})
    if arguments.output:
        record.store(arguments.output, {"quick": arguments.quick}, rows)


if __name__ == "__main__":
    main()
