# SPDX-License-Identifier: GPL-3.0-or-later
"""Ordinary renders with the light switched on: the picture, its passes, and a scene that stays as it was."""

from __future__ import annotations

import sys

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import addon_utils

from ssgi_addon import panels, properties, render_panel
from ssgi_addon.blender import compat, in_render
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.cycles_passes import cycles_engine
from ssgi_addon.blender.declared_passes import OUTPUTS
from ssgi_addon.blender.in_render import _pixels_of as pixels_of
from ssgi_addon.core import Settings, composite, render_indirect
from ssgi_addon.exr import read_layers
from tests.blender.fingerprint import changes, fingerprint
from tests.scenes import build_closed_room
from tests.tolerances import COMPOSITED, SAME_LIGHT
