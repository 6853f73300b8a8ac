# SPDX-License-Identifier: GPL-3.0-or-later
"""What single settings do: pictures side by side, in which nothing but that setting differs.

Of the room of `array_room`; needs no Blender. Run from the repository's root with the extra ``docs``; names
are like ``diffuse/rays``:

    python -m docs.pictures.settings_pairs [NAME ...]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from docs.pictures.array_room import (
    MAIN_LAMP,
    Image,
    Room,
    build_fill,
    build_room,
    build_yard,
    room_camera,
)
from docs.pictures.panels import IMAGES, difference, to_screen, write_panels
from docs.pictures.settings_list import PICTURES, Panel, Picture
from ssgi_addon.core import (
    Camera,
    DiffuseSettings,
    Fill,
    GBuffer,
    ReflectionSettings,
    Settings,
    composite,
    render_indirect,
)
from ssgi_addon.core.stations import find_lost_rays
from ssgi_addon.view_cameras import overscan_camera, square_camera, surround_cameras
from tests.core.synthetic import look_at

View = tuple[GBuffer, Camera]
# What is brighter than this share of a picture's pixels may be white.
_BRIGHTEST = 97.0
_SKY = (0.30, 0.42, 0.65)
_VIEW_SIZE = 128
_STATIONS = 8
_PATHS = 64  # in place of a denoiser


class Stage:
    """The room as the camera sees it, and what may be captured of it; each is made once, when asked for."""

    @cached_property
    def room(self) -> Room:
        return build_room()

    @cached_property
    def camera(self) -> Camera:
        return room_camera()

    @cached_property
    def frame(self) -> GBuffer:
        return self.room.frame(self.camera)

    @cached_property
    def yard(self) -> GBuffer:
        frame = build_yard().frame(self.camera)
        return replace(frame, direct=np.where(frame.is_background[..., None], _SKY, frame.direct))

    @cached_property
    def fill(self) -> Fill:
        return build_fill(self.room, self.camera, _PATHS)

    def views(self, *kinds: str) -> list[View]:
        """Return what views of some kinds see."""
        return [view for kind in kinds for view in self._views_of(kind)]

    @cache  # noqa: B019
    def _views_of(self, kind: str) -> Sequence[View]:
        return [(self.room.frame(camera), camera) for camera in self._cameras[kind]]

    @cached_property
    def _cameras(self) -> Mapping[str, Sequence[Camera]]:
        nearest = float(self.frame.depth.min())
        surround = surround_cameras(self.camera, nearest, 0.1, _VIEW_SIZE)
        seen = [(self.room.frame(camera), camera) for camera in surround]
        lost = find_lost_rays(self.frame, self.camera, seen, Settings())
        return {
            "surround": surround,
            "overscan": [overscan_camera(self.camera, 1.5)],
            "stations": [square_camera(pose, _VIEW_SIZE) for pose in lost.stations(_STATIONS)],
            "lamp": [square_camera(look_at(MAIN_LAMP, (0.3, 0.0, -2.2)), _VIEW_SIZE)],
        }


def draw(name: str, stage: Stage) -> None:
    """Write one picture; its panels have one exposure."""
    picture = PICTURES[name]
    images = [_image(picture, panel, stage) for panel in picture.panels]
    exposure = 0.0
    if images[0].ndim == 3:
        brightest = max(float(np.percentile(image, _BRIGHTEST)) for image in images)
        exposure = -math.log2(max(brightest, 1e-3))
    titles = [panel.title for panel in picture.panels]
    shown = [to_screen(image, exposure) for image in images]
    if picture.gain:
        titles.append(f"difference x {picture.gain}")
        shown.append(difference(*shown, picture.gain))
    write_panels(IMAGES / f"{name}.webp", list(zip(titles, shown, strict=True)))


def _image(picture: Picture, panel: Panel, stage: Stage) -> Image:
    """Return what a panel shows, scene-linear light, or the visibility."""
    frame = stage.yard if picture.outdoors else stage.frame
    if panel.layers:
        wanted = {"back_faces": False, "behind": False, **panel.layers}
        frame = stage.room.with_layers(stage.camera, **wanted)
    light = render_indirect(
        frame,
        stage.camera,
        _settings(panel.settings),
        picture.environment() if picture.environment else None,
        stage.views(*panel.kinds),
        fill=stage.fill if panel.with_fill else None,
    )
    return composite(frame, light) if picture.shows == "picture" else getattr(light, picture.shows)


def _settings(changes: Mapping[str, Any]) -> Settings:
    """Return the default settings with changes by dotted names."""
    parts: dict[str, dict[str, Any]] = {"diffuse": {}, "reflections": {}, "": {}}
    for name, value in changes.items():
        group, _, own = name.rpartition(".")
        parts[group][own] = value
    return Settings(
        diffuse=replace(DiffuseSettings(), **parts["diffuse"]),
        reflections=replace(ReflectionSettings(), **parts["reflections"]),
        **parts[""],
    )


def main(names: Sequence[str] = ()) -> None:
    """Draw all pictures, or those that are named."""
    stage = Stage()
    for name in names or PICTURES:
        draw(name, stage)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if there is none")
    main(parser.parse_args().names)
