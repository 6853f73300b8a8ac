# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory does not grow with frames, nor with switching the extension on and off."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.child import environment
from tests import budget
from tests.blender.extension_fixtures import installed_extension  # noqa: F401  (a fixture)
from tests.tolerances import GROWTH_OF_A_SHORT_RUN, MEMORY_GROWTH

ROOT = Path(__file__).resolve().parents[2]
STRESS = budget.times() > 1
FRAMES, WARM = (200, 20) if STRESS else (40, 20)
linux_alone = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="reads memory as Linux tells it"
)


@linux_alone
@pytest.mark.property
def test_memory_does_not_grow_with_frames():
    command = [sys.executable, "-m", "benchmarks.long_run", "--case", "job", "--frames", str(FRAMES)]
    done = subprocess.run(command, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    resident = json.loads(done.stdout.splitlines()[-1])
    assert len(resident) == FRAMES
    assert resident[-1] <= resident[WARM - 1] * (1.0 + (MEMORY_GROWTH if STRESS else GROWTH_OF_A_SHORT_RUN))


@linux_alone
def test_memory_does_not_grow_with_switching_the_extension_on_and_off(extension, tmp_path):
    script = """
import gc, resource
def resident():
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1])
result = []
for _ in range(50):
    addon_utils.disable("bl_ext.user_default.ssgi", default_set=True)
    enable()
    result.append(resident())
"""
    resident = extension.run(script, tmp_path)
    assert resident[-1] <= resident[WARM - 1] * (1.0 + MEMORY_GROWTH)
