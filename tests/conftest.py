# SPDX-License-Identifier: GPL-3.0-or-later
"""What every test run needs before anything imports Blender."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import hypothesis
import numpy as np
import pytest

# Times say nothing on a shared machine, and a run that fails must fail again.
hypothesis.settings.register_profile("ssgi", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ssgi")

_EXIT_STATUS = pytest.StashKey[int]()
_resources = None


def pytest_configure(config: pytest.Config) -> None:
    """Give Blender a folder of its own: no preferences or extensions of the user come in or go out."""
    global _resources
    if "BLENDER_USER_RESOURCES" not in os.environ:
        _resources = tempfile.TemporaryDirectory(prefix="ssgi-tests-")
        os.environ["BLENDER_USER_RESOURCES"] = _resources.name


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[_EXIT_STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    if _resources is not None:
        os.environ.pop("BLENDER_USER_RESOURCES", None)
        _resources.cleanup()
    # Blender shuts down when Python frees its module. Property tests leave references to it behind, and then
    # Blender 4.5 waits in its exit handlers for a thread of its own, forever.
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.version < (5, 0):
        config.get_terminal_writer().flush()
        os._exit(config.stash.get(_EXIT_STATUS, 0))


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in each run."""
    return np.random.default_rng(20240229)


@pytest.fixture
def read_only_folder(tmp_path: Path) -> Path:
    """A place where no file can be made, for any user: below a file."""
    (tmp_path / "file").write_text("not a folder")
    return tmp_path / "file" / "folder"
