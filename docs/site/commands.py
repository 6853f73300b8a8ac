# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line reference, from the argument parser itself."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping

from ssgi_addon.cli import build_parser


def subparsers(*, inside_blender: bool = False) -> Mapping[str, argparse.ArgumentParser]:
    """Return the parser of each command that stands in the help."""
    parser = build_parser(inside_blender=inside_blender)
    (action,) = (item for item in parser._actions if isinstance(item, argparse._SubParsersAction))
    shown = {item.dest for item in action._choices_actions}
    return {name: sub for name, sub in action.choices.items() if name in shown}


def flag_of(name: str) -> str:
    """Return how the command line spells an option of ``render``, empty where it has none."""
    for action in subparsers()["render"]._actions:
        if action.dest == name and action.option_strings:
            return _spelled(action)
    return ""


def commands() -> str:
    """Return a section for each command: usage, help and a table of its arguments, Markdown."""
    helps = {item.dest: item.help for item in _group()._choices_actions}
    sections = []
    for name, parser in subparsers().items():
        text = helps[name] or ""
        rows = ["| argument | means |", "| --- | --- |"]
        rows += [f"| {_cell(f'`{_spelled(action)}`')} | {_cell(_help(action))} |" for action in _told(parser)]
        sections.append("\n".join([f"## ssgi {name}", "", f"{text[0].upper()}{text[1:]}.", "", *rows]))
    return "\n\n".join(sections)


def _group() -> argparse._SubParsersAction[argparse.ArgumentParser]:
    parser = build_parser()
    (action,) = (item for item in parser._actions if isinstance(item, argparse._SubParsersAction))
    return action


def _told(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    return (action for action in parser._actions if not isinstance(action, argparse._HelpAction))


def _spelled(action: argparse.Action) -> str:
    """Return an argument as it is written."""
    names = ", ".join(action.option_strings)
    if action.nargs == 0:
        return names
    if action.choices is not None:
        value = "{" + ",".join(str(choice) for choice in action.choices) + "}"
    else:
        metavar = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
        value = f"{metavar} …" if action.nargs in ("*", "+") else metavar
    value = f"[{value}]" if action.nargs == "?" else value
    needed = " (needed)" if action.required and action.option_strings else ""
    return f"{names} {value}{needed}".strip()


def _help(action: argparse.Action) -> str:
    text = (action.help or "") % {"default": action.default} if "%(" in (action.help or "") else action.help
    # As code: two hyphens would become a dash
    text = re.sub(r"(--[a-z][\w-]*)", r"`\1`", text or "")
    return f"{text[:1].upper()}{text[1:]}"


def _cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|")
