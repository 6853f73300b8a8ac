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

from tests import budget

# Times say nothing on a shared machine, and a run that fails must fail again.
hypothesis.settings.register_profile("ssgi", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ssgi")
# Tests without a budget of their own.
_EXAMPLES = 100

_EXIT_STATUS = pytest.StashKey[int]()
_resources = None


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--stress",
        type=int,
        default=1,
        metavar="TIMES",
        help="try so many times the examples of property tests, and other ones in each run",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "property: tries many examples, and more with --stress")
    times = config.getoption("--stress")
    if times > 1:
        # A failure prints how to repeat it
        hypothesis.settings.register_profile(
            "stress", deadline=None, max_examples=_EXAMPLES * times, print_blob=True,
            suppress_health_check=[hypothesis.HealthCheck.too_slow],
        )  # fmt: skip
        hypothesis.settings.load_profile("stress")
        # A failure's inputs may be long
        config.addinivalue_line("filterwarnings", "ignore::hypothesis.errors.HypothesisWarning")
        budget.multiply(times)
    _give_blender_a_folder()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if hypothesis.is_hypothesis_test(getattr(item, "obj", None)):
            item.add_marker(pytest.mark.property)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if config.getoption("--stress") > 1:
        tried = budget.tried
        terminalreporter.write_line(f"{sum(tried.values()):,} examples tried in {len(tried)} property tests")
        for name, count in sorted(tried.items()):
            terminalreporter.write_line(f"{count:9,}  {name}")


def _give_blender_a_folder() -> None:
    """No preferences or extensions of the user come in or go out."""
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
