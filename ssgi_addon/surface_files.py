# SPDX-License-Identifier: GPL-3.0-or-later
"""EXR files of surfaces, views and fills; a JSON file beside them names them and keeps their cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .camera_file import camera_from_json, camera_to_json
from .core import Camera, Fill, GBuffer
from .errors import SSGIError
from .exr import FloatArray, Pixels, read_layers, write_layers
from .exr_header import read_headers

# Of the EXR files: which capture they belong to, as the JSON file says it
CAPTURE = "ssgi.capture"
UNIT_ROUNDING = 1e-6

Stored = TypeVar("Stored", GBuffer, Fill)

_PLANES = tuple(item.name for item in fields(GBuffer) if item.name != "behind")
_FILL_PLANES = tuple(item.name for item in fields(Fill) if item.name not in ("camera", "is_denoised"))
REQUIRED = ("depth", "normal", "albedo", "specular", "roughness", "direct")


@dataclass(frozen=True)
class Beside:
    """The EXR files that a JSON file names: in its own folder, and of the same capture."""

    folder: Path
    capture: str | None

    def read(self, name: object) -> tuple[Path, Pixels]:
        if not isinstance(name, str) or Path(name).name != name:
            raise ValueError(f"expected the name of a file in its folder, got {name!r}")
        path = self.folder / name
        self.check(path)
        return path, read_layers(path)

    def check(self, path: Path) -> None:
        """Refuse a file that another run has replaced, or was about to."""
        # Other programs that write a file anew may leave the mark out
        found = read_headers(path)[0].texts.get(CAPTURE)
        if None not in (found, self.capture) and found != self.capture:
            raise SSGIError(f"{path} is of another capture than its .json: render the passes again")


def planes_of(gbuffer: GBuffer, prefix: str = "") -> dict[str, FloatArray]:
    """Return a G-buffer's arrays by layer name; those of the layers behind begin with ``behind_``."""
    planes = {prefix + name: getattr(gbuffer, name) for name in _PLANES if getattr(gbuffer, name) is not None}
    if gbuffer.behind is not None:
        planes.update(planes_of(gbuffer.behind, f"{prefix}behind_"))
    return planes


def read_gbuffer(layers: Pixels, path: Path, prefix: str = "") -> GBuffer:
    missing = [prefix + name for name in REQUIRED if prefix + name not in layers]
    if missing:
        raise SSGIError(f"{path} lacks the passes {', '.join(missing)}: render it again")
    planes: dict[str, Any] = {name: layers[prefix + name] for name in _PLANES if prefix + name in layers}
    if f"{prefix}behind_depth" in layers:
        planes["behind"] = read_gbuffer(layers, path, f"{prefix}behind_")
    return _as_stored(GBuffer, planes, path)


def _as_stored(kind: Callable[..., Stored], planes: dict[str, Any], path: Path) -> Stored:
    """Make a `GBuffer` or a `Fill` of what a file holds."""
    try:
        surfaces = kind(**planes)
    except ValueError as error:
        raise SSGIError(f"{path} is damaged: {error}") from error
    # Normalising a unit vector once more may change its last bit, and with it a ray's hit.
    if np.allclose(surfaces.normal, planes["normal"], rtol=0.0, atol=UNIT_ROUNDING):
        object.__setattr__(surfaces, "normal", planes["normal"])
    return surfaces


def write_view(
    view: tuple[GBuffer, Camera], name: str, path: Path, mark: Mapping[str, str]
) -> dict[str, Any]:
    """Write a view; return what `read_view` takes. `mark` is of the file's texts."""
    gbuffer, camera = view
    write_layers(path, planes_of(gbuffer), mark)
    return {"passes": path.name, "name": name, "camera": camera_to_json(camera)}


def read_view(view: Mapping[str, Any], beside: Beside) -> tuple[GBuffer, Camera]:
    path, layers = beside.read(view["passes"])
    return read_gbuffer(layers, path), camera_from_json(view["camera"], path)


def write_fill(fill: Fill | None, path: Path, mark: Mapping[str, str]) -> dict[str, Any] | None:
    if fill is None:
        return None
    write_layers(path, {plane: np.asarray(getattr(fill, plane)) for plane in _FILL_PLANES}, mark)
    return {"passes": path.name, "camera": camera_to_json(fill.camera), "is_denoised": fill.is_denoised}


def read_fill(data: Mapping[str, Any] | None, beside: Beside) -> Fill | None:
    if data is None:
        return None
    path, layers = beside.read(data["passes"])
    missing = [name for name in _FILL_PLANES if name not in layers]
    if missing:
        raise SSGIError(f"{path} lacks the passes {', '.join(missing)}: render it again")
    planes: dict[str, Any] = {name: layers[name] for name in _FILL_PLANES}
    rest = {
        "camera": camera_from_json(data["camera"], path),
        "is_denoised": bool(data.get("is_denoised", False)),
    }
    return _as_stored(Fill, {**planes, **rest}, path)
