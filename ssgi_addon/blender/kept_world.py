# SPDX-License-Identifier: GPL-3.0-or-later
"""What belongs to the world and not to the frame, kept from frame to frame as long as nothing moves."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from typing import Any

import bpy
import numpy as np
from mathutils import Color, Euler, Vector

from ..core import Camera, Fill, GBuffer
from .shader_trees import nodes_with_groups, shaded_materials, shaded_worlds

View = tuple[GBuffer, Camera]

# More fills than this bring little, and cost a reading each.
_MOST_FILLS = 16
# Kinds of objects that neither are seen nor shine.
_UNSEEN = frozenset({"CAMERA", "EMPTY", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE"})
# What a lamp's light depends on, of all kinds of lamps.
_LAMP_VALUES = (
    "type", "energy", "color", "exposure", "normalize", "temperature", "use_temperature", "shadow_soft_size",
    "angle", "shape", "size", "size_y", "spread", "spot_size", "spot_blend",
)  # fmt: skip


class KeptWorld:
    """Views and fills of earlier frames of one job.

    Where the world has not moved since they were taken, a frame averages its fill with those of the frames
    before, and goes on with their views as long as its rays are answered as well as theirs. Where anything
    but the camera has moved, or shines otherwise, all is forgotten.

    Attributes
    ----------
    views, view_names
        As in `CapturedFrame`; none where nothing is kept.
    lost
        Share of rays that the frame which took the views lost all the same.
    frame
        Its number.
    fill_share
        Of its fill's samples that a frame has to render itself.
    note
        What the user should know of it at the frame that was looked at last; empty where nothing.
    """

    def __init__(self) -> None:
        self.note, self.fill_share = "", 1.0
        self._state = b""
        self._forget()

    def _forget(self) -> None:
        self.views: tuple[View, ...] = ()
        self.view_names: tuple[str, ...] = ()
        self.lost, self.frame = 0.0, 0
        self._fills: list[Fill] = []

    def look_at(self, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
        """Forget everything if the world is another than it was at the last look."""
        state = world_state(scene, view_layer)
        if state != self._state:
            self._forget()
            self._state = state

    def keep(self, views: tuple[View, ...], view_names: tuple[str, ...], lost: float, frame: int) -> None:
        """Keep a frame's views."""
        self.views, self.view_names, self.lost, self.frame = views, view_names, lost, frame

    def averaged(self, fill: Fill) -> Fill:
        """Return the mean of a frame's fill and of those before, in the frame's view, and keep it."""
        self._fills = [*self._fills[1 - _MOST_FILLS :], fill]
        return Fill.merged(self._fills)

    @property
    def fills(self) -> int:
        """How many fills are kept."""
        return len(self._fills)


def world_state(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bytes:
    """Return a hash of all that the light of a scene depends on, but for its camera.

    Of what is seen and shines: places, meshes, lamps, shader nodes. What changes with time in a way that is
    not looked into (image sequences, volumes, other geometry with modifiers or animation, animated things
    that the viewport hides) counts as another world at each frame.
    """
    digest = hashlib.blake2b(digest_size=16)
    depsgraph = view_layer.depsgraph
    depsgraph.update()
    seen: set[int] = set()
    for instance in depsgraph.object_instances:
        item = instance.object
        if item.type in _UNSEEN:
            continue
        digest.update(np.array(instance.matrix_world, dtype=np.float64).tobytes())
        data = item.data
        if data is not None and data.session_uid not in seen:
            seen.add(data.session_uid)
            digest.update(_shape(item, scene.frame_current))
    for owner in (*shaded_materials(), *shaded_worlds()):
        evaluated = owner.evaluated_get(depsgraph)
        for node in nodes_with_groups(evaluated.node_tree):
            digest.update(repr(list(_node_values(node))).encode())
    if _changes_unseen(scene):
        digest.update(str(scene.frame_current).encode())
    return digest.digest()


def _shape(item: bpy.types.Object, frame: int) -> bytes:
    """Return what tells an evaluated object's shape, or its light, from another's."""
    data = item.data
    if item.type == "MESH":
        points = np.empty(3 * len(data.vertices), dtype=np.float32)
        data.vertices.foreach_get("co", points)
        return points.tobytes()
    if item.type == "LIGHT":
        nodes = [] if data.node_tree is None else list(nodes_with_groups(data.node_tree))
        return repr([_values(data, _LAMP_VALUES), *(list(_node_values(node)) for node in nodes)]).encode()
    may_move = item.type == "VOLUME" or item.modifiers or item.animation_data or data.animation_data
    return repr((data.name_full, frame if may_move else 0)).encode()


def _node_values(node: bpy.types.Node) -> Iterator[Any]:
    """Yield what a node computes with: its kind, its own options, the values of its inputs."""
    yield node.bl_idname, node.mute
    shared = bpy.types.Node.bl_rna.properties
    own = [item.identifier for item in node.bl_rna.properties if item.identifier not in shared]
    yield _values(node, own)
    if "color_ramp" in own:
        yield [(element.position, tuple(element.color)) for element in node.color_ramp.elements]
    for socket in node.inputs:
        yield _plain(getattr(socket, "default_value", None))
        yield [(link.from_node.name, link.from_socket.identifier) for link in socket.links]


def _values(owner: bpy.types.bpy_struct, names: Iterable[str]) -> list[Any]:
    """Return the numbers, switches and texts among properties, for those that there are."""
    return [_plain(getattr(owner, name, None)) for name in names]


def _plain(value: Any) -> Any:
    if isinstance(value, (bool, int, float, str)):
        return value
    return tuple(value) if isinstance(value, (bpy.types.bpy_prop_array, Color, Euler, Vector)) else None


def _changes_unseen(scene: bpy.types.Scene) -> bool:
    """Return whether something may change with time that `world_state` does not look into."""
    if any(image.users and image.source in {"SEQUENCE", "MOVIE"} for image in bpy.data.images):
        return True
    return any(
        not item.hide_render and not item.visible_get() and item.animation_data is not None
        for item in scene.objects
        if item.type not in _UNSEEN
    )
