# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the passes on the command line."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace

from .arguments import add_option, integer
from .core import Settings
from .core.settings import PRESETS, DiffuseSettings, ReflectionSettings
from .job_options import DEFAULT_PRESET


def add_settings(parser: argparse.ArgumentParser, *, default: str | None) -> None:
    """Add what the command line offers of the settings, with ranges and texts from their one declaration."""
    otherwise = default or f"as the passes were rendered with, else {DEFAULT_PRESET}"
    parser.add_argument(
        "--preset", choices=tuple(PRESETS), help=f"point between speed and accuracy (default: {otherwise})"
    )
    rules = [
        next(item.metadata for item in fields(kind) if item.name == "rays")
        for kind in (DiffuseSettings, ReflectionSettings)
    ]
    lowest, highest = max(rule["min"] for rule in rules), min(rule["max"] for rule in rules)
    parser.add_argument(
        "--rays",
        metavar="N",
        type=integer(int(lowest), int(highest)),
        help=f"{rules[0]['unit']}, diffuse and glossy each (default: the preset's); a fill then only sets "
        "their level, unless --fill-mode says otherwise",
    )
    add_option(parser, "--fill-mode", Settings, "fill_mode", default="the preset's")


def given_settings(arguments: argparse.Namespace, base: Settings | None = None) -> Settings:
    """Return settings by preset, or `base` where none is named, with the number of rays where it is."""
    settings = base if base and not arguments.preset else Settings.preset(arguments.preset or DEFAULT_PRESET)
    fill_mode = getattr(arguments, "fill_mode", settings.fill_mode if arguments.rays is None else "level")
    settings = replace(settings, fill_mode=fill_mode)
    if arguments.rays is None:
        return settings
    return replace(
        settings,
        diffuse=replace(settings.diffuse, rays=arguments.rays),
        reflections=replace(settings.reflections, rays=arguments.rays),
    )
