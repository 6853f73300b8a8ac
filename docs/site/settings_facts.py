# SPDX-License-Identifier: GPL-3.0-or-later
"""Default, range, unit and help text of each setting, from its one declaration."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

from docs.site.commands import flag_of
from ssgi_addon.core.settings import PRESETS, DiffuseSettings, ReflectionSettings, Settings
from ssgi_addon.job_options import BEYOND_FRAME, ENGINES, JobOptions, rendered

# Where Blender's panel has options of a job, and of what both passes share.
_SAMPLING = ("samples", "denoiser", "own_geometry")
_COMPARE = ("compare", "reference_samples")
_FILL_USE = ("fill_mode", "filled_roughness", "visibility")
# From here on digits are grouped.
_LARGE = 1e5


def settings_of(group: str) -> list[Field[Any]]:
    """Return the declared fields of a page: ``ReflectionSettings``, ``beyond`` and so on.

    Raises
    ------
    KeyError
        If there is no such group.
    """
    own = {
        "ReflectionSettings": list(fields(ReflectionSettings)),
        "DiffuseSettings": list(fields(DiffuseSettings)),
        "Settings": list(fields(Settings)),
        "beyond": [item for item in fields(JobOptions) if item.name in BEYOND_FRAME],
        "job": [item for item in fields(JobOptions) if item.name not in BEYOND_FRAME],
    }[group]
    return [item for item in own if item.metadata]


def with_facts(group: str, text: str) -> str:
    """Return a page with what is declared of each setting below its heading.

    Raises
    ------
    ValueError
        If a setting of the group has no heading.
    """
    for item in settings_of(group):
        heading = re.compile(rf"^(### {item.name})$", re.MULTILINE)
        if item.name != "enabled" and not heading.search(text):
            raise ValueError(f"the page of {group} has no section on {item.name}")
        text = heading.sub(lambda match, item=item: f"{match[1]}\n\n{facts(group, item)}", text)
    return text


def facts(group: str, item: Field[Any]) -> str:
    """Return a setting's help text and a table of what is declared of it, Markdown."""
    rule = item.metadata
    cells = {
        "default": _shown(item.default),
        "presets": _presets(group, item.name),
        "range": _range(item),
        "unit": rule["unit"],
        "in Blender": f"*{_panel(group, item.name)}* › *{rule['label']}*",
        "in Python": f"`{_owner(group)}.{item.name}`",
        "command line": f"`{flag_of(item.name)}`" if flag_of(item.name) and _has_flag(group, item) else "",
    }
    cells = {name: value for name, value in cells.items() if value}
    lines = [
        f"*{rule['help']}.*",
        "",
        "| " + " | ".join(cells) + " |",
        "| " + " | ".join("---" for _ in cells) + " |",
        "| " + " | ".join(cells.values()) + " |",
        "",
    ]
    if rule["choice_help"]:
        lines += [f"- `{choice}`: {text}" for choice, text in rule["choice_help"].items()] + [""]
    if rule["methods"] is not None:
        lines += [f"Only for the method {' or '.join(f'`{name}`' for name in rule['methods'])}.", ""]
    return "\n".join(lines)


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if value is None:
        return "as many as there are"
    if value == math.inf:
        return "without limit"
    return f"`{value}`" if isinstance(value, str) else number(value)


def number(value: float) -> str:
    """Return a number of a declaration as people write it."""
    return f"{value:,.0f}" if abs(value) >= _LARGE else f"{value:g}"


def _presets(group: str, name: str) -> str:
    """Return what each preset sets, where they differ from each other or from the default."""
    values = {preset: _of_preset(group, name, preset) for preset in PRESETS}
    shown = {preset: _shown(value) for preset, value in values.items()}
    owner = {item.name: item.default for item in settings_of(group)}
    if set(shown.values()) == {_shown(owner[name])}:
        return ""
    return ", ".join(f"{preset} {value}" for preset, value in shown.items())


def _of_preset(group: str, name: str, preset: str) -> Any:
    settings = Settings.preset(preset)
    if group in ("beyond", "job"):
        default = getattr(JobOptions(output=Path()), name)
        return rendered(preset, ENGINES[0]).get(name, default)
    part = {"ReflectionSettings": settings.reflections, "DiffuseSettings": settings.diffuse}
    return getattr(part.get(group, settings), name)


def _range(item: Field[Any]) -> str:
    rule = item.metadata
    if rule["choices"] is not None or isinstance(item.default, bool) or rule["min"] is None:
        return ""
    lowest = number(rule["min"])
    text = f"from {lowest}" if rule["max"] is None else f"{lowest} to {number(rule['max'])}"
    return text if rule["soft_max"] is None else f"{text} (slider to {number(rule['soft_max'])})"


def _owner(group: str) -> str:
    return "JobOptions" if group in ("beyond", "job") else group


def _panel(group: str, name: str) -> str:
    named: Iterator[str] = (
        panel
        for panel, names in (
            ("Sampling", _SAMPLING),
            ("Compare with Cycles", _COMPARE),
            ("Beyond the Frame", (*_FILL_USE, *BEYOND_FRAME, "keep_world")),
            ("Output", ("save_passes",)),
        )
        if name in names
    )
    own = {"ReflectionSettings": "Reflections", "DiffuseSettings": "Diffuse"}.get(group)
    return own or next(named, "Advanced")


def _has_flag(group: str, item: Field[Any]) -> bool:
    """Whether the command line's option of that name is this setting and not one of another group."""
    if group in ("ReflectionSettings", "DiffuseSettings"):
        return item.name == "rays"
    return True
