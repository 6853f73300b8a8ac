# SPDX-License-Identifier: GPL-3.0-or-later
"""What arguments of the command line mean; each function raises what argparse turns into bad usage."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields

from .core.camera import LARGEST_SIDE
from .progress import STYLES

MOST_FRAMES = 1_000_000
# Fewer frames than these, evenly apart, are shorter one by one
_SHORTEST_RUN = 3


def add_option(
    parser: argparse.ArgumentParser,
    flag: str,
    owner: type,
    name: str,
    *,
    metavar: str | None = None,
    default: str | None = None,
) -> None:
    """Add an option whose range, default and help text a dataclass declares by `core.settings.option`.

    Parameters
    ----------
    parser
        Its result has the attribute `name` only if the option is given.
    flag
        What the user writes.
    owner, name
        The dataclass and its field: a number, a choice, or a switch, which ``--no-…`` switches off.
    metavar
        Stands for the number in the help.
    default
        What the help says of the default; None means the field's.
    """
    (item,) = (item for item in fields(owner) if item.name == name)
    rule = item.metadata
    shared = {"dest": name, "default": argparse.SUPPRESS}
    choices = (f"{choice}: {_lowered(text)}" for choice, text in rule["choice_help"].items())
    help_text = "; ".join([_lowered(rule["help"]), *choices])
    if default or not isinstance(item.default, bool):
        help_text = f"{help_text} (default: {default or item.default})"
    if isinstance(item.default, bool):
        parser.add_argument(flag, action=argparse.BooleanOptionalAction, help=help_text, **shared)
        return
    if rule["choices"] is not None:
        parser.add_argument(flag, choices=rule["choices"], help=help_text, **shared)
        return
    read = real_number if isinstance(item.default, float) else integer
    parser.add_argument(
        flag,
        metavar=metavar,
        type=read(rule["min"], rule["max"]),
        help=help_text,
        **shared,
    )


def add_autoexec(parser: argparse.ArgumentParser) -> None:
    """Add the option that lets a file's scripts run, under the name that it has in Blender."""
    parser.add_argument(
        "--enable-autoexec",
        action="store_true",
        help="run the scripts and drivers of the .blend file, which can do anything that you can: for files "
        "that you trust (default: as Blender was told to, and never with Blender as a Python module)",
    )


def add_progress(parser: argparse.ArgumentParser) -> None:
    """Add the option that says how progress is told."""
    parser.add_argument(
        "--progress",
        choices=STYLES,
        default=STYLES[0],
        help="bar: on a terminal; lines: in a log; openjd: for Open Job Description, on standard output "
        f"(default: {STYLES[0]}, bar on a terminal, else lines)",
    )


def whole_number(text: str) -> int:
    """Read a whole number."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}") from None


def integer(lowest: int, highest: int) -> Callable[[str], int]:
    """Return a reader of whole numbers from `lowest` to `highest`."""

    def parse(text: str) -> int:
        value = whole_number(text)
        if not lowest <= value <= highest:
            raise argparse.ArgumentTypeError(f"expected {lowest} to {highest}, got {value}")
        return value

    return parse


def real_number(lowest: float, highest: float) -> Callable[[str], float]:
    """Return a reader of numbers from `lowest` to `highest`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected a number, got {text!r}") from None
        if not lowest <= value <= highest:
            raise argparse.ArgumentTypeError(f"expected {lowest:g} to {highest:g}, got {text}")
        return value

    return parse


def resolution(text: str) -> tuple[int, int]:
    """Read ``WxH``, pixels."""
    found = re.fullmatch(r"(\d+)[xX](\d+)", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT, such as 960x540, got {text!r}")
    width, height = int(found[1]), int(found[2])
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
        raise argparse.ArgumentTypeError(f"expected 1 to {LARGEST_SIDE} pixels a side, got {text!r}")
    return width, height


def frame_list(text: str) -> tuple[int, ...]:
    """Read frames and ranges, ``A``, ``A-B`` or ``A-B:STEP``, with commas between them; both ends count.

    Farms write them so (Open Job Description calls it a range expression). Returned in ascending order, each
    once.
    """
    frames: set[int] = set()
    for part in text.split(","):
        frames.update(_frame_range(part.strip(), text))
        if len(frames) > MOST_FRAMES:
            raise argparse.ArgumentTypeError(f"expected at most {MOST_FRAMES} frames, got {text!r}")
    return tuple(sorted(frames))


def _frame_range(part: str, text: str) -> range:
    found = re.fullmatch(r"(-?\d+)(?:\s*-\s*(-?\d+)(?:\s*:\s*(-?\d+))?)?", part)
    if found is None:
        raise argparse.ArgumentTypeError(
            f"expected frames and ranges FIRST-LAST or FIRST-LAST:STEP, such as 1-4,7,10-48:2, got {text!r}"
        )
    first = int(found[1])
    last, step = int(found[2] or first), int(found[3] or 1)
    if step == 0 or (last - first) * step < 0 or (last - first) // step >= MOST_FRAMES:
        raise argparse.ArgumentTypeError(
            f"expected a STEP that leads from FIRST to LAST, at most {MOST_FRAMES} times, got {text!r}"
        )
    return range(first, last + (1 if step > 0 else -1), step)


def frame_text(frames: Iterable[int]) -> str:
    """Return frames as `frame_list` reads them: ``1-4,7-21:2,30``."""
    return ",".join(_run_text(run) for run in _even_runs(sorted(set(frames))))


def _even_runs(frames: list[int]) -> Iterator[list[int]]:
    """Cut rising numbers into runs that are evenly apart, each as long as it gets from the left."""
    begin = 0
    while begin < len(frames):
        end = begin + 1
        step = frames[end] - frames[begin] if end < len(frames) else 1
        while end < len(frames) and frames[end] - frames[end - 1] == step:
            end += 1
        # Two numbers apart are no run: the second may begin a longer one
        if step > 1 and end - begin < _SHORTEST_RUN:
            end = begin + 1
        yield frames[begin:end]
        begin = end


def _run_text(run: list[int]) -> str:
    if len(run) == 1:
        return str(run[0])
    step = run[1] - run[0]
    return f"{run[0]}-{run[-1]}" if step == 1 else f"{run[0]}-{run[-1]}:{step}"


def _lowered(text: str) -> str:
    """Return a sentence as it stands within another one."""
    return text[0].lower() + text[1:]
