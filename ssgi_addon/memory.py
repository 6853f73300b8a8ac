# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a picture fits into memory, found out before hours of work."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from .errors import SSGIError

# Resident bytes that a pixel of the frame takes at most, beside what the process starts with (measured; see
# docs/stability_faults.md). What is captured beyond the frame has a size of its own.
APPLY_BYTES, RENDER_BYTES = 400, 750
_CGROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")


def check_memory(size: tuple[int, int], bytes_per_pixel: int) -> None:
    """Refuse a picture that cannot fit.

    What others use meanwhile does not count: they may end, and the system may put them aside.

    Parameters
    ----------
    size
        Width and height, pixels.
    bytes_per_pixel
        `APPLY_BYTES` or `RENDER_BYTES`.

    Raises
    ------
    SSGIError
        If it needs more than this process can ever get.
    """
    needed, limit = size[0] * size[1] * bytes_per_pixel, memory_limit()
    if limit is not None and needed > limit:
        raise SSGIError(
            f"{size[0]} x {size[1]} pixels need about {needed / 1e9:.1f} GB of memory, and this machine "
            f"gives {limit / 1e9:.1f} GB: render at a lower resolution"
        )


def memory_limit() -> int | None:
    """Return the most bytes that this process can get; None where the system does not tell.

    That is the machine's memory with what it swaps out, or less where a container or a limit says so.
    """
    return min(_limits(), default=None)


def _limits() -> Iterator[int]:
    with suppress(AttributeError, OSError, ValueError):
        yield os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") + _swap()
    with suppress(OSError, ValueError):  # the file says "max" where there is none
        yield int(_CGROUP_LIMIT.read_text())
    if sys.platform != "win32":
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            yield limit


def _swap() -> int:
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        return int(next(line for line in lines if line.startswith("SwapTotal")).split()[1]) << 10
    return 0
