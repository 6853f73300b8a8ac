# SPDX-License-Identifier: GPL-3.0-or-later
"""What belongs to a shot and not to one of its frames: captured once, read by all.

A folder with the captures of a few key frames: their fills, and their views beyond the frame. Files are named
by what they hold, so a view that two key frames share is kept once; ``shot.json`` names them all and is
written last.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .core import Camera, Fill, GBuffer
from .errors import SSGIError
from .files import discard, read_json, write_json
from .recipe import Recipe, named_differences
from .surface_files import CAPTURE, Beside, read_fill, read_view, write_fill, write_view

View = tuple[GBuffer, Camera]

FILE = "shot.json"
FORMAT, VERSION = "ssgi-shot", 1


@dataclass(frozen=True, eq=False)
class KeyFrame:
    """What was captured at one frame of a shot.

    Attributes
    ----------
    frame
        Its number.
    world
        Hash of the world's state there; the captures serve frames of the same state.
    fill
        As it was captured; None where none was.
    views, view_names
        As in `CapturedFrame`.
    lost
        Share of rays that the frame lost with these views.
    """

    frame: int
    world: bytes
    fill: Fill | None = None
    views: tuple[View, ...] = ()
    view_names: tuple[str, ...] = ()
    lost: float = 0.0


@dataclass(frozen=True)
class Tuned:
    """What the shot's captures decide for all of its frames.

    Attributes
    ----------
    fill_share
        Of its fill that each frame renders itself.
    covered
        Share of the fill's pixels that the other key frames' fills bring enough light paths to, in the key
        frame where it is least.
    """

    fill_share: float
    covered: float


class Shot:
    """A prepared shot, as it lies in a folder; captures are read when they are asked for, and then kept.

    Parameters
    ----------
    folder
        Where `write_shot` put it.

    Attributes
    ----------
    hash
        Names the captures: two shots that share it hold the same.
    recipe
        What they were made with.
    tuned
        Settings of the frames.

    Raises
    ------
    SSGIError
        If there is none, or it is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        if not self.path.is_file():
            raise SSGIError(f"there is no prepared shot in {folder}: prepare it first (ssgi prepare)")
        data = read_json(self.path)
        is_ours = isinstance(data, dict) and data.get("format") == FORMAT
        if not is_ours or data.get("version") != VERSION:
            raise SSGIError(
                f"{self.path} is no prepared shot of this version: prepare it again (--overwrite)"
            )
        try:
            self.hash: str = data["hash"]
            self.recipe: dict[str, Any] = data["recipe"]
            self.tuned = Tuned(**data["tuned"])
            self._keys = {int(key["frame"]): key for key in data["keys"]}
            self.worlds = {frame: bytes.fromhex(key["world"]) for frame, key in self._keys.items()}
        except (KeyError, TypeError, ValueError) as error:
            raise SSGIError(f"{self.path} is damaged ({error}): prepare it again (--overwrite)") from error
        self._read: dict[int, KeyFrame] = {}
        self._views: dict[str, View] = {}

    def refuse_others(self, recipe: Recipe) -> None:
        """Raise an `SSGIError` where the shot was prepared for frames of another recipe."""
        if self.recipe != dict(recipe):
            raise SSGIError(
                f"{self.path.parent} was prepared with {named_differences(self.recipe, recipe)}: give the "
                "same settings, or prepare it again (--overwrite)"
            )

    def key(self, frame: int) -> KeyFrame:
        """Return a key frame with its captures.

        Raises
        ------
        SSGIError
            If a file is missing or damaged, or is of another shot.
        """
        if frame not in self._read:
            self._read[frame] = self._read_key(self._keys[frame])
        return self._read[frame]

    def _read_key(self, data: Mapping[str, Any]) -> KeyFrame:
        beside = Beside(self.path.parent, None)
        try:
            for view in data["views"]:
                if view["passes"] not in self._views:
                    self._views[view["passes"]] = read_view(view, beside)
            return KeyFrame(
                frame=data["frame"],
                world=bytes.fromhex(data["world"]),
                fill=read_fill(data["fill"], beside),
                views=tuple(self._views[view["passes"]] for view in data["views"]),
                view_names=tuple(view["name"] for view in data["views"]),
                lost=float(data["lost"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise SSGIError(f"{self.path} is damaged ({error}): prepare it again (--overwrite)") from error


def write_shot(
    folder: Path, keys: list[KeyFrame], tuned: Tuned, recipe: Recipe, told: Mapping[str, Any]
) -> None:
    """Write the captures of a shot's key frames; those of an earlier one go once the new ones are named.

    Parameters
    ----------
    folder
        Where; made if need be.
    keys, tuned
        What was captured, and what it decides.
    recipe
        Of the frames that may read it.
    told
        Goes into ``shot.json`` as it is: seconds and the like.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    entries = [_write_key(folder, key) for key in keys]
    tuned_data = asdict(tuned)
    names = json.dumps([entries, tuned_data, dict(recipe)], sort_keys=True)
    data = {
        "format": FORMAT,
        "version": VERSION,
        "hash": hashlib.blake2b(names.encode(), digest_size=8).hexdigest(),
        "recipe": dict(recipe),
        "tuned": tuned_data,
        "keys": entries,
        **told,
    }
    write_json(folder / FILE, data)
    named = {item["passes"] for key in entries for item in (key["fill"], *key["views"]) if item}
    for kind in ("fill", "view"):
        for path in folder.glob(f"{kind}_*.exr"):
            if path.name not in named:
                discard(path)


def _write_key(folder: Path, key: KeyFrame) -> dict[str, Any]:
    views = []
    for name, view in zip(key.view_names, key.views, strict=True):
        content = _content(*(getattr(view[0], plane) for plane in ("depth", "normal", "direct")))
        views.append(write_view(view, name, folder / f"view_{content}.exr", {CAPTURE: content}))
    fill = None
    if key.fill is not None:
        content = _content(key.fill.depth, key.fill.diffuse, key.fill.glossy)
        fill = write_fill(key.fill, folder / f"fill_{content}.exr", {CAPTURE: content})
    return {
        "frame": key.frame, "world": key.world.hex(), "fill": fill, "views": views, "lost": key.lost
    }  # fmt: skip


def _content(*arrays: Any) -> str:
    """Return a name for what arrays hold."""
    digest = hashlib.blake2b(digest_size=8)
    for array in arrays:
        digest.update(array.tobytes())
    return digest.hexdigest()
