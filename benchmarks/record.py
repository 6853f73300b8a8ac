# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of benchmarks as JSON files that say where and by what they were measured."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from ssgi_addon import __version__
from ssgi_addon.core import parallel
from ssgi_addon.files import write_json

_ROOT = Path(__file__).parents[1]


def store(path: Path, parameters: Mapping[str, Any], results: Any) -> None:
    """Write results with machine, versions and date.

    Parameters
    ----------
    path
        The JSON file.
    parameters
        What was asked for.
    results
        What was measured: numbers, texts, lists and mappings.

    Raises
    ------
    SSGIError
        If the file cannot be written.
    """
    record = {
        "benchmark": Path(sys.argv[0]).stem,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": _machine(),
        "versions": _versions(),
        "parameters": dict(parameters),
        "results": results,
    }
    write_json(path, record)
    print(f"stored in {path}")


def _machine() -> dict[str, Any]:
    return {
        "cpu": _cpu_model(),
        "cores": parallel.thread_count(None),
        "memory_gb": _memory_gb(),
        "system": f"{platform.system()} {platform.machine()}",
    }


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


def _versions() -> dict[str, str | None]:
    packages = {"numpy": "numpy", "numba": "numba", "blender": "bpy"}
    return {
        "ssgi": __version__,
        "commit": _commit(),
        "python": platform.python_version(),
        **{name: _package_version(package) for name, package in packages.items()},
    }


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
