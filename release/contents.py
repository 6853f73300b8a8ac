# SPDX-License-Identifier: GPL-3.0-or-later
"""What is in an archive of the extension, against what should be."""

from __future__ import annotations

import subprocess
import tomllib
import zipfile
from collections.abc import Iterable
from pathlib import Path

from .extension import MANIFEST, ROOT, SHIPPED
from .wheels import PLATFORMS, wheel_names

# What all wheels weigh, and half as much again; a larger archive holds something that nobody meant.
LARGEST_MB = 27.0
MB = 1e6


def files_that_ship() -> set[str]:
    """Return the paths of what has to be in an archive besides wheels: of files that git knows.

    What merely lies about is none of them. Where the repository came without git it is all that is there.
    """
    if not (ROOT / ".git").exists():
        found = [path for name in SHIPPED for path in (ROOT / name, *(ROOT / name).rglob("*"))]
        return {str(path.relative_to(ROOT)) for path in found if path.is_file() and path.suffix != ".pyc"}
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "ls-files", "-z", "--", *SHIPPED], capture_output=True, check=True, text=True
    )
    return set(filter(None, listed.stdout.split("\0")))


def problems(archive: Path, files: Iterable[str], *, has_wheels: bool) -> list[str]:
    """Return what is wrong with an archive, a line each.

    Parameters
    ----------
    archive
        The zip file.
    files
        Paths of what has to be in it besides wheels.
    has_wheels
        Whether it carries the wheels of the systems that its manifest names, all where it names none.
    """
    with zipfile.ZipFile(archive) as opened:
        names = opened.namelist()
        manifest = tomllib.loads(opened.read(MANIFEST).decode())
    # What a build for one system appends stands in place of the same keys above it.
    manifest |= manifest.get("build", {}).get("generated", {})
    tags = [PLATFORMS[name] for name in manifest.get("platforms", PLATFORMS)]
    carried = [name for name in wheel_names() if name.endswith(tuple(f"-{tag}.whl" for tag in tags))]
    expected = {f"wheels/{name}" for name in carried} if has_wheels else set()
    listed = {path.removeprefix("./") for path in manifest.get("wheels", ())}
    found = [f"{name} is in it twice" for name in sorted({name for name in names if names.count(name) > 1})]
    if listed != expected:
        found.append(f"the manifest lists other wheels: {sorted(listed ^ expected)}")
    expected |= set(files)
    found += [f"{name} is missing" for name in sorted(expected - set(names))]
    found += [f"{name} does not belong in it" for name in sorted(set(names) - expected)]
    if archive.stat().st_size > LARGEST_MB * MB:
        found.append(f"it is larger than {LARGEST_MB:.0f} MB")
    return found


def describe(archive: Path) -> str:
    """Return the size of an archive and of each of its folders, and its wheels by name."""
    lines = [f"{archive.name}: {archive.stat().st_size / MB:.2f} MB"]
    with zipfile.ZipFile(archive) as opened:
        folders: dict[str, list[int]] = {}
        for item in opened.infolist():
            folder = item.filename.rpartition("/")[0] or "."
            folders.setdefault(folder, []).append(item.compress_size)
        for folder, sizes in sorted(folders.items()):
            lines.append(f"  {folder:24} {len(sizes):4} files {sum(sizes) / MB:8.3f} MB")
        lines += [f"  {name}" for name in sorted(opened.namelist()) if name.endswith(".whl")]
    return "\n".join(lines)
