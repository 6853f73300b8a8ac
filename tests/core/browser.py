# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages in a browser without a window."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome")


def open_page(page: Path, profile: Path, width: int = 1280) -> str:
    """Return a page's document once its scripts have run; fail if one complained, skip without a browser.

    The window has a `width` in pixels.
    """
    browser = next(filter(None, map(shutil.which, _PROGRAMS)), None)
    if browser is None:
        pytest.skip("there is no chromium here")
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr",
        f"--user-data-dir={profile}", f"--window-size={width},900", "--dump-dom", page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "CONSOLE" not in done.stderr, done.stderr
    return done.stdout
