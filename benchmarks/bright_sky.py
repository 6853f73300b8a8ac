# SPDX-License-Identifier: GPL-3.0-or-later
"""A ball on a floor under real skies: error and time with shadow rays to the sun, and without.

Each setting runs with three seeds; the error is their mean relMSE against many rays of both kinds, the time
the best of the three. Needs Blender as a module, which reads the images. Run from the repository's root:

    python -m benchmarks.bright_sky [SKY.hdr ...] [--size 320x180]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.inputs import SCENES, Size, parse_size
from ssgi_addon.core import Camera, Environment, GBuffer, Settings, render_indirect
from tests.core.synthetic import Plane, Sphere, capture, look_at

SKIES = ("noon_grass_1k.hdr", "vestibule_1k.hdr")
# Rays over the hemisphere and toward the bright sky.
SETTINGS = ((6, 0), (12, 0), (24, 0), (6, 1), (6, 2), (6, 4))
SEEDS = 3
# View +Y up, and the skies turned so that their brightest part stands to the side.
UP_IS_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
TURN = 0.6


def read_sky(path: Path, camera: Camera) -> Environment:
    """Return the environment that an image file holds."""
    import bpy

    bpy.utils.expose_bundled_modules()
    import OpenImageIO

    image = OpenImageIO.ImageInput.open(str(path)).read_image(0, 0, 0, 3, "float")
    turn = np.array([[np.cos(TURN), -np.sin(TURN), 0.0], [np.sin(TURN), np.cos(TURN), 0.0], [0.0, 0.0, 1.0]])
    return Environment.equirectangular(np.asarray(image), turn @ UP_IS_Z @ camera.world_from_view[:3, :3])


def scene(size: Size) -> tuple[GBuffer, Camera]:
    pose = look_at((0.0, 2.2, 6.0), (0.0, 0.6, 0.0))
    camera = Camera.perspective(*size, 1.0, world_from_view=pose)
    floor = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), albedo=0.6)
    return capture(camera, [floor, Sphere((0.0, 1.0, 0.0), 1.0, albedo=0.7)]), camera


def settings_with(rays: int, sky_rays: int, seed: int, *, is_smooth: bool = True) -> Settings:
    base = Settings(seed=seed)
    diffuse = replace(base.diffuse, rays=rays, sky_rays=sky_rays, bounces=2, filter=is_smooth)
    return replace(base, diffuse=diffuse, reflections=replace(base.reflections, enabled=False))


def relmse(image: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean squared error over the truth's square plus a hundredth of its mean's."""
    truth = truth.astype(np.float64)
    return float(((image - truth) ** 2 / (truth**2 + 0.01 * truth.mean() ** 2)).mean())


def measure(gbuffer: GBuffer, camera: Camera, sky: Environment) -> None:
    """Print a row of the table for each setting."""
    surface = ~gbuffer.is_background
    many = [settings_with(32, 64, 700 + seed, is_smooth=False) for seed in range(2)]
    truth = np.mean([render_indirect(gbuffer, camera, each, sky).diffuse for each in many], axis=0)
    print("| hemisphere rays | sky rays | relMSE | seconds |\n| --- | --- | --- | --- |")
    for rays, sky_rays in SETTINGS:
        errors, seconds = [], []
        for seed in range(SEEDS):
            begun = time.perf_counter()
            light = render_indirect(gbuffer, camera, settings_with(rays, sky_rays, seed), sky)
            seconds.append(time.perf_counter() - begun)
            errors.append(relmse(light.diffuse[surface], truth[surface]))
        print(f"| {rays} | {sky_rays} | {np.mean(errors):.4f} | {min(seconds):.2f} |")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bright_sky", description=__doc__)
    parser.add_argument("skies", nargs="*", type=Path, default=[SCENES / name for name in SKIES])
    parser.add_argument("--size", type=parse_size, default=(320, 180))
    arguments = parser.parse_args()
    gbuffer, camera = scene(arguments.size)
    for path in arguments.skies:
        if not path.is_file():
            print(f"{path}: not there; name the folder in SSGI_SCENES")
            continue
        print(f"\n{path.stem}\n")
        measure(gbuffer, camera, read_sky(path, camera))


if __name__ == "__main__":
    main()
