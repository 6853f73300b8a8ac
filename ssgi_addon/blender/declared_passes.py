# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes that a render with our light takes and gives, declared in a scene while it is switched on.

Blender decides before a render which passes it has, and artists link the sockets that stand for them in the
compositor. So what is declared stays in the file from the moment the light is switched on until it is
switched off, also while the extension is disabled. Each view layer carries a note of what was added to it,
which goes along when the layer is copied.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import bpy

from . import compat
from .cycles_passes import pass_switches
from .gbuffer import GEOMETRY_PASSES, LIGHT_PASSES
from .roughness import FIRST_HIT

PICTURE, DIFFUSE, GLOSSY, VISIBILITY = "SSGI", "SSGI Diffuse", "SSGI Glossy", "SSGI Visibility"
# The outputs, with the type that Blender calls them by.
OUTPUTS = {PICTURE: "COLOR", DIFFUSE: "COLOR", GLOSSY: "COLOR", VISIBILITY: "VALUE"}
# What Cycles' own bounces bring, where they are not taken out of the render.
BOUNCE_PASSES = ("Diffuse Indirect", "Glossy Indirect")


def needed_passes(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Return the passes that our light is computed from, by their long names."""
    bounces = () if scene.ssgi.replace_gi else BOUNCE_PASSES
    return (*GEOMETRY_PASSES, *LIGHT_PASSES, *bounces)


def declare_passes(scene: bpy.types.Scene) -> None:
    """Bring the passes of all view layers in line with the scene's settings.

    Switched on, what is missing is added; switched off, what was added is taken back and nothing else. A
    linked scene stays as its file has it.
    """
    if not scene.is_editable:
        return
    is_on = scene.ssgi.enabled
    has_changed = False
    for layer in scene.view_layers:
        has_changed |= _switch(layer, _wanted(layer) if is_on else {})
        has_changed |= _add_outputs(layer) if is_on else _remove_outputs(layer)
    # Materials are edited while such a render goes on, and no window may draw their nodes then
    edits_materials = is_on and not all(map(_has_roughness_pass, scene.view_layers))
    _switch(scene, {"render.use_lock_interface": True} if edits_materials else {})
    if has_changed:
        for layer in scene.view_layers:
            compat.update_render_layers_nodes(layer)


def _wanted(layer: bpy.types.ViewLayer) -> dict[str, bool]:
    """Return the properties to set, by their paths from the view layer."""
    of_layer, of_cycles = pass_switches(needed_passes(layer.id_data))
    if _has_roughness_pass(layer):
        of_cycles |= FIRST_HIT
    return of_layer | {f"cycles.{name}": value for name, value in of_cycles.items()}


def _has_roughness_pass(layer: bpy.types.ViewLayer) -> bool:
    return hasattr(layer, "cycles") and compat.has_roughness_pass(layer)


def _switch(struct: bpy.types.Scene | bpy.types.ViewLayer, wanted: Mapping[str, bool]) -> bool:
    """Set properties that are noted with what they were, and take back those that are not wanted any more."""
    before = _note(struct, "switched")
    after = {path: old for path, old in before.items() if path in wanted}
    for path in before.keys() - wanted.keys():
        owner, name = _owner(struct, path)
        was_set, old = before[path]
        if was_set:
            setattr(owner, name, old)
        else:
            owner.property_unset(name)
    has_changed = before.keys() != after.keys()
    for path, value in wanted.items():
        owner, name = _owner(struct, path)
        old = getattr(owner, name)
        if old != value:
            after.setdefault(path, (owner.is_property_set(name), old))
            setattr(owner, name, value)
            has_changed = True
    _take_note(struct, "switched", after)
    return has_changed


def _add_outputs(layer: bpy.types.ViewLayer) -> bool:
    """Add the outputs that are missing; a user's own of the same name is not touched."""
    missing = [name for name in OUTPUTS if name not in layer.aovs]
    active = layer.active_aov_index
    for name in missing:
        output = layer.aovs.add()
        output.name, output.type = name, OUTPUTS[name]
    if missing:
        _take_note(layer, "outputs", sorted({*_note(layer, "outputs"), *missing}))
        layer.active_aov_index = active
    return bool(missing)


def _remove_outputs(layer: bpy.types.ViewLayer) -> bool:
    added = [name for name in _note(layer, "outputs") if name in layer.aovs]
    active = layer.active_aov_index
    for name in added:
        layer.aovs.remove(layer.aovs[name])
    if added:
        layer.active_aov_index = min(active, len(layer.aovs) - 1) if layer.aovs else active
    _take_note(layer, "outputs", [])
    return bool(added)


def _owner(struct: bpy.types.bpy_struct, path: str) -> tuple[bpy.types.bpy_struct, str]:
    *owners, name = path.split(".")
    for owner in owners:
        struct = getattr(struct, owner)
    return struct, name


def _note(struct: bpy.types.Scene | bpy.types.ViewLayer, kind: str) -> Any:
    return json.loads(struct.ssgi.declared or "{}").get(kind, {})


def _take_note(struct: bpy.types.Scene | bpy.types.ViewLayer, kind: str, value: Any) -> None:
    """Keep what was added beside the data itself, and leave no property behind when that is nothing."""
    notes = json.loads(struct.ssgi.declared or "{}")
    changed = {name: note for name, note in {**notes, kind: value}.items() if note}
    if changed == notes:
        return
    if changed:
        struct.ssgi.declared = json.dumps(changed)
    else:
        struct.ssgi.property_unset("declared")
