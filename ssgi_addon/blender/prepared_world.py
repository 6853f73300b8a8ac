# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame's share in what was captured for its shot."""

from __future__ import annotations

import bpy

from ..core import Fill
from ..prepared import KeyFrame, Shot
from .kept_world import KeptWorld, View, world_state


class PreparedWorld(KeptWorld):
    """What a prepared shot keeps for each of its frames, in place of what earlier frames of a job left.

    A frame reads the captures of the key frames at which the world was as it is now: all their fills, and the
    views of the nearest one. So what it gets depends on its number alone.

    Parameters
    ----------
    shot
        Prepared for this scene.
    """

    def __init__(self, shot: Shot) -> None:
        super().__init__()
        self._shot = shot
        self._keys: list[KeyFrame] = []

    def look_at(self, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
        """Find the key frames of the world's state; where there is none, the frame is on its own."""
        self._forget()
        state, number = world_state(scene, view_layer), scene.frame_current
        frames = [frame for frame, world in self._shot.worlds.items() if world == state]
        self.note, self.fill_share = "", self._shot.tuned.fill_share
        if not frames:
            self._keys, self.fill_share = [], 1.0
            self.note = (
                "At this frame the world is another than at all key frames of the shot: the frame is "
                "rendered alone."
            )
            return
        self._keys = [self._shot.key(frame) for frame in sorted(frames)]
        nearest = min(self._keys, key=lambda key: (abs(key.frame - number), key.frame))
        super().keep(nearest.views, nearest.view_names, nearest.lost, nearest.frame)

    def keep(self, views: tuple[View, ...], view_names: tuple[str, ...], lost: float, frame: int) -> None:
        """Keep nothing: the next frame must not depend on this one."""

    def averaged(self, fill: Fill) -> Fill:
        """Return the mean of a frame's fill and of those of the key frames, in the frame's view."""
        return Fill.merged([*self._fills_like(fill), fill])

    def _fills_like(self, fill: Fill) -> list[Fill]:
        """Return the fills of the key frames; of a Blender with a denoiser where the frame's is denoised."""
        fills = [key.fill for key in self._keys if key.fill is not None]
        return [other for other in fills if other.is_denoised == fill.is_denoised]
