# SPDX-License-Identifier: GPL-3.0-or-later
"""The work of captures, in samples of direct light: what budgets are counted in.

Never seconds: what a frame shows must not depend on how fast, or how busy, the machine is that renders it.
How well work foretells time is measured in ADR 24.
"""

from __future__ import annotations

from typing import Any

from .capture_options import CaptureOptions
from .fill import BLOCK

# What a render takes before its first sample, where Cycles' scene is there already.
RENDER_START = 4096.0
# What a quick pass of rays takes, that tells which views are needed and what they brought.
QUICK_PASS = 16.0 * RENDER_START
# A path with all its bounces takes about the time of so many samples of direct light.
_PATH_SAMPLES = 2.0
_SURROUND_VIEWS = 6


def render_work(pixels: int, samples: int) -> float:
    """Return the work of a render of so many pixels, with so many samples of direct light each."""
    return RENDER_START + pixels * samples


def fill_work(pixels: int, samples: int) -> float:
    """Return the work of a fill of so many samples in a frame of so many pixels."""
    return RENDER_START + _PATH_SAMPLES * samples * pixels / BLOCK**2


def cost_shares(options: Any, pixels: int, view_samples: int) -> dict[str, float]:
    """Return the work of each capture, as a share of that of the direct light's render.

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
    kinds = {
        "surround": _SURROUND_VIEWS * [options.surround**2] if options.surround else [],
        "overscan": [pixels] if options.overscan > 1.0 else [],
        "stations": options.stations * [CaptureOptions.view_size**2],
        "light_views": options.light_views * [CaptureOptions.view_size**2],
    }
    costs = {
        name: QUICK_PASS + sum(render_work(view, view_samples) for view in views)
        for name, views in kinds.items()
        if views
    }
    if options.fill:
        costs["fill"] = fill_work(pixels, options.fill)
    around = [view for views in kinds.values() for view in views]
    once = QUICK_PASS + sum(render_work(view, 1) for view in (pixels, *around))
    if options.back_faces:
        costs["back_faces"] = once
    if options.behind:
        lit = render_work(pixels, options.samples) + sum(render_work(view, view_samples) for view in around)
        # A layer behind takes the round of the back faces, too
        costs["behind"] = lit + (0.0 if options.back_faces else once)
    return {name: cost / render_work(pixels, options.samples) for name, cost in costs.items()}
