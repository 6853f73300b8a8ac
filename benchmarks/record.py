# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of benchmarks as JSON files that say where and by what they were measured."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ssgi_addon.bench.machine import describe_machine, describe_versions
from ssgi_addon.files import write_json


def store(path: Path, parameters: Mapping[str, Any], results: Any) -> None:
    """Write results with machine, versions and date.

    Parameters
    ----------
    path
        The JSON file.
    parameters
        What was asked for.
    results
        What was measured: numbers, texts, lists and mappings.

    Raises
    ------
    SSGIError
        If the file cannot be written.
    """
    record = {
        "benchmark": Path(sys.argv[0]).stem,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": describe_machine(),
        "versions": describe_versions(),
        "parameters": dict(parameters),
        "results": results,
    }
    write_json(path, record)
    print(f"stored in {path}")
