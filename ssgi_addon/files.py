# SPDX-License-Identifier: GPL-3.0-or-later
"""Files appear whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import SSGIError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path`; move it there when the block ends well.

    A reader, and a run that is killed at any moment, finds either the old file or the new one. The
    temporary name begins with a dot and ends in ``.tmp``, so no listing of results picks it up.

    Raises
    ------
    SSGIError
        If the folder cannot be made, or the file cannot be written or moved.
    """
    temporary = path.with_name(_temporary_name(path.name, os.getpid()))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise SSGIError(f"cannot write {path}: {reason}; choose another place or make room there") from error
    finally:
        # After success the name is gone; after a failure nothing half-written may stay. Where the folder
        # itself is gone or locked, the message above says all there is to say.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def discard_unfinished(folder: Path, pid: int) -> None:
    """Delete what a process that was killed left half-written in a folder of results, or one below it."""
    pattern = _temporary_name("*", pid)
    for path in (*folder.glob(pattern), *folder.glob(f"*/{pattern}")):
        with suppress(OSError):
            path.unlink()


def write_json(path: Path, data: Any) -> None:
    """Write `data` as indented JSON.

    Raises
    ------
    SSGIError
        If the file cannot be written.
    """
    text = json.dumps(data, indent=2, allow_nan=False) + "\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises
    ------
    SSGIError
        If the file is missing or is not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SSGIError(f"cannot read {path}: {error.strerror or error}; check the path") from error
    except ValueError as error:
        raise SSGIError(f"{path} is not a JSON file ({error}); write it again") from error


def _temporary_name(name: str, pid: int) -> str:
    return f".{name}.{pid}.tmp"
