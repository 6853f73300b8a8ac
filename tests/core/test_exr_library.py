# SPDX-License-Identifier: GPL-3.0-or-later
"""The OpenEXR package and a program that is linked to OpenEXR keep out of each other's way."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ssgi_addon import exr
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr_library import is_openexr_linked

OpenEXR = pytest.importorskip("OpenEXR")
ROOT = Path(__file__).resolve().parents[2]


def test_python_is_not_linked_to_openexr():
    assert not is_openexr_linked()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere libraries keep to themselves")
def test_functions_that_the_process_shares_are_found():
    script = """
import ctypes, sys
ctypes.CDLL(sys.argv[1], mode=ctypes.RTLD_GLOBAL)  # as a program that is linked to it
from ssgi_addon.exr_library import is_openexr_linked
sys.exit(0 if is_openexr_linked() else 3)
"""
    done = subprocess.run([sys.executable, "-c", script, OpenEXR.__file__], cwd=ROOT, check=False)
    assert done.returncode == 0


def test_linked_program_reads_by_its_own_library(monkeypatch):
    monkeypatch.setattr(exr, "is_openexr_linked", lambda: True)
    monkeypatch.setattr(exr, "_openimageio", lambda: object())
    assert exr._openexr() is None


def test_linked_program_without_one_takes_the_package(monkeypatch):
    def missing():
        raise SSGIError("nothing here")

    monkeypatch.setattr(exr, "is_openexr_linked", lambda: True)
    monkeypatch.setattr(exr, "_openimageio", missing)
    assert exr._openexr() is OpenEXR
