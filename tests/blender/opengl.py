# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that render through EEVEE need OpenGL; elsewhere they skip and say what is missing."""

from __future__ import annotations

import pytest

from ssgi_addon.blender.gl_driver import missing_gl_driver

_MISSING = missing_gl_driver()
needs_opengl = pytest.mark.skipif(_MISSING is not None, reason=f"EEVEE cannot render here: {_MISSING}")
