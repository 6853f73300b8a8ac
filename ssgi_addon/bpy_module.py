# SPDX-License-Identifier: GPL-3.0-or-later
"""Load Blender as a Python module, or say in one line what is missing."""

from __future__ import annotations

import atexit
import importlib
import os
import re
import shutil
import sys
from typing import NoReturn

from .errors import SSGIError

# The system libraries that the bpy wheel takes from outside, and the Debian packages that hold them.
DEBIAN_PACKAGES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libICE.so.6": "libice6",
    "libSM.so.6": "libsm6",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libXxf86vm.so.1": "libxxf86vm1",
    "libgomp.so.1": "libgomp1",
    "libxkbcommon.so.0": "libxkbcommon0",
}
SERVES_PYTHON = "Python 3.13 (Blender 5.2) or 3.11 (Blender 5.0)"


def require_bpy() -> None:
    """Import `bpy`.

    Raises
    ------
    SSGIError
        If it is not installed, or a system library that it needs is missing.
    """
    try:
        importlib.import_module("bpy")
    except ModuleNotFoundError as error:
        if error.name != "bpy":
            raise
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise SSGIError(
            f"this needs Blender as a Python module: pip install 'ssgi[blender]' under {SERVES_PYTHON}; "
            f"here is Python {python} without it"
        ) from error
    except ImportError as error:
        raise SSGIError(explain_import_error(str(error))) from error


def leave(status: int) -> NoReturn:
    """End this process.

    Blender 4.5 as a module waits in its exit handlers for a thread of its own, forever, once it has opened a
    file with drivers. So it does not get to them; only its folder for temporary files goes.
    """
    bpy = sys.modules.get("bpy")
    if bpy is None or not bpy.app.module or bpy.app.version >= (5, 0):
        sys.exit(status)
    folder = bpy.app.tempdir
    atexit._run_exitfuncs()
    shutil.rmtree(folder, ignore_errors=True)
    end_at_once(status)


def end_at_once(status: int) -> NoReturn:
    """End this process without exit handlers, Python's and Blender's."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def explain_import_error(text: str) -> str:
    """Turn the loader's message about a shared library into what to install."""
    found = re.search(r"(lib[\w.+-]+\.so[.\d]*)", text)
    if found is None or "cannot open shared object" not in text:
        return f"Blender's Python module does not load: {text}"
    library = found.group(1)
    package = DEBIAN_PACKAGES.get(library)
    if package is None:
        return f"Blender needs the system library {library}: install the package that holds it"
    others = " ".join(sorted(DEBIAN_PACKAGES.values()))
    return (
        f"Blender needs the system library {library}: apt-get install {package} "
        f"(Debian's names; it may need more of {others})"
    )
