# SPDX-License-Identifier: GPL-3.0-or-later
"""What flickers, without a reference: how the light of places differs from that in the frames around."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..camera_file import camera_from_json
from ..core import Camera, GBuffer
from ..core.carry import carry_over
from ..errors import SSGIError
from ..exr import read_layers
from ..manifest import FOLDER
from .manifests import Manifest, Unread

FloatArray = np.ndarray[Any, np.dtype[np.float32]]

# The deviation of x - 2 y + z, where each of the three has the deviation 1.
_SECOND_DIFFERENCE = 6.0**0.5
# Of the frame's mean brightness, beside the local one: as `core.metrics.DARK_SHARE`, so that black counts.
_DARK_SHARE = 0.01
# Between the samples of a neighbour, its four nearest are read: more would take noise away that is to be
# measured.
_REACH = 1
# A smaller share of a frame's surfaces tells nothing of it: a cut, or a camera that turns fast.
_LEAST_SEEN = 0.05
# So many places tell the mean square of noise to a hundredth, and more take longer.
_MOST_PLACES = 12_000


@dataclass(frozen=True, eq=False)
class Samples:
    """Small samples of a frame: surfaces, their mean incoming indirect radiance (h, w, 3), and the camera."""

    surfaces: GBuffer
    diffuse: FloatArray
    camera: Camera


@dataclass(frozen=True)
class Flicker:
    """What flickers at a frame.

    Attributes
    ----------
    value
        Relative: noise of the deviation s that differs from frame to frame gives s.
    seen
        Share of the frame's surfaces that both neighbours see, too.
    """

    value: float
    seen: float


def measure_flicker(
    folder: Path,
    manifests: Sequence[Manifest],
    frames: Sequence[int],
    progress: Callable[[float, str], None] | None = None,
) -> tuple[dict[int, Flicker], list[Unread]]:
    """Measure the flicker of the frames between two others; three frames are held at a time.

    Parameters
    ----------
    folder
        Of the results.
    manifests
        Of the finished frames, by rising number.
    frames
        All frames of the shot, missing and failed ones, too, by rising number. A frame's neighbours are the
        ones beside it there, if they are as far before as after.
    progress
        Called with a fraction and a text.

    Returns
    -------
    flicker
        By frame; only where it can be told.
    unread
        Samples that cannot be read, and why.
    """
    wanted = {manifest.frame: manifest for manifest in manifests}
    kept: dict[int, Samples | None] = {}
    found, unread = {}, []

    def samples(frame: int) -> Samples | None:
        if frame not in kept:
            kept[frame] = None
            try:
                kept[frame] = read_samples(folder, wanted[frame])
            except SSGIError as error:
                # Without its own name the reason is that of all such files
                path = samples_path(folder, wanted[frame])
                unread.append(Unread(path.name, str(error).replace(str(path), "it"), counts=False))
        return kept[frame]

    for index, (before, frame, after) in enumerate(zip(frames, frames[1:], frames[2:])):
        if progress is not None:
            progress(index / len(frames), "Measuring flicker")
        for old in [number for number in kept if number < before]:
            del kept[old]
        if frame - before != after - frame or not {before, frame, after} <= wanted.keys():
            continue
        three = [samples(number) for number in (before, frame, after)]
        if None not in three:
            flicker = flicker_between(*three)
            if flicker is not None:
                found[frame] = flicker
    return found, unread


def flicker_between(
    before: Samples, frame: Samples, after: Samples, threads: int | None = None
) -> Flicker | None:
    """Return how the light of a frame's surfaces differs from the mean of the frames before and after.

    The second difference ``L(t-1) - 2 L(t) + L(t+1)`` of the same place is 0 for light that stays, and for
    light that changes evenly. Its mean square over places and channels, relative to the light there, is 6
    times that of independent noise in the three frames. A place counts where all three see it; the
    neighbours are read between their samples, which takes up to an eighth off noise of single pixels while
    the camera moves.

    Parameters
    ----------
    before, frame, after
        Evenly apart in time.
    threads
        Worker threads; None means all cores. Never changes a result.

    Returns
    -------
    Flicker or None
        None where too little of the frame is seen from all three, or no light is there.
    """
    pixel = np.flatnonzero(~frame.surfaces.is_background)
    pixel = pixel[:: max(1, -(-pixel.size // _MOST_PLACES))]
    light = [frame.diffuse.reshape(-1, 3).take(pixel, axis=0)]
    is_seen = np.ones(pixel.size, dtype=np.bool_)
    for other in (before, after):
        (values,), is_found = carry_over(
            [other.diffuse.reshape(-1, 3)],
            (other.surfaces, other.camera),
            (frame.surfaces, frame.camera),
            pixel,
            threads,
            is_strict=True,
            reach=_REACH,
        )
        light.append(values)
        is_seen &= is_found
    seen = float(is_seen.mean()) if pixel.size else 0.0
    if seen < _LEAST_SEEN:
        return None
    own, earlier, later = (values[is_seen].astype(np.float64) for values in light)
    change = ((earlier - 2.0 * own + later) ** 2).sum(axis=1)
    brightness = (((earlier + own + later) / 3.0) ** 2).sum(axis=1)
    level = brightness.mean()
    if not level > 0.0:
        return None
    relative = change / (brightness + _DARK_SHARE * level)
    return Flicker(float(np.sqrt(relative.mean())) / _SECOND_DIFFERENCE, seen)


def samples_path(folder: Path, manifest: Manifest) -> Path:
    """Return where the small samples of a frame lie."""
    return folder / FOLDER / f"{manifest.stem}.exr"


def read_samples(folder: Path, manifest: Manifest) -> Samples:
    """Read the small samples of a frame.

    Raises
    ------
    SSGIError
        If the file or the camera is missing or damaged, or they do not fit together.
    """
    path = samples_path(folder, manifest)
    camera = camera_from_json(manifest.camera, path.with_suffix(".json"))
    layers = read_layers(path)
    try:
        return make_samples(camera, *(layers[name] for name in ("depth", "normal", "diffuse")))
    except KeyError as error:
        raise SSGIError(f"{path} lacks {error}: render the frame again") from error
    except ValueError as error:
        raise SSGIError(f"{path} does not fit to its camera ({error}): render the frame again") from error


def make_samples(camera: Camera, depth: FloatArray, normal: FloatArray, diffuse: FloatArray) -> Samples:
    """Return samples of a view; places whose light is no number are background.

    Raises
    ------
    ValueError
        If an array has not the camera's size.
    """
    shape = (camera.height, camera.width)
    if depth.shape != shape or diffuse.shape != (*shape, 3):
        raise ValueError(f"expected {shape}, got depth {depth.shape} and diffuse {diffuse.shape}")
    black = np.zeros((*shape, 3), dtype=np.float32)
    # As light it is cleaned: bad pixels become black
    surfaces = GBuffer(depth, normal, black, black, black[..., 0], diffuse)
    is_bad = (surfaces.direct != diffuse).any(axis=-1)
    if is_bad.any():
        depth = np.where(is_bad, np.float32(np.inf), depth)
        surfaces = GBuffer(depth, normal, black, black, black[..., 0], diffuse)
    return Samples(surfaces, surfaces.direct, camera)
