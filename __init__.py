# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration of the extension.

Nothing but the standard library is imported at module level: tools that walk the folder import this
file where Blender is not at hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

_commands: list[Any] = []


def register() -> None:
    """Register classes, scene properties and the command `blender --command ssgi`."""
    import bpy

    for module in _modules():
        module.register()
    _commands.append(bpy.utils.register_cli_command("ssgi", _run_command))


def unregister() -> None:
    """Undo `register`, in reverse order."""
    import bpy

    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
    for module in reversed(_modules()):
        module.unregister()


def _modules() -> tuple[ModuleType, ...]:
    from . import operators
    from .ssgi_addon import preferences, progress_panel, properties, ui
    from .ssgi_addon.blender import in_render

    return preferences, properties, operators, progress_panel, ui, in_render


def _run_command(argv: Sequence[str]) -> int:
    from .ssgi_addon import cli

    return cli.main(argv, inside_blender=True)
