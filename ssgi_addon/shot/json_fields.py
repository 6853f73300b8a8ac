# SPDX-License-Identifier: GPL-3.0-or-later
"""Fields of JSON that others wrote: a `ValueError` names the one that is missing or of another kind."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..errors import SSGIError

# Manifests hold some kilobytes; nothing of this size is one.
_LARGEST_FILE = 8_000_000
_MOST_DIGITS = 300
_LARGEST_NUMBER = 1e300


def read_json(path: Path) -> Any:
    """Read a small JSON file whose numbers are all finite.

    Raises
    ------
    FileNotFoundError
        If there is none.
    SSGIError
        If it cannot be read, or is no such file.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise SSGIError("it is too large for a manifest: render the frame again")
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise
    except OSError as error:
        raise SSGIError(
            f"it cannot be read ({error.strerror or error}): check the file's permissions"
        ) from error
    except UnicodeDecodeError as error:
        raise SSGIError("it is damaged: not a text file; render the frame again") from error
    try:
        return json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_short)
    except (ValueError, RecursionError) as error:
        raise SSGIError(f"it is damaged: not JSON ({error}); render the frame again") from error


def _refuse(word: str) -> None:
    raise ValueError(f"the number {word}")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("a number out of range")
    return value


def _short(text: str) -> int:
    """Read a whole number; what has no end to it would not be written again."""
    if len(text) > _MOST_DIGITS:
        raise ValueError("a number out of range")
    return int(text)


def items_of(data: Mapping[str, Any], name: str, kind: type) -> list[Any]:
    """Return a list, empty where there is none."""
    found = data.get(name) or []
    if not isinstance(found, list) or not all(isinstance(item, kind) for item in found):
        raise ValueError(f"{name}: expected a list")
    return found


def number_of(data: Mapping[str, Any], name: str) -> float | None:
    """Return a number, None where there is none."""
    value = data.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > _LARGEST_NUMBER:
        raise ValueError(f"{name}: expected a number")
    return float(value)


def field_of(data: Mapping[str, Any], name: str, kind: type) -> Any:
    """Return what has to be there."""
    value = data.get(name)
    if not isinstance(value, kind):
        raise ValueError(f"{name}: missing or of another kind")
    return value


def optional_of(data: Mapping[str, Any], name: str, kind: type) -> Any:
    """Return what may be missing, or null: None then."""
    return None if data.get(name) is None else field_of(data, name, kind)


def time_of(data: Mapping[str, Any], name: str) -> datetime | None:
    """Return a moment, None where there is none; without a zone it is UTC."""
    text = optional_of(data, name, str)
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{name}: no time") from error
