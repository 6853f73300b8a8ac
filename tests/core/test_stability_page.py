# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/stability.md: every test that it names is there, every case has one, its numbers are as stored."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

from benchmarks.stability import table
from ssgi_addon.files import read_json
from tests.core.settings_pages import text_of

ROOT = Path(__file__).resolve().parents[2]
TEXT = text_of("stability.md")
CASES = range(1, 28)
NAMED = re.findall(r"`((?:core|blender)/test_\w+\.py)::(test_\w+)`", TEXT)


@functools.cache
def names_in(path: str) -> set[str]:
    tree = ast.parse((ROOT / "tests" / path).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize(("path", "name"), sorted(set(NAMED)))
def test_named_test_exists(path, name):
    assert name in names_in(path)


@pytest.mark.parametrize("case", CASES)
def test_every_case_has_tests(case):
    rows = [line for line in TEXT.splitlines() if line.startswith(f"| {case}. ")]
    assert len(rows) == 1
    assert "::test_" in rows[0]


def test_table_of_precision_is_the_stored_result():
    results = read_json(ROOT / "benchmarks" / "results" / "stability.json")["results"]
    assert table(results) in TEXT
