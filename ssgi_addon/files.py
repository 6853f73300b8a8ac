# SPDX-License-Identifier: GPL-3.0-or-later
"""Files appear whole or not at all, and what a dead run left half-written goes."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from .errors import OutputError, SSGIError

# Folders of a job's results, relative to the folder that the user names.
RESULT_FOLDERS = ("", "frames", "passes", "reference")
# A file that nobody has written to for so long belongs to no run, on whatever machine; seconds.
_LONGEST_WRITE = 24 * 3600.0
# Seconds for which Windows may keep a file from being replaced: a virus scanner or a viewer reads it.
_LONGEST_LOCK, _LOCK_STEP = 2.0, 0.05
# What is written between the look into a folder and its end keeps it from going; so it is tried again.
_DELETIONS = 100
_MARK = "ssgi"
_count = itertools.count()
# Held while a file is written
_writing = threading.RLock()
# Seconds that a process which is about to end waits for it
_LONGEST_FILE = 10.0


@contextmanager
def replacing(path: Path, *, is_lasting: bool = True) -> Iterator[Path]:
    """Give a temporary name beside `path`; move it there when the block ends well.

    A reader, and a run that is killed at any moment, finds either the old file or the new one; after a
    loss of power, too, if it is to last. The temporary name begins with a dot and ends in ``.tmp``, so no
    listing of results picks it up.

    Raises
    ------
    OutputError
        If the folder cannot be made, or the file cannot be written or moved.
    """
    temporary = path.parent / _temporary_name()
    try:
        with _writing:
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            if is_lasting:
                _flush(temporary)
            _move(temporary, path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"cannot write {path}: {reason}; choose another place or make room there"
        ) from error
    finally:
        # After success the name is gone; after a failure nothing half-written may stay. Where the folder
        # itself is gone or locked, the message above says all there is to say.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def stop_writing() -> None:
    """Wait for the file that another thread writes, and let it begin no other; then the process must end."""
    _writing.acquire(timeout=_LONGEST_FILE)


def check_writable(folder: Path) -> None:
    """Find out before hours of work whether a folder can be written, without making it.

    Raises
    ------
    OutputError
        If it cannot.
    """
    existing = folder.absolute()
    try:
        while not existing.exists() and existing != existing.parent:
            existing = existing.parent
        if not existing.is_dir():
            raise OutputError(f"cannot write to {folder}: {existing} is not a folder; choose another place")
        probe = existing / _temporary_name()
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(
            f"cannot write to {folder}: {error.strerror or error}; choose another place"
        ) from error


def discard_unfinished(folder: Path, pid: int) -> None:
    """Delete what a process of this machine that was killed left half-written in a folder of results."""
    for path in _temporaries(folder):
        if _owner(path) == (_host(), pid):
            discard(path)


def discard_abandoned(folder: Path) -> None:
    """Delete what dead runs left half-written in a folder of results; what live ones write stays."""
    for path in _temporaries(folder):
        if _is_of_a_dead_run(path) or _is_old(path):
            discard(path)


def discard(path: Path) -> None:
    """Delete a file if it is there and can be deleted."""
    with suppress(OSError):
        path.unlink()


def discard_folder(folder: Path) -> None:
    """Delete a folder, also while another thread goes on to write into it, as far as it can be deleted."""
    for _ in range(_DELETIONS):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return


def new_folder(parent: Path) -> Path:
    """Make a folder for temporary files of this process, and delete those that dead ones left there.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    _discard_dead_folders(parent)
    return _make_folder(parent)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Give a folder among the system's temporary files; it is gone when the block ends.

    Frames take several. So what dead processes left there is looked for once in a process: there may be many
    files of others.

    Raises
    ------
    SSGIError
        If it cannot be made.
    """
    try:
        folder = _make_folder(_tidied(Path(tempfile.gettempdir())))
    except OSError as error:
        raise SSGIError(
            f"cannot make a temporary folder: {error.strerror or error}; make room there, or set TMPDIR to "
            "another folder"
        ) from error
    try:
        yield folder
    finally:
        discard_folder(folder)


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
    except (ValueError, RecursionError) as error:
        raise SSGIError(f"{path} is not a JSON file ({error}); write it again") from error


def _make_folder(parent: Path) -> Path:
    return Path(tempfile.mkdtemp(prefix=f"{_MARK}-{_host()}-{os.getpid()}-", dir=parent))


@cache
def _tidied(parent: Path) -> Path:
    """Return a folder from which this process has deleted what dead ones left."""
    _discard_dead_folders(parent)
    return parent


def _discard_dead_folders(parent: Path) -> None:
    for path in parent.glob(f"{_MARK}-*-*-*"):
        if _is_of_a_dead_run(path) and path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)


def _flush(path: Path) -> None:
    """Bring a file to the disk; some file systems tell only then that there was no room for it."""
    file = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
    try:
        os.fsync(file)
    finally:
        os.close(file)


def _move(temporary: Path, path: Path) -> None:
    """Put a file into the place of another; Windows refuses that while somebody reads the other."""
    end = time.monotonic() + (_LONGEST_LOCK if sys.platform == "win32" else 0.0)
    while True:
        try:
            os.replace(temporary, path)
        except PermissionError:
            if time.monotonic() >= end:
                raise
            time.sleep(_LOCK_STEP)
        else:
            return


def _temporary_name() -> str:
    """Return a name that no other thread, process or machine uses; it says whose it is."""
    return f".{_MARK}-{_host()}-{os.getpid()}-{next(_count)}.tmp"


def _temporaries(folder: Path) -> list[Path]:
    folders = [folder / name for name in RESULT_FOLDERS]
    return [path for place in folders for path in place.glob(f".{_MARK}-*-*-*.tmp")]


def _owner(path: Path) -> tuple[str, int] | None:
    """Return machine and process of a temporary file or folder of ours; None for others."""
    found = re.fullmatch(rf"\.?{_MARK}-([0-9a-f]{{8}})-(\d+)-\w+(\.tmp)?", path.name)
    return (found[1], int(found[2])) if found else None


@cache
def _host() -> str:
    """Return a name of this machine, or of the container that counts its processes by itself."""
    processes = ""
    with suppress(OSError):
        processes = os.readlink("/proc/self/ns/pid")
    return hashlib.blake2b(f"{platform.node()} {processes}".encode(), digest_size=4).hexdigest()


def _is_of_a_dead_run(path: Path) -> bool:
    owner = _owner(path)
    return owner is not None and owner[0] == _host() and not _is_running(owner[1])


def _is_old(path: Path) -> bool:
    """Whether nobody writes a file any more, wherever its run may be."""
    try:
        return _owner(path) is not None and time.time() - path.lstat().st_mtime > _LONGEST_WRITE
    except OSError:
        return False


def _is_running(pid: int) -> bool:
    """Whether a process of this machine runs; where the system does not tell, it counts as running."""
    if sys.platform == "win32":
        return True  # `os.kill` would end it
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True
