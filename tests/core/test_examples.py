# SPDX-License-Identifier: GPL-3.0-or-later
"""The examples that need no Blender do what they say, run as their users run them."""

from __future__ import annotations

import os
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("OpenEXR")

from ssgi_addon.exr import read_layers, write_layers
from ssgi_addon.png import SIGNATURE
from tests.core.rendered_passes import GREY, write_rendered_passes

ROOT = Path(__file__).resolve().parents[2]


def start_example(name, folder, *arguments):
    return subprocess.run(
        [sys.executable, "-W", "error", str(ROOT / "examples" / name), *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


def run_example(name, folder, *arguments):
    done = start_example(name, folder, *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def read_png(path):
    """The pixels of a PNG as `write_png` writes it: one IDAT of RGB bytes, rows filtered by those above."""
    data = path.read_bytes()
    assert data.startswith(SIGNATURE)
    width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    begin = data.index(b"IDAT")
    length = int.from_bytes(data[begin - 4 : begin], "big")
    rows = np.frombuffer(zlib.decompress(data[begin + 4 : begin + 4 + length]), np.uint8)
    rows = rows.reshape(height, 1 + 3 * width)[:, 1:]
    return np.cumsum(rows, axis=0, dtype=np.uint8).reshape(height, width, 3)


def test_arrays_show_the_room_with_more_light_than_the_lamp_brings(tmp_path):
    printed = run_example("arrays.py", tmp_path)
    assert "of the rays found an answer" in printed
    direct, lit, visibility = np.split(read_png(tmp_path / "arrays.png").astype(float), 3, axis=1)
    assert (lit >= direct).all()
    assert lit.mean() > 1.1 * direct.mean()
    # The lamp shines downward: what the ceiling has comes from walls and floor.
    height, width = visibility.shape[:2]
    ceiling = np.s_[: height // 20, width // 3 : -width // 3]
    assert lit[ceiling].mean() > direct[ceiling].mean() + 20
    assert np.ptp(visibility, axis=-1).max() == 0  # grey
    assert 50 < visibility.mean() < 250


@pytest.fixture
def render(tmp_path):
    write_rendered_passes(tmp_path / "render.exr")
    return tmp_path / "render.exr"


def test_relighting_with_nothing_changed_keeps_the_picture(tmp_path, render):
    run_example("relight.py", tmp_path, render, "--output", "relit.exr", "--rays", "4")
    before, after = np.split(read_png(tmp_path / "relit.png"), 2, axis=1)
    np.testing.assert_array_equal(before, after)


def test_painted_floor_colours_the_wall(tmp_path, render):
    blue = (0.1, 0.1, 0.8)
    on_the_floor = "32,35"
    change = f"{on_the_floor}={','.join(map(str, blue))}"
    run_example("relight.py", tmp_path, render, "--rays", "4", "--paint", change, "--light", "2")
    layers = read_layers(tmp_path / "relit.exr")
    is_floor = layers["direct"].sum(axis=-1) > 0.0
    assert (layers["direct"][is_floor] == 2.0 * np.float32(blue)).all()
    wall = layers["combined"][~is_floor]
    assert np.isfinite(wall).all()
    assert wall[:, 2].mean() > 2.0 * wall[:, 0].mean()
    before, after = np.split(read_png(tmp_path / "relit.png").astype(int), 2, axis=1)
    assert before[~is_floor][:, 0].mean() > before[~is_floor][:, 2].mean()
    assert after[~is_floor][:, 2].mean() > after[~is_floor][:, 0].mean()


def test_sky_reaches_what_sees_it(tmp_path, render):
    options = (tmp_path, render, "--rays", "4", "--light", "0", "--output")
    assert "dark.png" in run_example("relight.py", *options, "dark.exr")
    run_example("relight.py", *options, "sky.exr", "--sky", "0.5,0.5,0.5")
    assert read_layers(tmp_path / "dark.exr")["combined"].max() == 0.0
    wall = read_layers(tmp_path / "sky.exr")["combined"][0]
    assert (wall > 0.0).all()
    assert (wall < np.float32(GREY)).all()


def test_missing_passes_are_named(tmp_path):
    write_layers(tmp_path / "render.exr", {"Depth": np.ones((4, 6), np.float32)})
    done = start_example("relight.py", tmp_path, "render.exr")
    assert done.returncode == 1
    assert done.stderr.startswith("relight: ")
    assert "Diffuse Direct" in done.stderr
