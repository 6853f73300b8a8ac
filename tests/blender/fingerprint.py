# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything about the user's data that a capture could leave changed, as a flat dictionary."""

from __future__ import annotations

from typing import Any

import bpy

COUNTED = (
    "scenes", "objects", "materials", "worlds", "cameras", "lights", "meshes",
    "node_groups", "images", "texts", "collections", "actions", "libraries",
)  # fmt: skip
DUMPED = ("scenes", "materials", "worlds", "node_groups", "cameras")
# Wrappers of the whole file, values that Blender computes, and tools that no render touches.
SKIPPED = frozenset(
    (
        "rna_type", "original", "preview", "asset_data", "depsgraph", "objects", "all_objects",
        "internal_links", "selected_studio_light", "tool_settings", "keying_sets", "keying_sets_all",
        "sequence_editor",
    )
)  # fmt: skip


def fingerprint() -> dict[str, object]:
    """Return every property of scenes, view layers, materials, worlds, node groups and cameras."""
    found: dict[str, Any] = {}
    for name in COUNTED:
        found[name] = sorted(item.name_full for item in getattr(bpy.data, name))
    # Blender's own buffer: it comes into being with the first render of a file.
    found["images"] = [image for image in found["images"] if image != "Render Result"]
    for name in DUMPED:
        for item in getattr(bpy.data, name):
            _dump(item, f"{name}[{item.name_full}]", found, seen=set())
    return found


def changes(before: dict[str, object], after: dict[str, object]) -> dict[str, tuple[object, object]]:
    """Return what differs, as ``{path: (before, after)}``."""
    paths = before.keys() | after.keys()
    return {
        path: (before.get(path), after.get(path)) for path in paths if before.get(path) != after.get(path)
    }


def _dump(struct: bpy.types.bpy_struct, path: str, found: dict[str, object], seen: set[object]) -> None:
    for prop in struct.bl_rna.properties:
        name = prop.identifier
        if name in SKIPPED or getattr(prop, "is_deprecated", False):
            continue
        here = f"{path}.{name}"
        value = getattr(struct, name)
        if prop.type == "COLLECTION":
            value = [item for item in value if not _is_hidden_pass(item)]
            found[here] = len(value)
            for index, item in enumerate(value):
                _follow(item, f"{here}[{index}]", found, seen)
        elif prop.type == "POINTER":
            _follow(value, here, found, seen)
        else:
            is_array = getattr(prop, "is_array", False)
            found[here] = (tuple(_flat(value)) if is_array else value, struct.is_property_set(name))


def _follow(
    value: bpy.types.bpy_struct | None, path: str, found: dict[str, object], seen: set[object]
) -> None:
    """Dump what belongs to its owner, once; name what stands on its own."""
    is_embedded_tree = isinstance(value, bpy.types.NodeTree) and value.is_embedded_data
    if value is None or (isinstance(value, bpy.types.ID) and not is_embedded_tree):
        found[path] = None if value is None else value.name_full
        return
    names = (value.bl_rna.identifier, getattr(value, "name", ""), getattr(value, "identifier", ""))
    found[path] = names
    key = (value.as_pointer(), names[0])
    if key not in seen:
        seen.add(key)
        _dump(value, path, found, seen)


def _is_hidden_pass(item: bpy.types.bpy_struct) -> bool:
    """Before 5.1 a Render Layers node keeps sockets of passes that it does not show, in any order."""
    return (
        isinstance(item, bpy.types.NodeSocket)
        and not item.enabled
        and item.node.bl_idname == "CompositorNodeRLayers"
    )


def _flat(values: object) -> list[object]:
    try:
        return [flat for value in values for flat in _flat(value)]
    except TypeError:
        return [values]
