# SPDX-License-Identifier: GPL-3.0-or-later
"""A process of our own: started, listened to without waiting, ended with all that it started."""

from __future__ import annotations

import os
import queue
import select
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from .progress import understand

#: The command line prints the reason of a failure in a line that begins so.
ERROR_MARK = "ssgi: error: "
_LAST_LINES = 5
# Seconds; a process that was killed is gone at once unless the system holds it in a read or a write.
_LONGEST_END = 5.0
# Seconds of a look at the standard input; Windows knows no look at a pipe
_LOOK, _CAN_LOOK = 0.1, sys.platform != "win32"


def ssgi_command(blender: str, *arguments: str, options: Sequence[str] = ()) -> list[str]:
    """Return the command line that runs a command of ours.

    Parameters
    ----------
    blender
        The Blender program, with this extension in it; empty: this Python.
    *arguments
        Of our command line.
    options
        Blender's own.
    """
    if blender:
        return [blender, *options, "--command", "ssgi", *arguments]
    return [sys.executable, "-m", "ssgi_addon", *arguments]


def environment(**changes: str) -> dict[str, str]:
    """Return an environment in which a process of this Python finds this package."""
    root = str(Path(__file__).parents[1])
    paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **changes}


def printed_error(lines: Iterable[str]) -> str:
    """Return the reason that the command line printed last; empty where it printed none."""
    found = [line.removeprefix(ERROR_MARK) for line in lines if line.startswith(ERROR_MARK)]
    return found[-1] if found else ""


class Child:
    """A running process whose output a thread reads, so that nobody ever waits for it.

    It lives in a process group of its own. If it works in `ended_with_parent`, it ends when this process
    does.

    Parameters
    ----------
    command
        Program and arguments.
    env
        Its environment.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(self, command: Sequence[str], env: Mapping[str, str]) -> None:
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, encoding="utf-8", errors="replace", env=dict(env), **_own_group(),
        )  # fmt: skip
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._last: deque[str] = deque(maxlen=_LAST_LINES)
        self._reader = threading.Thread(target=self._read, name="ssgi-child", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def news(self) -> tuple[float, str] | None:
        """Return the newest progress since the last call; None where there is none. Does not wait."""
        newest = None
        while not self._lines.empty():
            line = self._lines.get()
            told = understand(line)
            if told is not None:
                newest = told
            elif line.strip():
                self._last.append(line.strip())
        return newest

    def has_ended(self) -> bool:
        """Whether it has ended and all that it printed is read. Does not wait."""
        if self._process.poll() is None:
            return False
        if self._reader.is_alive():
            # What it started may hold the pipe open
            self._kill_group()
            return False
        return True

    def failure(self) -> str | None:
        """Return why an ended process failed; None where it did not."""
        status = self._process.returncode
        if status == 0:
            return None
        self.news()
        if reason := printed_error(self._last):
            return reason
        if status == -getattr(signal, "SIGKILL", 0):
            return "it was killed: memory may have run out"
        if status < 0:
            return f"it crashed ({signal.Signals(-status).name})"
        said = f"; its last words: {self._last[-1]}" if self._last else ""
        return f"it ended with exit status {status}{said}"

    def kill(self) -> None:
        """End it, and all that it started."""
        self._kill_group()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_LONGEST_END)
        self._reader.join(_LONGEST_END)
        with suppress(OSError):  # closing writes out what is buffered, into a pipe that nobody reads
            self._process.stdin.close()
        if not self._reader.is_alive():
            self._process.stdout.close()

    def _kill_group(self) -> None:
        if sys.platform == "win32":
            command = ["taskkill", "/F", "/T", "/PID", str(self.pid)]
            subprocess.run(command, capture_output=True, check=False)
            return
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)

    def _read(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line)


@contextmanager
def ended_with_parent(clean: Callable[[], None]) -> Iterator[None]:
    """End this process, after `clean`, if its input closes during the block: its parent is gone then.

    Where the block ends by itself first, as by writing to a parent that is gone, it is cleaned up as well.
    """
    is_done = threading.Event()

    def watch() -> None:
        while not is_done.is_set():
            if _input_closes(_LOOK):
                clean()
                os._exit(1)

    watcher = threading.Thread(target=watch, name="ssgi-parent", daemon=True)
    watcher.start()
    # A parent that goes closes our output a moment before our input
    look = _LOOK
    try:
        yield
        look = 0.0
    finally:
        is_done.set()
        if _CAN_LOOK:  # Blender 4.5 as a module would not end with the thread alive
            watcher.join()
            if _input_closes(look):
                clean()


def _input_closes(seconds: float) -> bool:
    """Look for so long, or where the system has no way to, until something comes."""
    if _CAN_LOOK and not select.select([0], [], [], seconds)[0]:
        return False
    return not os.read(0, 1)


def _own_group() -> dict[str, int | bool]:
    """Return what `Popen` needs to start a process that is ended together with all that it starts."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
    return {"start_new_session": True}
