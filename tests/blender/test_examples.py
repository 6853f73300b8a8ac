# SPDX-License-Identifier: GPL-3.0-or-later
"""The examples that render with Blender do what they say, run as their users run them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.exr import read_layers

ROOT = Path(__file__).resolve().parents[2]


def test_turntable_shows_a_model_from_all_sides(tmp_path):
    script = str(ROOT / "examples" / "turntable.py")
    options = ["--frames", "3", "--resolution", "64", "36", "--preset", "draft", "--output", "table"]
    for further in ([], ["--overwrite"], []):
        done = subprocess.run(
            [sys.executable, script, *options, *further],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
    frames = [read_layers(tmp_path / "table" / f"turntable_{number:04d}.exr") for number in (1, 2, 3)]
    for number, layers in enumerate(frames, 1):
        assert (tmp_path / "table" / f"turntable_{number:04d}.png").stat().st_size > 500
        assert all(np.isfinite(values).all() for values in layers.values())
        assert layers["combined"].mean() > 1.02 * layers["direct"].mean() > 0.0
    # Each side has another rim behind the model.
    assert np.abs(frames[0]["albedo"] - frames[1]["albedo"]).mean() > 0.05
    report = json.loads((tmp_path / "table" / "report.json").read_text())
    assert [frame["frame"] for frame in report["frames"]] == [1, 2, 3]
