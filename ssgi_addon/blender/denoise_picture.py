# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean a finished picture with Cycles' denoiser: direct and indirect light at once.

Cycles denoises files that it rendered earlier (its operator "Denoise Animation"). The picture goes there and
back as such a file, since its denoiser takes no arrays, and within a render it knows nothing of our light.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import Settings
from ..errors import SSGIError
from ..exr import PREFIX, read_layers, write_layers
from ..files import scratch_folder
from ..frame import CapturedFrame
from ..results import Picture, compute_picture
from . import compat
from .render_settings import borrow_denoiser
from .restore import Restorer

FloatArray = NDArray[np.float32]
Progress = Callable[[float, str], None]


def can_denoise_pictures(scene: bpy.types.Scene) -> bool:
    """Whether this build of Blender has what `denoise_picture` needs."""
    # Without Cycles, as an EEVEE user may have it, neither is there
    return hasattr(scene, "cycles") and compat.has_denoiser(scene) and compat.denoises_files()


def compute_denoised_picture(
    scene: bpy.types.Scene, captured: CapturedFrame, settings: Settings, progress: Progress
) -> tuple[Picture, dict[str, float]]:
    """Compute the indirect light of a captured frame without our filters, and denoise the sum.

    What few samples brought to many pixels, diffuse light of a lower resolution, is filtered all the same:
    its noise would be detail to the denoiser. For the same reason pixels do not share reflection rays.

    Parameters
    ----------
    scene
        As in `denoise_picture`.
    captured
        Its direct light is noisy.
    settings
        Of the passes.
    progress
        Called with a fraction and a text.

    Returns
    -------
    picture
        `Picture.combined` is clean; the light that it was made of is as the rays brought it.
    seconds
        Wall time of the passes and of the denoiser.

    Raises
    ------
    SSGIError
        If the passes do not fit together, or the denoiser fails.
    """
    begun = time.perf_counter()
    settings = replace(
        settings,
        diffuse=replace(settings.diffuse, filter=settings.diffuse.resolution != "full"),
        reflections=replace(settings.reflections, filter=False, reuse=0),
    )
    picture = compute_picture(captured, settings, progress)
    denoising = time.perf_counter()
    progress(1.0, "Denoising")
    gbuffer = captured.gbuffer
    clean = denoise_picture(scene, picture.combined, gbuffer.albedo + gbuffer.specular, gbuffer.normal)
    seconds = {"passes": denoising - begun, "denoise": time.perf_counter() - denoising}
    return replace(picture, combined=clean), seconds


def clean_layers(scene: bpy.types.Scene, picture: Picture) -> Picture:
    """Return a picture whose diffuse and glossy light is denoised, too, for who composites them.

    Raises
    ------
    SSGIError
        If the denoiser fails.
    """
    gbuffer, light = picture.frame.gbuffer, picture.light
    white = np.ones_like(gbuffer.albedo)
    layers = {
        name: denoise_picture(scene, getattr(light, name), white, gbuffer.normal)
        for name in ("diffuse", "glossy")
    }
    return replace(picture, light=replace(light, **layers))


def denoise_picture(
    scene: bpy.types.Scene,
    picture: FloatArray,
    albedo: FloatArray,
    normal: FloatArray,
    *,
    denoiser: str = "fast",
) -> FloatArray:
    """Remove the noise of a picture, guided by the surfaces that it shows.

    Parameters
    ----------
    scene
        Whose choice of denoiser and of device counts; exactly as before afterwards.
    picture : (H, W, 3)
        Scene-linear radiance.
    albedo : (H, W, 3)
        Share of the light that surfaces reflect, diffuse and glossy together; it may be noisy.
    normal : (H, W, 3)
        Unit length, in any space; zero on background; it may be noisy.
    denoiser
        ``"fast"`` or ``"accurate"``.

    Returns
    -------
    (H, W, 3) float32
        Finite and not negative.

    Raises
    ------
    SSGIError
        If the denoiser fails, or there is no room for its files.
    ValueError
        If the shapes differ.
    """
    layers = {
        "Combined": picture,
        "Denoising Albedo": np.clip(albedo, 0.0, 1.0),
        "Denoising Normal": normal,
        # Asked for in every file, read where frames follow one another
        "Vector": np.zeros((*picture.shape[:2], 4), dtype=np.float32),
    }
    letters = {"Denoising Normal": "XYZ", "Vector": "XYZW"}
    # Refused without a number of samples; the filter does not look at it
    metadata = {f"cycles.{PREFIX}.samples": "1"}
    with scratch_folder() as folder, Restorer() as restorer:
        borrow_denoiser(restorer, scene, scene.view_layers[0], denoiser)
        restorer.change(scene.cycles, denoising_input_passes="RGB_ALBEDO_NORMAL")
        noisy, clean = folder / "noisy.exr", folder / "clean.exr"
        write_layers(noisy, layers, metadata, letters=letters, is_lasting=False)
        _denoise_file(scene, noisy, clean)
        denoised = read_layers(clean)["Combined"]
    return np.maximum(np.nan_to_num(denoised, copy=False, posinf=0.0, neginf=0.0), 0.0)


def _denoise_file(scene: bpy.types.Scene, noisy: Path, clean: Path) -> None:
    import _cycles  # exists once Cycles is enabled, and only inside Blender

    try:
        _cycles.denoise(
            bpy.context.preferences.as_pointer(),
            scene.as_pointer(),
            scene.view_layers[0].as_pointer(),
            input=[str(noisy)],
            output=[str(clean)],
        )
    except Exception as error:  # the module raises several kinds
        reason = str(error).strip() or type(error).__name__
        raise SSGIError(
            f"Cycles could not denoise the picture: {reason}; choose another denoiser than 'together'."
        ) from error
