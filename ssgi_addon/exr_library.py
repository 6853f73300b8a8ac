# SPDX-License-Identifier: GPL-3.0-or-later
"""Which EXR library is safe to use in this process."""

from __future__ import annotations

import ctypes
import functools
import sys


@functools.cache
def is_openexr_linked() -> bool:
    """Whether the program itself is linked to OpenEXR, as Blender for Linux is, and this Python is inside it.

    The loader then gives the OpenEXR package the program's functions in place of its own, which are of
    another version: it says "Part index (0) out of range" where it writes, and nobody promises that the two
    fit together. Blender as a Python module keeps its libraries to itself, and so do Windows and macOS.
    """
    return sys.platform == "linux" and hasattr(ctypes.CDLL(None), "exr_get_library_version")
