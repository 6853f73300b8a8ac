# SPDX-License-Identifier: GPL-3.0-or-later
"""From a captured frame to the finished picture and its file; no Blender needed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import __version__
from .core import IndirectLight, Settings, composite, render_indirect
from .core.metrics import compare_images
from .errors import SSGIError
from .exr import write_layers
from .exr_header import read_headers
from .files import check_writable, discard_abandoned
from .frame import CapturedFrame
from .memory import APPLY_BYTES, check_memory
from .passes import read_passes
from .recipe import RECIPE, Recipe, recipe_text

FloatArray = np.ndarray[Any, np.dtype[np.float32]]
Progress = Callable[[float, str], None]

OUT_OF_MEMORY = "not enough memory: render at a lower resolution, or with fewer rays or views"


@dataclass(frozen=True, eq=False)
class Picture:
    """A captured frame with its indirect light.

    Attributes
    ----------
    frame, light
        What went in and what came out.
    combined : (H, W, 3)
        direct + albedo * diffuse + specular * glossy, scene-linear; denoised where that was asked for.
    """

    frame: CapturedFrame
    light: IndirectLight
    combined: FloatArray


def compute_picture(frame: CapturedFrame, settings: Settings, progress: Progress | None = None) -> Picture:
    """Compute the indirect light of a captured frame and add it.

    Parameters
    ----------
    frame
        What was captured.
    settings
        How to sample.
    progress
        Called with a fraction and a text; may raise to cancel.

    Raises
    ------
    SSGIError
        If the passes do not fit together.
    """
    try:
        light = render_indirect(
            frame.gbuffer, frame.camera, settings, frame.environment,
            views=frame.views, progress=progress, fill=frame.fill,
        )  # fmt: skip
    except ValueError as error:
        raise SSGIError(f"the passes cannot be used: {error}") from error
    except (MemoryError, SystemError) as error:  # numpy may lose the former on its way out of a function
        raise SSGIError(OUT_OF_MEMORY) from error
    return Picture(frame, light, composite(frame.gbuffer, light))


def write_picture(picture: Picture, path: Path, recipe: Recipe | None = None) -> None:
    """Write the result as one multilayer EXR file, which carries what it was made with.

    Parameters
    ----------
    picture
        The result.
    path
        The file; an older one is replaced.
    recipe
        What the picture was made with, as plain data; None tells nothing.

    Raises
    ------
    SSGIError
        If the file cannot be written.
    """
    gbuffer, light = picture.frame.gbuffer, picture.light
    layers = {
        "combined": picture.combined,
        "direct": gbuffer.direct,
        "diffuse": light.diffuse,
        "glossy": light.glossy,
        "visibility": light.visibility,
        "known": light.known,
        "albedo": gbuffer.albedo,
        "specular": gbuffer.specular,
    }
    told = {} if recipe is None else {RECIPE: recipe_text(recipe)}
    write_layers(path, layers, {"Software": f"ssgi {__version__}", **told})


def apply_passes(
    passes_path: Path,
    output_path: Path,
    camera_path: Path | None,
    settings: Settings,
    progress: Progress | None = None,
) -> None:
    """Add the indirect light to passes that were rendered earlier, and write the result.

    Parameters
    ----------
    passes_path
        Multilayer EXR file: ours, or Blender's.
    output_path
        The EXR file to write; an older one is replaced.
    camera_path
        JSON file with the camera, where the EXR file has none beside it.
    settings
        How to sample.
    progress
        Called with a fraction and a text.

    Raises
    ------
    SSGIError
        If the passes cannot be read, lack something, or the result cannot be written.
    """
    check_writable(output_path.parent)
    discard_abandoned(output_path.parent)
    if output_path.suffix.lower() != ".exr":
        raise SSGIError(f"{output_path} should end in .exr: the result is a multilayer EXR file")
    if output_path.resolve() == passes_path.resolve():
        raise SSGIError(f"{output_path} is the file with the passes: give the result another name")
    check_memory(read_headers(passes_path)[0].size, APPLY_BYTES)
    write_picture(compute_picture(read_passes(passes_path, camera_path), settings, progress), output_path)


def measure_errors(
    picture: Picture, combined: FloatArray, diffuse: FloatArray, glossy: FloatArray
) -> dict[str, dict[str, float | None]]:
    """Compare a picture, and its direct light alone, with a reference's passes.

    Parameters
    ----------
    picture
        The result.
    combined, diffuse, glossy : (H, W, 3)
        Cycles' picture, its Diffuse Indirect and its Glossy Indirect, scene-linear.

    Returns
    -------
    dict
        Figures as in `core.metrics.compare_images`, for ``combined``, ``direct_only``, ``diffuse`` and
        ``glossy``.
    """
    return {
        "combined": compare_images(picture.combined, combined),
        "direct_only": compare_images(picture.frame.gbuffer.direct, combined),
        "diffuse": compare_images(picture.light.diffuse, diffuse),
        "glossy": compare_images(picture.light.glossy, glossy),
    }


def peak_memory_mb() -> float | None:
    """Return the largest resident size that this process has had, MB; None where the system does not tell."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return None
    units_per_mb = 1e6 if sys.platform == "darwin" else 1e3
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / units_per_mb, 1)
