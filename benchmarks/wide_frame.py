# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames with all that can be captured beyond them, captured once and kept.

Run ``python -m benchmarks.wide_frame NAME WIDTHxHEIGHT`` to capture one ahead.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from benchmarks.cycles_truth import frame_path, open_scene
from benchmarks.inputs import Size, kept_frame, parse_size
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import write_passes

# Goes up where a capture changes: frames that were kept no longer count.
_VERSION = 2


def wide_frame(name: str, size: Size) -> CapturedFrame:
    """Return a frame with all views, layers and a fill, in a process of its own where it is not kept yet.

    Parameters
    ----------
    name
        Of a real scene.
    size
        Width and height, pixels.
    """
    return kept_frame(_path(name, size), "benchmarks.wide_frame", name, f"{size[0]}x{size[1]}")


def _path(name: str, size: Size) -> Path:
    frame = frame_path(name, size)
    return frame.with_name(f"wide{_VERSION}_{frame.name}")


def _keep(name: str, size: Size) -> None:
    from ssgi_addon.blender.capture import CaptureOptions, capture_frame

    options = CaptureOptions(
        resolution=size, overscan=2.0, surround=128, stations=8, light_views=2, back_faces=True, behind=True,
        fill=16,
    )  # fmt: skip
    # The compositor's layers are half of the file, and nothing here reads them
    frame = replace(capture_frame(open_scene(name), options), layers={})
    path = _path(name, size)
    print(write_passes(frame, path.parent, path.stem))


def main() -> None:
    """Capture one frame."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("size", type=parse_size)
    arguments = parser.parse_args()
    from ssgi_addon.bpy_module import require_bpy

    require_bpy()
    _keep(arguments.name, arguments.size)


if __name__ == "__main__":
    main()
