# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes with all that they have started: killed together."""

from __future__ import annotations

import os
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

from tests.faults.kills import ends


def kill_tree(process: subprocess.Popen[bytes]) -> bool:
    """Kill a process and all that it has started, in whatever groups; return whether it was still running."""
    is_running = process.poll() is None
    tree = {process.pid} if is_running else set()
    new = set(tree)
    while new:
        # Nobody may start another one meanwhile
        for pid in new:
            _send(pid, signal.SIGSTOP)
        new = _children(tree) - tree
        tree |= new
    for pid in tree:
        _send(pid, signal.SIGKILL)
    process.wait()
    if not all(ends(pid) for pid in tree - {process.pid}):
        raise SystemExit("a process outlives its kill")
    return is_running


def _send(pid: int, number: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, number)


def _children(pids: set[int]) -> set[int]:
    """Return the processes that these have started."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            # proc(5): the parent is the second field after the name
            if int(path.read_text().rpartition(")")[2].split()[1]) in pids:
                found.add(int(path.parent.name))
    return found
