# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera as JSON, and what a file may say of one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .core import Camera
from .core.camera import LARGEST_SIDE
from .errors import SSGIError

PROJECTIONS = ("perspective", "orthographic")
# Beyond these no pixel of a float32 picture is where the camera says: places and distances in pixels or scene
# units, and how far the axes may be from unit length and right angles.
_LARGEST, _SMALLEST_FOCUS = 1e12, 1e-6
_LARGEST_SHEAR = 1e-3


def camera_to_json(camera: Camera) -> dict[str, Any]:
    """Return what `camera_from_json` reads."""
    return {
        "projection": PROJECTIONS[camera.is_orthographic],
        "width": camera.width,
        "height": camera.height,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "world_from_view": camera.world_from_view.tolist(),
    }


def camera_from_json(data: Any, path: Path) -> Camera:
    """Read a camera.

    Parameters
    ----------
    data
        As of `camera_to_json`.
    path
        Names the file in messages.

    Raises
    ------
    SSGIError
        If something is missing, or is not what a camera can have.
    """
    try:
        if not isinstance(data, Mapping):
            raise ValueError(f"expected names and values, got {data!r}")
        if data["projection"] not in PROJECTIONS:
            raise ValueError(f"projection: expected {' or '.join(PROJECTIONS)}, got {data['projection']!r}")
        return Camera(
            is_orthographic=data["projection"] == PROJECTIONS[1],
            world_from_view=_pose(data["world_from_view"]),
            **{name: int(_number(data, name, 1, LARGEST_SIDE, whole=True)) for name in ("width", "height")},
            **{name: _number(data, name, _SMALLEST_FOCUS, _LARGEST) for name in ("fx", "fy")},
            **{name: _number(data, name, -_LARGEST, _LARGEST) for name in ("cx", "cy")},
        )
    except KeyError as error:
        raise SSGIError(f"the camera of {path} lacks {error}: add it to the file") from error
    except ValueError as error:
        raise SSGIError(f"the camera of {path} is wrong: {error}") from error


def _number(
    data: Mapping[str, Any], name: str, lowest: float, highest: float, *, whole: bool = False
) -> float:
    value = data[name]
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and lowest <= value <= highest
    if not is_number or (whole and value != math.floor(value)):
        kind = "a whole number" if whole else "a number"
        raise ValueError(f"{name}: expected {kind} from {lowest:g} to {highest:g}, got {value!r}")
    return float(value)


def _pose(rows: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a rotation and a place as a (4, 4) matrix."""
    expected = "world_from_view: expected a 4 x 4 matrix of a rotation and a place, without scale"
    try:
        pose = np.array(rows, dtype=np.float64)
    except (OverflowError, TypeError, ValueError) as error:
        raise ValueError(f"{expected}; {error}") from error
    if pose.shape != (4, 4) or not (np.abs(pose) <= _LARGEST).all():  # False for NaN
        raise ValueError(expected)
    axes = pose[:3, :3]
    if not np.abs(axes.T @ axes - np.eye(3)).max() <= _LARGEST_SHEAR or (pose[3] != (0, 0, 0, 1)).any():
        raise ValueError(expected)
    return pose
