# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of frames as runs leave them, made up: the manifests by their contract, light by formulas."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ssgi_addon.camera_file import camera_to_json
from ssgi_addon.core import Camera
from ssgi_addon.exr import write_layers
from ssgi_addon.png import write_png
from tests.core.synthetic import Plane, capture

SIZE = (48, 27)
BEGUN = datetime(2026, 11, 27, 4, 0, tzinfo=UTC)
#: What a frame takes, seconds.
STEPS = {"capture": 2.0, "light": 1.5, "passes": 1.0, "write": 0.25, "total": 3.5}
VERSIONS = {"ssgi": "1.0.0", "blender": "5.2.0", "python": "3.13.1", "numpy": "2.3.0"}

Light = Callable[[np.ndarray], np.ndarray]


def camera_at(frame: int, size: tuple[int, int] = SIZE, *, speed: float = 0.0) -> Camera:
    """A camera at (0, 0, 2) that slides to the right by `speed` units a frame."""
    pose = np.eye(4)
    pose[:3, 3] = (speed * frame, 0.0, 2.0)
    return Camera.perspective(*size, 0.9, world_from_view=pose)


def room() -> list[Plane]:
    """A floor and a back wall, without bounds."""
    return [Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), Plane((0.0, 0.0, -4.0), (0.0, 0.0, 1.0))]


def samples_of(camera: Camera, light: Light) -> dict[str, np.ndarray]:
    """What the small samples of a frame hold: `light` gives radiance (N, 3) at world-space points (N, 3)."""
    surfaces = [Plane(plane.point, plane.normal, source=light) for plane in room()]
    seen = capture(camera, surfaces)
    return {"depth": seen.depth, "normal": seen.normal, "diffuse": seen.direct}


def manifest_of(frame: int, name: str = "room", *, camera: Camera | None = None, **changes: Any) -> dict:
    """The manifest of a finished frame; `changes` replace its entries, those of ``record`` within it."""
    record = {
        "frame": frame,
        "seconds": dict(STEPS),
        "peak_memory_mb": 900.0 + frame,
        "rays": {"diffuse": 1000},
        "known": 0.9,
        "skipped": [{"what": "behind", "why": "it did not fit in the time"}],
        "notes": ["A note."],
        "metrics": None,
    }
    of_record = changes.pop("record", {})
    return {
        "format": "ssgi-frame",
        "version": 1,
        "name": name,
        "frame": frame,
        "machine": "alpha",
        "finished": (BEGUN + timedelta(seconds=5.0 * frame)).isoformat(),
        "versions": dict(VERSIONS),
        "settings_hash": "0123456789abcdef",
        "settings": {"samples": 4, "diffuse": {"rays": 4}},
        "shot": None,
        "camera": camera_to_json(camera or camera_at(frame)),
        "process": {"id": "p1", "started": BEGUN.isoformat()},
        "record": None if of_record is None else {**record, **of_record},
        "failure": None,
        **changes,
    }


def failed(frame: int, why: str = "not enough memory", **changes: Any) -> dict:
    """The manifest of a frame that failed."""
    return manifest_of(frame, record=None, failure=why, camera=None, **changes)


def write_manifest(folder: Path, manifest: dict) -> Path:
    """Write a manifest under its name."""
    path = folder / "frames" / f"{manifest['name']}_{manifest['frame']:04d}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(manifest), encoding="utf-8")
    return path


def write_frame(
    folder: Path, frame: int, light: Light | None = None, *, speed: float = 0.0, **changes: Any
) -> Path:
    """Write all small files of a finished frame; without `light` no samples."""
    camera = camera_at(frame, speed=speed)
    manifest = manifest_of(frame, camera=camera, **changes)
    stem = folder / "frames" / f"{manifest['name']}_{frame:04d}"
    if light is not None:
        write_layers(stem.with_suffix(".exr"), samples_of(camera, light))
    write_png(stem.with_suffix(".png"), picture_of(frame))
    return write_manifest(folder, manifest)


def picture_of(frame: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A picture that no other frame has."""
    width, height = size
    across, down = np.meshgrid(np.linspace(0, 255, width), np.linspace(0, 255, height))
    return np.stack([across, down, np.full_like(down, (frame * 53) % 256)], axis=-1).astype(np.uint8)


def even_light(points: np.ndarray) -> np.ndarray:
    """Light that varies smoothly over the surfaces and does not depend on the frame."""
    level = 1.0 + 0.3 * np.sin(points[:, :1]) + 0.2 * np.cos(points[:, 2:3])
    return level * np.array([1.0, 0.8, 0.5])
