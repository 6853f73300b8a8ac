# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a scene, `bpy.types.Scene.ssgi`, made from dataclasses: `core.settings`, `job_options`."""

from __future__ import annotations

import math
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from .blender.declared_passes import declare_passes
from .core.settings import PRESETS, Settings
from .job_options import DEFAULT_PRESET, ENGINE_LABELS, ENGINES, PRESET_HELP, JobOptions, rendered
from .view_properties import CompareProperties, LookProperties, redraw_comparison

# A Blender property has no "none" and no infinity; 0 stands for both, and its help says so.
OPEN_ENDED = {None: "0 takes as many as there are", math.inf: "0 is without limit"}
# Outside the class: Python 3.11 evaluates annotations where a comprehension sees no other names.
_ENGINE_ITEMS = [
    (name, ENGINE_LABELS[name], f"Render the direct light with {ENGINE_LABELS[name]}") for name in ENGINES
]
_PRESET_ITEMS = [(name, name.title(), PRESET_HELP[name]) for name in PRESETS]
# Blender shows these units behind the number.
_SUBTYPES = {"scene units": "DISTANCE", "pixels": "PIXEL"}
_DEFAULTS = Settings.preset(DEFAULT_PRESET)
_ACRONYMS = {"ssao": "SSAO"}


def annotations_of(settings: Any) -> dict[str, Any]:
    """Make one Blender property for each option of a settings dataclass, with the value that it has there."""
    return {
        item.name: _property(item, getattr(settings, item.name)) for item in fields(settings) if item.metadata
    }


def core_settings(group: bpy.types.PropertyGroup) -> Settings:
    """Return what a scene's properties say as the settings of `render_indirect`.

    Raises
    ------
    ValueError
        If a property holds what the settings refuse; the ranges of the properties rule that out.
    """
    return _from_group(Settings, group)


def job_options(group: bpy.types.PropertyGroup, output: Path) -> JobOptions:
    """Return what a scene's properties say as the options of a job that writes into `output`."""
    named = {item.name: getattr(group, item.name) for item in fields(JobOptions) if item.metadata}
    return JobOptions(
        output=output,
        settings=core_settings(group),
        engine=group.engine,
        overwrite=group.overwrite,
        **named,
    )


def apply_preset(group: bpy.types.PropertyGroup, name: str) -> None:
    """Set the properties in which the presets differ; the seed, say, stays the user's."""
    presets = {key: _flat(Settings.preset(key)) for key in PRESETS}
    for path, value in presets[name].items():
        if any(other[path] != value for other in presets.values()):
            *owners, attribute = path
            target = group
            for owner in owners:
                target = getattr(target, owner)
            setattr(target, attribute, 0 if value in OPEN_ENDED else value)


def _property(item: Field[Any], default: Any) -> Any:
    rule = item.metadata
    if rule["choices"] is not None:
        items = [(choice, _label(choice), text) for choice, text in rule["choice_help"].items()]
        return EnumProperty(name=rule["label"], description=rule["help"], items=items, default=default)
    if isinstance(item.default, bool):
        return BoolProperty(name=rule["label"], description=rule["help"], default=default)
    return _number_property(item, default)


def _number_property(item: Field[Any], default: Any) -> Any:
    rule = item.metadata
    options: dict[str, Any] = {"name": rule["label"], "description": rule["help"], "default": default}
    for ours, blenders in (("min", "min"), ("max", "max"), ("soft_max", "soft_max")):
        if rule[ours] is not None:
            options[blenders] = rule[ours]
    if item.default in OPEN_ENDED:
        options |= {"min": 0, "description": f"{rule['help']}. {OPEN_ENDED[item.default]}"}
        options["default"] = 0 if default == item.default else default
    if isinstance(item.default, float):
        # A part of a whole is a slider.
        is_factor = rule["min"] == 0.0 and rule["max"] is not None and rule["max"] <= 1.0
        subtype = "FACTOR" if is_factor else _SUBTYPES.get(rule["unit"], "NONE")
        return FloatProperty(**options, subtype=subtype)
    return IntProperty(**options, subtype=_SUBTYPES.get(rule["unit"], "NONE"))


def _label(choice: str) -> str:
    return _ACRONYMS.get(choice, choice.replace("_", " ").title())


def _from_group(settings_type: type, group: bpy.types.PropertyGroup) -> Any:
    values = {}
    for item in fields(settings_type):
        value = getattr(group, item.name)
        if not item.metadata:
            value = _from_group(item.default_factory, value)
        elif item.default in OPEN_ENDED and value == 0:
            value = item.default
        elif isinstance(value, float):
            # Blender stores 0.1 as the nearest float32; the number that was meant is its shortest decimal.
            value = float(str(np.float32(value)))
        values[item.name] = value
    return settings_type(**values)


def _flat(settings: Any, prefix: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    """Return nested settings as one dictionary, keyed by the path of attribute names."""
    flat = {}
    for item in fields(settings):
        path, value = (*prefix, item.name), getattr(settings, item.name)
        flat |= {path: value} if item.metadata else _flat(value, path)
    return flat


def _follow_preset(group: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    apply_preset(group, group.preset)
    for name, value in rendered(group.preset, group.engine).items():
        setattr(group, name, value)


def _follow_engine(group: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Set what the preset captures otherwise for this engine."""
    options = [rendered(group.preset, engine) for engine in ENGINES]
    for name, value in rendered(group.preset, group.engine).items():
        if any(other[name] != value for other in options):
            setattr(group, name, value)


def _declare(group: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    declare_passes(group.id_data)


class SSGI_PG_diffuse(bpy.types.PropertyGroup):
    """Diffuse indirect light."""

    __annotations__ = annotations_of(_DEFAULTS.diffuse)


class SSGI_PG_reflections(bpy.types.PropertyGroup):
    """Glossy indirect light."""

    __annotations__ = annotations_of(_DEFAULTS.reflections)


class _SharedSettings:
    """What both passes share; kept apart, since a class body either assigns or writes annotations."""

    __annotations__ = annotations_of(_DEFAULTS)


class _JobOptions:
    """What to render besides, and what to keep."""

    __annotations__ = annotations_of(JobOptions(output=Path()))


class SSGI_PG_settings(
    _SharedSettings, _JobOptions, LookProperties, CompareProperties, bpy.types.PropertyGroup
):
    """Everything that a scene keeps for this extension."""

    enabled: BoolProperty(
        name="In Renders",
        description="Add the indirect light to every Cycles render of this scene, and declare passes for it",
        default=False,
        options=set(),
        update=_declare,
    )
    replace_combined: BoolProperty(
        name="Replace Combined",
        description="Let the picture of the render itself show the light; else only the SSGI passes hold it",
        default=True,
        options=set(),
    )
    replace_gi: BoolProperty(
        name="Replace GI",
        description="Render without Cycles' diffuse and glossy bounces. Else they are taken out of what our "
        "light is added to, and the Combined pass shows them unless it is replaced",
        default=True,
        options=set(),
        update=_declare,
    )
    declared: StringProperty(
        name="Declared", description="What was switched on for renders with the light", options={"HIDDEN"}
    )
    preset: EnumProperty(
        name="Preset",
        description="Point between speed and accuracy; choosing one sets samples, fill, rays and captures",
        items=_PRESET_ITEMS,
        default=DEFAULT_PRESET,
        update=_follow_preset,
    )
    diffuse: PointerProperty(type=SSGI_PG_diffuse)
    reflections: PointerProperty(type=SSGI_PG_reflections)

    engine: EnumProperty(
        name="Engine",
        description="Render engine of the direct light",
        items=_ENGINE_ITEMS,
        default=ENGINES[0],
        update=_follow_engine,
    )

    output: StringProperty(
        name="Output",
        description="Folder of the results; a file that was never saved uses Blender's temporary folder",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        default="//ssgi/",
    )
    overwrite: BoolProperty(name="Overwrite", description="Replace results of an earlier run", default=True)
    add_to_compositor: BoolProperty(
        name="Add to Compositor",
        description="Add the result to the compositor's output by a node group, or update that group",
        default=True,
    )
    result: StringProperty(
        name="Result",
        description="File that the last run wrote",
        subtype="FILE_PATH",
        options={"HIDDEN"},
        update=redraw_comparison,
    )


class SSGI_PG_view_layer(bpy.types.PropertyGroup):
    """What was added to a view layer."""

    declared: StringProperty(
        name="Declared", description="Passes that were added for renders with the light", options={"HIDDEN"}
    )


CLASSES = (SSGI_PG_diffuse, SSGI_PG_reflections, SSGI_PG_settings, SSGI_PG_view_layer)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.ssgi = PointerProperty(type=SSGI_PG_settings)
    bpy.types.ViewLayer.ssgi = PointerProperty(type=SSGI_PG_view_layer)


def unregister() -> None:
    del bpy.types.ViewLayer.ssgi
    del bpy.types.Scene.ssgi
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
