# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension as a user has it: built, installed and enabled, in a Blender process of its own."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULE = "bl_ext.user_default.ssgi"

# Each new process of the bpy module has to enable extensions again.
_PREAMBLE = f"""
import json, sys
from pathlib import Path
import bpy
import addon_utils
result = None
out = Path(sys.argv[1])
def enable():
    assert addon_utils.enable("{MODULE}", default_set=True) is not None
"""

_SCENE = """
def make_scene(width=16, height=9):
    \"\"\"A cube on a floor before a wall: each sees light that the others reflect.\"\"\"
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=4)
    bpy.ops.mesh.primitive_cube_add(size=1)
    bpy.ops.mesh.primitive_plane_add(size=4, location=(0, 1, 0), rotation=(1.571, 0, 0))
    bpy.ops.object.light_add(type="SUN", rotation=(0.8, 0.3, 0))
    bpy.ops.object.camera_add(location=(0, -6, 3), rotation=(1.15, 0, 0))
    scene.camera = bpy.context.object
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.compositor_device = "CPU"
    scene.ssgi.samples = 1
    return scene
"""


def blender_ext(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run Blender's own tool for extensions, which needs no executable."""
    tool = Path(bpy.utils.system_resource("SCRIPTS"), "addons_core", "bl_pkg", "cli", "blender_ext.py")
    command = [sys.executable, str(tool), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@dataclass(frozen=True)
class InstalledExtension:
    """A built extension, and the private Blender folders that it is installed in."""

    archive: Path
    resources: Path

    def run(self, script: str, out: Path, *, enable: bool = True) -> Any:
        """Run a script in a new Blender; return what it left in `result`, by way of JSON.

        The script finds `out`, `enable()` and `make_scene()`, and the extension enabled.
        """
        answer = out / "answer.json"
        answer.unlink(missing_ok=True)
        source = "\n".join(
            [
                _PREAMBLE,
                _SCENE,
                "enable()" if enable else "",
                script,
                "(out / 'answer.json').write_text(json.dumps(result))",
            ]
        )
        done = subprocess.run(
            [sys.executable, "-c", source, str(out)],
            env={**os.environ, "BLENDER_USER_RESOURCES": str(self.resources)},
            cwd=out,  # not the repository, whose ssgi_addon must not be the one that is found
            capture_output=True,
            text=True,
            check=False,
            timeout=600,
        )
        if not answer.exists():
            pytest.fail(f"the script ended with {done.returncode}\n{done.stdout}\n{done.stderr}")
        return json.loads(answer.read_text())


@pytest.fixture(name="extension", scope="session")
def installed_extension(tmp_path_factory: pytest.TempPathFactory) -> InstalledExtension:
    """Install the archive that SSGI_EXTENSION names; without it, one that is built from the repository."""
    return _install(tmp_path_factory.getbasetemp() / "extension")


@functools.cache  # a fixture that several modules import is set up once for each of them
def _install(folder: Path) -> InstalledExtension:
    folder.mkdir()
    archive = Path(os.environ.get("SSGI_EXTENSION") or _build(folder))
    installed = InstalledExtension(archive, folder / "resources")
    installed.resources.mkdir()
    script = f"""
result = list(bpy.ops.extensions.package_install_files(
    filepath={str(archive)!r}, repo="user_default", enable_on_install=True, overwrite=True))
"""
    assert installed.run(script, folder, enable=False) == ["FINISHED"]
    return installed


def _build(folder: Path) -> Path:
    built = blender_ext("build", "--source-dir", ROOT, "--output-dir", folder)
    assert built.returncode == 0, built.stdout + built.stderr
    (archive,) = folder.glob("*.zip")
    return archive
