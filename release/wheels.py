# SPDX-License-Identifier: GPL-3.0-or-later
"""The OpenEXR wheels that the extension carries: which ones, and where they come from.

Blender extracts the one that fits its Python and system when the extension is installed. numpy is Blender's
own.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import Path

# Blender's name of a system, and that of the wheels that run on it
PLATFORMS = {
    "linux-x64": "manylinux_2_28_x86_64",
    "windows-x64": "win_amd64",
    "macos-arm64": "macosx_11_0_arm64",
    "macos-x64": "macosx_10_15_x86_64",
}
# Blender 4.5 and 5.0; 5.1 and 5.2; what Linux distributions build
PYTHONS = ("3.11", "3.13", "3.14")
REQUIREMENTS = Path(__file__).with_name("wheels.txt")


class WheelError(Exception):
    """A wheel cannot be had, or is not the one that was asked for."""


def wheel_names() -> list[str]:
    """Return the file names of all wheels, system by system."""
    pinned = re.search(r"^OpenEXR==(\S+)", REQUIREMENTS.read_text(encoding="utf-8"), re.MULTILINE)
    assert pinned is not None
    tags = [f"cp{python.replace('.', '')}" for python in PYTHONS]
    return [
        f"openexr-{pinned.group(1)}-{tag}-{tag}-{platform}.whl"
        for platform in PLATFORMS.values()
        for tag in tags
    ]


def fetch_wheels(folder: Path) -> list[Path]:
    """Return all wheels, in `folder`; those that are not there yet are downloaded.

    Raises
    ------
    WheelError
        If one cannot be downloaded, or its content is not the pinned one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in wheel_names()]
    for path in paths:
        if not path.is_file():
            _download(path)
        check_hash(path)
    return paths


def check_hash(path: Path) -> None:
    """Raise `WheelError` if a wheel is not one of those that are pinned."""
    pinned = re.findall(r"--hash=sha256:([0-9a-f]{64})", REQUIREMENTS.read_text(encoding="utf-8"))
    if hashlib.sha256(path.read_bytes()).hexdigest() not in pinned:
        raise WheelError(f"{path} is not the wheel that {REQUIREMENTS.name} names: delete it and try again")


def _download(path: Path) -> None:
    python, _, platform = path.stem.split("-")[2:]
    command = [
        sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:",
        "--require-hashes", "--requirement", str(REQUIREMENTS), "--implementation", "cp",
        "--python-version", python.removeprefix("cp"), "--platform", platform, "--dest", str(path.parent),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not path.is_file():
        reason = (done.stderr.strip().splitlines() or ["pip gave another file"])[-1]
        raise WheelError(f"cannot download {path.name}: {reason}")
