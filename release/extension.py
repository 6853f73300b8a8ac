# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's archives, built and validated by Blender's own tool from a copy of what ships.

The repository itself is an extension without wheels, which Blender builds and installs as it is; there its
own OpenImageIO reads and writes the files. The wheels are added to the copy's manifest alone.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MANIFEST = "blender_manifest.toml"
# All else in the repository is for those who work on it.
SHIPPED = ("__init__.py", MANIFEST, "CHANGELOG.md", "LICENSE", "README.md", "operators", "ssgi_addon")


class BuildError(Exception):
    """Blender's tool refused what it was given."""


def stage(folder: Path, wheels: Sequence[Path], platforms: Sequence[str] = ()) -> None:
    """Copy what ships to an empty `folder`, with wheels, and a manifest that lists them."""
    folder.mkdir(parents=True)
    for name in SHIPPED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, folder / name)
    names = [f"./wheels/{wheel.name}" for wheel in wheels]
    source = (ROOT / MANIFEST).read_text(encoding="utf-8")
    (folder / MANIFEST).write_text(with_lists(source, wheels=names, platforms=platforms), encoding="utf-8")
    (folder / "wheels").mkdir()
    for wheel in wheels:
        shutil.copy2(wheel, folder / "wheels")


def with_lists(manifest: str, **lists: Sequence[str]) -> str:
    """Return the text of a manifest with lists of strings as further keys; empty ones are left out."""
    known = tomllib.loads(manifest)
    block = ""
    for key, values in lists.items():
        if key in known:
            raise BuildError(f"{MANIFEST} has {key} already: the build adds them")
        if values:
            block += f"{key} = [\n" + "".join(f'  "{value}",\n' for value in values) + "]\n"
    # Keys of their own stand before the first table.
    return re.sub(r"^\[", lambda table: f"{block}\n{table.group()}", manifest, count=1, flags=re.MULTILINE)


def build(source: Path, output: Path, *, split: bool = False) -> list[Path]:
    """Build the archive of the extension in `source`, or one for each system that its manifest lists."""
    output.mkdir(parents=True, exist_ok=True)
    manifest = tomllib.loads((source / MANIFEST).read_text(encoding="utf-8"))
    stem = f"{manifest['id']}-{manifest['version']}"
    suffixes = [f"-{name.replace('-', '_')}" for name in manifest.get("platforms", ())] if split else [""]
    options = ["--split-platforms"] if split else []
    _blender_ext("build", "--source-dir", str(source), "--output-dir", str(output), *options)
    archives = [output / f"{stem}{suffix}.zip" for suffix in suffixes]
    for archive in archives:
        _blender_ext("validate", str(archive))
    return archives


def _blender_ext(*arguments: str) -> None:
    command = [sys.executable, str(_tool()), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BuildError(f"Blender's tool refuses the extension:\n{done.stdout}{done.stderr}".rstrip())


def _tool() -> Path:
    """Blender's command for extensions, which the Python module carries and which needs no Blender to run."""
    module = importlib.util.find_spec("bpy")
    for folder in (module.submodule_search_locations if module else None) or ():
        for tool in Path(folder).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"):
            return tool
    raise BuildError("Blender as a Python module is missing: run this through `make package`")
