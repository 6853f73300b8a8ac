# SPDX-License-Identifier: GPL-3.0-or-later
"""What every test run needs before anything imports Blender."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import hypothesis
import numpy as np
import pytest

# Times say nothing on a shared machine, and a run that fails must fail again.
hypothesis.settings.register_profile("ssgi", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ssgi")

_resources = None


def pytest_configure(config: pytest.Config) -> None:
    """Give Blender a folder of its own: no preferences or extensions of the user come in or go out."""
    global _resources
    if "BLENDER_USER_RESOURCES" not in os.environ:
        _resources = tempfile.TemporaryDirectory(prefix="ssgi-tests-")
        os.environ["BLENDER_USER_RESOURCES"] = _resources.name


def pytest_unconfigure(config: pytest.Config) -> None:
    if _resources is not None:
        os.environ.pop("BLENDER_USER_RESOURCES", None)
        _resources.cleanup()


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in each run."""
    return np.random.default_rng(20240229)


@pytest.fixture
def read_only_folder(tmp_path: Path) -> Path:
    """A place where no file can be made, for any user: below a file."""
    (tmp_path / "file").write_text("not a folder")
    return tmp_path / "file" / "folder"
