# SPDX-License-Identifier: GPL-3.0-or-later
"""Captured frames and the files that keep them: one EXR per G-buffer, one JSON file for the rest.

What `write_passes` writes, `read_passes` reads back bit by bit, so the passes can be computed again
later and elsewhere. `read_passes` also takes the multilayer EXR files that Blender itself writes.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .blender_passes import frame_from_blender
from .camera_file import camera_from_json, camera_to_json
from .core import Camera, Environment, Fill, GBuffer, Settings
from .errors import SSGIError
from .exr import FloatArray, Pixels, read_layers, write_layers
from .exr_header import read_headers
from .files import discard, read_json, write_json
from .frame import CapturedFrame

FORMAT = "ssgi-passes"
FORMAT_VERSION = 1
# Of the EXR files: which capture they belong to, as the JSON file says it
CAPTURE = "ssgi.capture"
UNIT_ROUNDING = 1e-6

Stored = TypeVar("Stored", GBuffer, Fill)

_PLANES = tuple(item.name for item in fields(GBuffer) if item.name != "behind")
_FILL_PLANES = tuple(item.name for item in fields(Fill) if item.name not in ("camera", "is_denoised"))
_REQUIRED = ("depth", "normal", "albedo", "specular", "roughness", "direct")


def write_passes(
    frame: CapturedFrame, folder: Path | str, stem: str, settings: Settings | None = None
) -> Path:
    """Write a captured frame as ``<stem>.exr`` and ``<stem>.json``, and a file per further view.

    The JSON file names the others and is written last: while it is missing, the frame is not complete. An
    older one goes first, since it would name files of two captures.

    Parameters
    ----------
    frame
        The captured frame.
    folder, stem
        Where, and the name without its ending.
    settings
        What the picture was computed with, for `remembered_settings`.

    Returns
    -------
    Path
        The EXR file that `read_passes` takes.

    Raises
    ------
    SSGIError
        If a file cannot be written.
    """
    folder = Path(folder)
    path = folder / f"{stem}.exr"
    discard(path.with_suffix(".json"))
    remembered = None if settings is None else settings_to_json(settings)
    capture = _capture_id(frame, remembered)
    mark = {CAPTURE: capture}
    write_layers(path, {**_planes(frame.gbuffer), **frame.layers}, mark)
    views = []
    for number, (gbuffer, camera) in enumerate(frame.views, 1):
        name = f"{stem}_view{number}.exr"
        write_layers(folder / name, _planes(gbuffer), mark)
        kind = frame.view_names[number - 1] if frame.view_names else "view"
        views.append({"passes": name, "name": kind, "camera": camera_to_json(camera)})
    data = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "capture": capture,
        "engine": frame.engine,
        "emission_in_direct": frame.emission_in_direct,
        "world_in_direct": frame.world_in_direct,
        "settings": remembered,
        "camera": camera_to_json(frame.camera),
        "environment": _write_environment(frame.environment, folder / f"{stem}_environment.exr", mark),
        "views": views,
        "fill": _write_fill(frame.fill, folder / f"{stem}_fill.exr", mark),
        "layers": list(frame.layers),
        "seconds": dict(frame.seconds),
        "gains": dict(frame.gains),
        "skipped": [list(pair) for pair in frame.skipped],
        "notes": list(frame.notes),
    }
    write_json(path.with_suffix(".json"), data)
    return path


def read_passes(path: Path | str, camera_path: Path | str | None = None) -> CapturedFrame:
    """Read a captured frame from our own files, or from an EXR file that Blender wrote.

    Parameters
    ----------
    path
        The EXR file. A ``.json`` of the same name beside it is found without being named.
    camera_path
        JSON file with the camera. Without it, and without our own file, the camera is solved from the
        passes Position and Depth.

    Raises
    ------
    SSGIError
        If a file is missing or damaged, or the EXR lacks passes; the text names each of them.
    """
    path = Path(path)
    layers = read_layers(path)
    named = None if camera_path is None else _read_mapping(Path(camera_path))
    beside = path.with_suffix(".json")
    own = next((data for data in (_read_own(beside), named) if data and data.get("format") == FORMAT), None)
    camera = None if named is None else camera_from_json(named.get("camera", named), Path(str(camera_path)))
    if own is not None:
        return _own_frame(path, layers, own, camera)
    if set(_REQUIRED) <= layers.keys():
        raise SSGIError(f"{path} needs {beside.name}, which was written with it: put it into the same folder")
    return frame_from_blender(path, layers, camera)


def remembered_settings(path: Path | str) -> Settings | None:
    """Return the settings that `write_passes` kept beside the EXR file `path`; None where there are none.

    Raises
    ------
    SSGIError
        If the JSON file cannot be read or holds settings that this version does not know.
    """
    beside = Path(path).with_suffix(".json")
    data = _read_own(beside)
    if not data or data.get("format") != FORMAT or data.get("settings") is None:
        return None
    try:
        return settings_from_json(data["settings"])
    except (OverflowError, TypeError, ValueError) as error:
        raise SSGIError(
            f"the settings in {beside} are wrong ({error}): name them on the command line"
        ) from error


def settings_to_json(settings: Any) -> dict[str, Any]:
    """Settings as nested dictionaries; infinity, which JSON lacks, as text."""
    values: dict[str, Any] = {}
    for item in fields(settings):
        value = getattr(settings, item.name)
        if is_dataclass(value):
            value = settings_to_json(value)
        elif isinstance(value, float) and not math.isfinite(value):
            value = str(value)
        values[item.name] = value
    return values


def settings_from_json(values: Mapping[str, Any], base: Any = None) -> Any:
    """Undo `settings_to_json`.

    Raises
    ------
    TypeError, ValueError
        If a name or a value is not one of `Settings`.
    """
    base = Settings() if base is None else base
    if not isinstance(values, Mapping):
        raise TypeError(f"expected names and values, got {values!r}")
    changes = {}
    for name, value in values.items():
        default = getattr(base, name, None)
        if is_dataclass(default):
            value = settings_from_json(value, default)
        elif isinstance(default, float):
            value = float(value)
        changes[name] = value
    return replace(base, **changes)


def _own_frame(path: Path, layers: Pixels, data: Mapping[str, Any], camera: Camera | None) -> CapturedFrame:
    if data.get("version") != FORMAT_VERSION:
        raise SSGIError(
            f"{path.with_suffix('.json')} has version {data.get('version')!r} of its format, "
            f"this program reads {FORMAT_VERSION}: render the passes again"
        )
    beside = _Beside(path.parent, data.get("capture"))
    beside.check(path)
    try:
        return CapturedFrame(
            gbuffer=_gbuffer(layers, path),
            camera=camera or camera_from_json(data["camera"], path),
            environment=_read_environment(data["environment"], beside),
            engine=data["engine"],
            emission_in_direct=data["emission_in_direct"],
            world_in_direct=data["world_in_direct"],
            views=tuple(_read_view(view, beside) for view in data["views"]),
            view_names=tuple(view.get("name", "view") for view in data["views"]),
            layers={name: layers[name] for name in data["layers"]},
            seconds=data["seconds"],
            gains=data.get("gains", {}),
            skipped=tuple((what, why) for what, why in data.get("skipped", ())),
            notes=tuple(data["notes"]),
            fill=_read_fill(data.get("fill"), beside),
        )
    except KeyError as error:
        raise SSGIError(f"{path} and its .json do not belong together: {error} is missing") from error
    except (TypeError, ValueError) as error:
        raise SSGIError(f"{path.with_suffix('.json')} is damaged: {error}") from error


def _capture_id(frame: CapturedFrame, settings: Mapping[str, Any] | None) -> str:
    """Return what tells a capture from others: its wall times alone differ from run to run."""
    told = json.dumps([camera_to_json(frame.camera), dict(frame.seconds), settings])
    return hashlib.blake2b(told.encode(), digest_size=12).hexdigest()


@dataclass(frozen=True)
class _Beside:
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


def _planes(gbuffer: GBuffer, prefix: str = "") -> dict[str, FloatArray]:
    """Arrays of a G-buffer by layer name; those of the layers behind begin with ``behind_``."""
    planes = {prefix + name: getattr(gbuffer, name) for name in _PLANES if getattr(gbuffer, name) is not None}
    if gbuffer.behind is not None:
        planes.update(_planes(gbuffer.behind, f"{prefix}behind_"))
    return planes


def _gbuffer(layers: Pixels, path: Path, prefix: str = "") -> GBuffer:
    missing = [prefix + name for name in _REQUIRED if prefix + name not in layers]
    if missing:
        raise SSGIError(f"{path} lacks the passes {', '.join(missing)}: render it again")
    planes: dict[str, Any] = {name: layers[prefix + name] for name in _PLANES if prefix + name in layers}
    if f"{prefix}behind_depth" in layers:
        planes["behind"] = _gbuffer(layers, path, f"{prefix}behind_")
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


def _read_view(view: Mapping[str, Any], beside: _Beside) -> tuple[GBuffer, Camera]:
    path, layers = beside.read(view["passes"])
    return _gbuffer(layers, path), camera_from_json(view["camera"], path)


def _write_fill(fill: Fill | None, path: Path, mark: Mapping[str, str]) -> dict[str, Any] | None:
    if fill is None:
        return None
    write_layers(path, {plane: np.asarray(getattr(fill, plane)) for plane in _FILL_PLANES}, mark)
    return {"passes": path.name, "camera": camera_to_json(fill.camera), "is_denoised": fill.is_denoised}


def _read_fill(data: Mapping[str, Any] | None, beside: _Beside) -> Fill | None:
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


def _write_environment(
    environment: Environment | None, path: Path, mark: Mapping[str, str]
) -> dict[str, Any] | None:
    if environment is None:
        return None
    write_layers(path, {"radiance": environment.image}, mark)
    return {"image": path.name, "world_from_view": environment.world_from_view.tolist()}


def _read_environment(data: Mapping[str, Any] | None, beside: _Beside) -> Environment | None:
    if data is None:
        return None
    _, layers = beside.read(data["image"])
    return Environment.equirectangular(
        layers["radiance"], np.array(data["world_from_view"], dtype=np.float64)
    )


def _read_own(path: Path) -> Mapping[str, Any] | None:
    return _read_mapping(path) if path.is_file() else None


def _read_mapping(path: Path) -> Mapping[str, Any]:
    data = read_json(path)
    if not isinstance(data, dict):
        raise SSGIError(f"{path} holds no camera: expected a JSON object")
    return data
