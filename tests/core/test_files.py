# SPDX-License-Identifier: GPL-3.0-or-later
import itertools
import json
import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from ssgi_addon import files
from ssgi_addon.errors import SSGIError
from ssgi_addon.files import (
    discard_folder,
    discard_unfinished,
    read_json,
    replacing,
    write_json,
)

ROOT = Path(__file__).resolve().parents[2]


def test_file_appears_at_the_end_and_not_before(tmp_path):
    path = tmp_path / "new" / "result.exr"
    with replacing(path) as temporary:
        temporary.write_bytes(b"half")
        assert not path.exists()
        assert temporary.parent == path.parent
    assert path.read_bytes() == b"half"
    assert os.listdir(path.parent) == ["result.exr"]


def test_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "result.exr"
    path.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise ZeroDivisionError
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["result.exr"]


def test_temporary_file_is_no_result(tmp_path):
    with replacing(tmp_path / "result.exr") as temporary:
        temporary.write_bytes(b"half")
        assert not list(tmp_path.glob("*.exr"))
        assert temporary.name.startswith(".")


def test_full_disk_is_one_clear_line(tmp_path):
    with pytest.raises(SSGIError, match="No space left on device") as raised, replacing(tmp_path / "a"):
        raise OSError(28, "No space left on device")
    assert str(tmp_path / "a") in str(raised.value)
    assert os.listdir(tmp_path) == []


def test_unwritable_folder_is_one_clear_line(read_only_folder):
    with pytest.raises(SSGIError, match="cannot write"):
        write_json(read_only_folder / "report.json", {})


def test_folder_in_the_files_place_is_one_clear_line(tmp_path):
    (tmp_path / "report.json").mkdir()
    with pytest.raises(SSGIError, match="cannot write"):
        write_json(tmp_path / "report.json", {})
    assert os.listdir(tmp_path) == ["report.json"]


def test_json_reads_back(tmp_path):
    data = {"seconds": 0.1, "notes": ["Größe"], "camera": None}
    write_json(tmp_path / "a.json", data)
    assert read_json(tmp_path / "a.json") == data


def test_json_holds_no_nan(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"relmse": float("nan")})
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("text", ["", "{", "\udcff", "[" * 100000, "1" * 5000])
def test_damaged_json_is_one_clear_line(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(SSGIError, match="not a JSON file"):
        read_json(path)


def test_missing_json_is_one_clear_line(tmp_path):
    with pytest.raises(SSGIError, match="cannot read"):
        read_json(tmp_path / "a.json")


def test_report_is_valid_json_for_other_readers(tmp_path):
    write_json(tmp_path / "a.json", {"a": [1, 2.5, None, True]})
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": [1, 2.5, None, True]}


def test_what_a_killed_process_left_goes_and_nothing_else(tmp_path):
    host = files._host()
    names = [
        f".ssgi-{host}-7-0.tmp", f"passes/.ssgi-{host}-7-1.tmp", f".ssgi-{host}-77-0.tmp", "a.exr",
        f"other/.ssgi-{host}-7-2.tmp", ".ssgi-00000000-7-0.tmp", f"ssgi-{host}-7-3.tmp",
    ]  # fmt: skip
    for name in names:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    discard_unfinished(tmp_path, 7)
    left = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file())
    assert left == sorted(names[2:])
    discard_unfinished(tmp_path / "none", 7)


def test_temporary_files_are_found_by_their_process(tmp_path):
    with replacing(tmp_path / "a.exr") as temporary:
        temporary.touch()
        discard_unfinished(tmp_path, os.getpid())
        assert os.listdir(tmp_path) == []
        temporary.touch()


def test_folder_goes_while_another_thread_writes_into_it(tmp_path):
    """As where a render is ended from beside it."""
    folder = tmp_path / "render"
    (folder / "deep").mkdir(parents=True)
    begun = threading.Event()

    def write():
        with suppress(OSError):
            for number in itertools.count():
                (folder / f"{number}.tmp").touch()
                (folder / "deep" / f"{number}.tmp").touch()
                begun.set()

    writer = threading.Thread(target=write)
    writer.start()
    begun.wait()
    discard_folder(folder)
    assert not folder.exists()
    writer.join()


def test_folder_that_cannot_be_deleted_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.rmtree", lambda path, ignore_errors: None)
    discard_folder(tmp_path)
    assert tmp_path.exists()


STOPPED = """
import os, sys, threading, time
from pathlib import Path
from ssgi_addon.files import discard_unfinished, replacing, stop_writing
folder = Path(sys.argv[1])

def stop():
    time.sleep(0.2)
    stop_writing()
    discard_unfinished(folder, os.getpid())
    time.sleep(0.2)
    os._exit(0)

threading.Thread(target=stop).start()
while True:
    with replacing(folder / "a.txt") as temporary:
        temporary.write_text("half")
        time.sleep(0.001)
        temporary.write_text("whole")
"""


def test_process_that_ends_while_it_writes_leaves_whole_files_alone(tmp_path):
    """As the background render whose window is gone: another thread cleans up, and ends it."""
    for _ in range(3):
        subprocess.run([sys.executable, "-c", STOPPED, str(tmp_path)], check=True, cwd=ROOT)
        assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
        assert (tmp_path / "a.txt").read_text() == "whole"
