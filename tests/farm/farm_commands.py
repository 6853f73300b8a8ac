# SPDX-License-Identifier: GPL-3.0-or-later
"""What tests of the farm files share: the command line of Open Job Description, and our own parser."""

from __future__ import annotations

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from ssgi_addon.cli import build_parser

ROOT = Path(__file__).resolve().parents[2]
TEMPLATE = ROOT / "farm" / "ssgi.template.yaml"

needs_openjd = pytest.mark.skipif(
    importlib.util.find_spec("openjd") is None, reason="the template's tests need pip install openjd-cli"
)
needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="the template's scripts need bash")


def start_openjd(*words: str | Path) -> subprocess.Popen[str]:
    """Start the command line of Open Job Description; what it starts finds this checkout's package."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.Popen(
        [sys.executable, "-m", "openjd", *map(str, words)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def openjd(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run it to its end."""
    process = start_openjd(*words)
    out, err = process.communicate()
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def parameters(values: Mapping[str, object]) -> list[str]:
    """Return the words that give a job these parameters."""
    return [word for name, value in values.items() for word in ("-p", f"{name}={value}")]


def parsed(words: Sequence[str], *, inside_blender: bool) -> argparse.Namespace:
    """Return what our own parser makes of a command; the test fails where it refuses it."""
    try:
        return build_parser(inside_blender=inside_blender).parse_args(words)
    except SystemExit:
        pytest.fail(f"the parser refuses {words}")


def ssgi_words(words: Sequence[str]) -> tuple[list[str], bool]:
    """Return the words of the ssgi command that a program is started with, and whether that is Blender."""
    words = list(words)
    if words[:2] == ["-m", "ssgi_addon"]:
        return words[2:], False
    place = words.index("--command")
    assert words[place + 1] == "ssgi"
    return words[place + 2 :], True
