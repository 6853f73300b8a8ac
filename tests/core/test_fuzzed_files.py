# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged files end in a result or in one clear line; never in a crash, nor in memory out of proportion."""

from __future__ import annotations

import pytest

pytest.importorskip("OpenEXR")

from tests import budget
from tests.faults.fuzz_cli import run_cases

CASES = 250 * budget.times()


@pytest.mark.property
def test_damaged_files_end_in_a_result_or_in_one_clear_line(tmp_path):
    """Through `apply` and `compare`, EXR and JSON.

    Exit code 0 or 1, no traceback, no chatter of libraries, inputs unchanged, no half-written output, and no
    allocation out of proportion to the file.
    """
    outcome = run_cases(tmp_path, 0, CASES)
    assert not outcome.faults, next(iter(outcome.faults.values()))
    assert sum(outcome.ended.values()) == CASES
    # Else the cases would all damage the same thing
    assert min(outcome.ended["result"], outcome.ended["error"]) > CASES // 20, outcome.ended
