# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress: a bar on a terminal, plain lines in a log, marked lines for a process that started this one."""

from __future__ import annotations

import shutil
import sys
from typing import TextIO

BAR_WIDTH = 28
LOG_STEP = 0.1
#: A line that `tell` prints begins so; all others are Blender's.
MARK = "ssgi-progress"
#: How progress is told: a bar or lines for people, or the lines of Open Job Description's sessions.
STYLES = ("auto", "bar", "lines", "openjd")


def printable(text: object) -> str:
    """Return a text as one line in which nothing is a command to a terminal: names may hold anything."""
    line = " ".join(str(text).split())
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in line
    )


def tell(fraction: float, text: str) -> None:
    """Tell the parent process how far the work is."""
    print(f"{MARK} {fraction:.4f} {printable(text)}", flush=True)


def understand(line: str) -> tuple[float, str] | None:
    """Read what `tell` printed; None for other lines."""
    mark, _, rest = line.rstrip().partition(" ")
    if mark != MARK:
        return None
    fraction, _, text = rest.partition(" ")
    return float(fraction), text


class Progress:
    """Shows a fraction and what is being done; call it with both.

    Parameters
    ----------
    style
        One of `STYLES`; "auto" is a bar on a terminal and lines elsewhere.
    stream
        Where to; None means standard error, so that results can be piped, or where the style wants it.
    """

    def __init__(self, style: str = STYLES[0], stream: TextIO | None = None) -> None:
        self._is_job = style == "openjd"
        self._stream = stream or (sys.stdout if self._is_job else sys.stderr)
        self._is_terminal = style == "bar" or (style == "auto" and self._stream.isatty())
        self._shown: tuple[int, str] | None = None
        self._has_bar = False

    def __call__(self, fraction: float, text: str) -> None:
        """Show `fraction` (0 to 1) of the work as done, and `text` as what is at hand."""
        fraction, text = min(max(fraction, 0.0), 1.0), printable(text)
        step = int(fraction / (0.01 if self._is_terminal else LOG_STEP))
        if self._shown == (step, text):
            return
        self._shown = (step, text)
        if self._is_terminal:
            self._draw_bar(fraction, text)
        elif self._is_job:
            self._say("progress", f"{100.0 * fraction:.1f}")
            self._say("status", text)
        else:
            print(f"{fraction:4.0%} {text}", file=self._stream, flush=True)

    def fail(self, reason: str) -> None:
        """Tell a queue why the work failed; people read it in the error's own line."""
        if self._is_job:
            self._say("fail", printable(reason))

    def close(self) -> None:
        """Leave the bar's line, so that what follows starts on its own."""
        if self._has_bar:
            print(file=self._stream, flush=True)
            self._has_bar = False

    def _say(self, what: str, text: str) -> None:
        """Print a line for a session of Open Job Description ("How Jobs Are Run", messages)."""
        print(f"openjd_{what}: {text}", file=self._stream, flush=True)

    def _draw_bar(self, fraction: float, text: str) -> None:
        filled = round(fraction * BAR_WIDTH)
        line = f"[{'#' * filled}{'-' * (BAR_WIDTH - filled)}] {fraction:4.0%} {text}"
        columns = shutil.get_terminal_size().columns
        print(f"\r\x1b[K{line[: columns - 1]}", end="", file=self._stream, flush=True)
        self._has_bar = True
