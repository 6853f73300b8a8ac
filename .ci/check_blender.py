# SPDX-License-Identifier: GPL-3.0-or-later
"""Load Blender's Python module once, and say in one line what is missing."""

import sys

from ssgi_addon.bpy_module import require_bpy
from ssgi_addon.errors import SSGIError

try:
    require_bpy()
except SSGIError as error:
    sys.exit(f"ssgi: error: {error}")
