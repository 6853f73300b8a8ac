# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether Blender can draw here: EEVEE needs OpenGL, and without it the process would crash."""

from __future__ import annotations

import ctypes
import sys

import bpy

from ..errors import SSGIError

_SURFACELESS = 0x31DD  # EGL_PLATFORM_SURFACELESS_MESA, Blender's way where there is no display


def check_gl_driver() -> None:
    """Refuse to go on where Blender has no OpenGL.

    Raises
    ------
    SSGIError
        Saying what to install.
    """
    missing = missing_gl_driver()
    if missing is not None:
        raise SSGIError(
            f"EEVEE cannot render here, {missing}: install a graphics driver, or Mesa's software renderer "
            "(Debian: libegl1 libgl1-mesa-dri), or use the engine cycles."
        )


def missing_gl_driver() -> str | None:
    """Say what Blender lacks for OpenGL; None where nothing does.

    A background Blender on Linux opens its first context at its first drawing and ends with a segmentation
    fault where that fails. So the same is tried here before, through the same library. A window has its
    context already, and on other systems the driver is part of the system.
    """
    is_certain = not bpy.app.background or sys.platform in ("win32", "darwin")
    if is_certain or bpy.context.preferences.system.gpu_backend != "OPENGL":
        return None
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "there is no libEGL"
    for function in (egl.eglGetDisplay, egl.eglGetPlatformDisplay):
        function.restype = ctypes.c_void_p
    displays = (
        egl.eglGetDisplay(ctypes.c_void_p(None)),
        egl.eglGetPlatformDisplay(ctypes.c_uint(_SURFACELESS), ctypes.c_void_p(None), ctypes.c_void_p(None)),
    )
    # Displays stay initialized, for they are Blender's own: ending one would end its contexts.
    if any(display and _initializes(egl, display) for display in displays):
        return None
    return "no OpenGL driver starts"


def renderer_name() -> str:
    """Return what OpenGL draws with; software renderers say so by their name."""
    import gpu

    # Since 5.2, and in the background alone, it is not there before
    if hasattr(gpu, "init"):
        gpu.init()
    return gpu.platform.renderer_get()


def _initializes(egl: ctypes.CDLL, display: int) -> bool:
    nothing = ctypes.c_void_p(None)
    return bool(egl.eglInitialize(ctypes.c_void_p(display), nothing, nothing))
