# SPDX-License-Identifier: GPL-3.0-or-later
"""Where and by what something was measured."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

from .. import __version__
from ..core import parallel

_ROOT = Path(__file__).parents[2]


def describe_machine() -> dict[str, Any]:
    """Return the processor, the cores that this process may use, the memory and the system."""
    return {
        "cpu": _cpu_model(),
        "cores": parallel.thread_count(None),
        "memory_gb": _memory_gb(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def describe_versions() -> dict[str, str | None]:
    """Return the versions of what measures and is measured; None for what is not installed."""
    packages = {"numpy": "numpy", "numba": "numba", "blender": "bpy"}
    return {
        "ssgi": __version__,
        "commit": _commit(),
        "python": platform.python_version(),
        **{name: _package_version(package) for name, package in packages.items()},
    }


def peak_memory_since(reset: bool) -> float | None:
    """Return the largest resident size since the last reset, MB; None where the system does not tell.

    Parameters
    ----------
    reset
        Begin anew after reading.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        kilobytes = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
        if reset:
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except (OSError, StopIteration):
        return None
    return round(kilobytes / 1e3, 1)


def _cpu_model() -> str:
    """Return the processor's name; platform.processor() is empty on most Linux systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _memory_gb() -> float | None:
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return None
    return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)


def _package_version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str | None:
    """Return the commit, marked where files differ from it; None outside a repository."""
    command = ["git", "-C", str(_ROOT), "describe", "--always", "--dirty=+changes"]
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
