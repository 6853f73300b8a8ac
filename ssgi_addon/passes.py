# SPDX-License-Identifier: GPL-3.0-or-later
"""Captured frames and the files that keep them: one EXR per G-buffer, one JSON file for the rest.

What `write_passes` writes, `read_passes` reads back bit by bit, so the passes can be computed again
later and elsewhere. `read_passes` also takes the multilayer EXR files that Blender itself writes.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .blender_passes import frame_from_blender
from .camera_file import camera_from_json, camera_to_json
from .core import Camera, Environment, Settings
from .errors import SSGIError
from .exr import Pixels, read_layers, write_layers
from .files import discard, read_json, write_json
from .frame import CapturedFrame
from .surface_files import (
    CAPTURE,
    REQUIRED,
    Beside,
    planes_of,
    read_fill,
    read_gbuffer,
    read_view,
    write_fill,
    write_view,
)

FORMAT = "ssgi-passes"
FORMAT_VERSION = 1


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
    write_layers(path, {**planes_of(frame.gbuffer), **frame.layers}, mark)
    views = []
    for number, view in enumerate(frame.views, 1):
        kind = frame.view_names[number - 1] if frame.view_names else "view"
        views.append(write_view(view, kind, folder / f"{stem}_view{number}.exr", mark))
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
        "fill": write_fill(frame.fill, folder / f"{stem}_fill.exr", mark),
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
    if set(REQUIRED) <= layers.keys():
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
    beside = Beside(path.parent, data.get("capture"))
    beside.check(path)
    try:
        return CapturedFrame(
            gbuffer=read_gbuffer(layers, path),
            camera=camera or camera_from_json(data["camera"], path),
            environment=_read_environment(data["environment"], beside),
            engine=data["engine"],
            emission_in_direct=data["emission_in_direct"],
            world_in_direct=data["world_in_direct"],
            views=tuple(read_view(view, beside) for view in data["views"]),
            view_names=tuple(view.get("name", "view") for view in data["views"]),
            layers={name: layers[name] for name in data["layers"]},
            seconds=data["seconds"],
            gains=data.get("gains", {}),
            skipped=tuple((what, why) for what, why in data.get("skipped", ())),
            notes=tuple(data["notes"]),
            fill=read_fill(data.get("fill"), beside),
        )
    except KeyError as error:
        raise SSGIError(f"{path} and its .json do not belong together: {error} is missing") from error
    except (TypeError, ValueError) as error:
        raise SSGIError(f"{path.with_suffix('.json')} is damaged: {error}") from error


def _capture_id(frame: CapturedFrame, settings: Mapping[str, Any] | None) -> str:
    """Return what tells a capture from others: its wall times alone differ from run to run."""
    told = json.dumps([camera_to_json(frame.camera), dict(frame.seconds), settings])
    return hashlib.blake2b(told.encode(), digest_size=12).hexdigest()


def _write_environment(
    environment: Environment | None, path: Path, mark: Mapping[str, str]
) -> dict[str, Any] | None:
    if environment is None:
        return None
    write_layers(path, {"radiance": environment.image}, mark)
    return {"image": path.name, "world_from_view": environment.world_from_view.tolist()}


def _read_environment(data: Mapping[str, Any] | None, beside: Beside) -> Environment | None:
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
