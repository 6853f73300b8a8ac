# SPDX-License-Identifier: GPL-3.0-or-later
"""What is captured beyond the frame costs, in samples of direct light."""

from __future__ import annotations

from typing import Any

from .capture_options import CaptureOptions
from .fill import BLOCK

# A path with all its bounces takes about the time of so many samples of direct light.
_PATH_SAMPLES = 2.0
_SURROUND_VIEWS = 6


def fill_samples(pixels: int, samples: int) -> float:
    """Return what a fill of so many samples costs in a frame of so many pixels."""
    return _PATH_SAMPLES * samples * pixels / BLOCK**2


def cost_shares(options: Any, pixels: int, view_samples: int) -> dict[str, float]:
    """Estimate what each capture costs, as a share of the direct light's render.

    Samples alone are counted, not the start of each render: small pictures cost more.

    Parameters
    ----------
    options
        Has the switches of `JobOptions` as attributes.
    pixels
        Of the frame.
    view_samples
        Per pixel, of the light in views beyond the frame.

    Returns
    -------
    dict
        Keyed by the switches' names; what is off is left out.
    """
    view_pixels = {
        "surround": _SURROUND_VIEWS * options.surround**2,
        "overscan": pixels if options.overscan > 1.0 else 0,
        "stations": options.stations * CaptureOptions.view_size**2,
        "light_views": options.light_views * CaptureOptions.view_size**2,
    }
    costs = {name: float(view_samples * count) for name, count in view_pixels.items()}
    costs["fill"] = fill_samples(pixels, options.fill)
    once = float(pixels + sum(view_pixels.values()))
    costs["back_faces"] = once if options.back_faces else 0.0
    if options.behind:
        lit = pixels * options.samples + view_samples * sum(view_pixels.values())
        # A layer behind takes the round of the back faces, too
        costs["behind"] = lit + (0.0 if options.back_faces else once)
    return {name: cost / (pixels * options.samples) for name, cost in costs.items() if cost > 0.0}
