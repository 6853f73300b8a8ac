# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs of tests that are not about the light: few pixels, one sample, nothing beyond the frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ssgi_addon.core import Settings
from ssgi_addon.job_options import JobOptions

SIZE = (48, 27)


def small_job(output: Path, **changes: Any) -> JobOptions:
    """Return the options of such a job into a folder, with changes."""
    small: dict[str, Any] = {
        "settings": Settings.preset("draft"),
        "resolution": SIZE,
        "samples": 1,
        "denoiser": "none",
        "fill": 0,
        "surround": 0,
        "stations": 0,
        "reference_samples": 1,
    }
    return JobOptions(output, **{**small, **changes})
