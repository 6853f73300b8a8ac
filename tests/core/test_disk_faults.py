# SPDX-License-Identifier: GPL-3.0-or-later
"""Full disks, locked disks and files, several runs at once: a file is whole or as it was."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("OpenEXR")

from ssgi_addon import files
from ssgi_addon.child import environment
from ssgi_addon.cli import main
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers, write_layers
from ssgi_addon.files import check_writable, replacing, write_json
from ssgi_addon.png import write_png
from tests.faults.fuzz_cli import make_good_files

ROOT = Path(__file__).resolve().parents[2]
posix_alone = pytest.mark.skipif(os.name != "posix", reason="limits and mounts of POSIX")


def write_exr(path, value):
    noise = np.random.default_rng(value).uniform(0, 1, (40, 50, 3)).astype(np.float32)
    write_layers(path, {"combined": noise})


def write_small_exr(path, value):
    write_layers(path, {"combined": np.full((3, 4, 3), value, np.float32)})


def write_picture(path, value):
    noise = np.random.default_rng(value).integers(0, 255, (80, 90, 3)).astype(np.uint8)
    write_png(path, noise)


def write_report(path, value):
    write_json(path, {"frames": [value] * 3000})


def error_of(function, *arguments):
    """Return what a function says that it cannot do; empty where it can."""
    try:
        function(*arguments)
    except SSGIError as error:
        return str(error)
    return ""


WRITERS = [write_exr, write_small_exr, write_picture, write_report]


@pytest.fixture
def small_disk(tmp_path):
    """A disk of one megabyte; only who may mount one has it."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    try:
        done = subprocess.run(mount, capture_output=True, check=False)
    except OSError:
        pytest.skip("there is no mount")
    if done.returncode:
        pytest.skip("this user may not mount a disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def leave_room(disk, count):
    """Fill a disk up to so many bytes."""
    filler = disk / "filler"
    free = os.statvfs(disk)
    filler.write_bytes(bytes(max(0, free.f_bavail * free.f_frsize - count)))


@posix_alone
@pytest.mark.parametrize("write", WRITERS)
def test_full_disk_leaves_the_old_file_or_the_new_one(small_disk, tmp_path, write):
    """Wherever in the file the room ends, at its very end too, which the EXR library keeps to itself."""
    for value in (1, 2):
        write(tmp_path / str(value), value)
    old, new = ((tmp_path / str(value)).read_bytes() for value in (1, 2))
    path, failures = small_disk / "result", 0
    page = os.statvfs(small_disk).f_frsize
    for room in range(0, len(new) + 3 * page, page):
        path.write_bytes(old)
        leave_room(small_disk, room)
        reason = error_of(write, path, 2)
        failures += bool(reason)
        assert ("cannot write" in reason) == bool(reason)
        assert path.read_bytes() == (old if reason else new)
        assert sorted(os.listdir(small_disk)) == ["filler", "result"]
        (small_disk / "filler").unlink()
    assert failures >= len(new) // page


LIMITED = """
import resource, signal, sys
from pathlib import Path
from ssgi_addon.errors import SSGIError
from tests.core import test_disk_faults
write, path, new = getattr(test_disk_faults, sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]).read_bytes()
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
old, failures = path.read_bytes(), 0
_, most = resource.getrlimit(resource.RLIMIT_FSIZE)
for limit in range(0, len(new) + 64, max(1, len(new) // 40)):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    try:
        write(path, 2)
    except SSGIError as error:
        failures += 1
        assert path.read_bytes() == old, (limit, error)
    else:
        assert path.read_bytes() == new, limit
    assert [other.name for other in path.parent.iterdir()] == [path.name]
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    path.write_bytes(old)
assert failures > 20, failures
"""


@posix_alone
@pytest.mark.parametrize("write", WRITERS)
def test_file_that_may_not_grow_is_whole_or_as_it_was(tmp_path, write):
    """A limit on the size of files, in many steps through the file."""
    path = tmp_path / "folder" / "result"
    write(path, 1)
    write(tmp_path / "new", 2)
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, write.__name__, path, tmp_path / "new"],
        cwd=ROOT, env=environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


@posix_alone
def test_disk_that_cannot_be_written_is_found_out_before_the_work(small_disk, tmp_path, capfd):
    make_good_files(tmp_path / "good")
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    passes = tmp_path / "good" / "own" / "a_0001.exr"
    assert main(["apply", str(passes), "--output", str(small_disk / "new" / "a.exr")]) == 1
    line = capfd.readouterr().err
    assert line.startswith("ssgi: error: cannot write to")
    assert "Read-only file system; choose another place" in line


def test_full_disk_is_one_clear_line_of_apply(small_disk, tmp_path, capfd):
    make_good_files(tmp_path / "good")
    leave_room(small_disk, 0)
    passes = tmp_path / "good" / "own" / "a_0001.exr"
    assert main(["apply", str(passes), "--output", str(small_disk / "a.exr"), "--rays", "1"]) == 1
    errors = [line for line in capfd.readouterr().err.splitlines() if line.startswith("ssgi: error: ")]
    assert len(errors) == 1
    assert "choose another place or make room there" in errors[0]
    assert os.listdir(small_disk) == ["filler"]


# --- Files that others hold -------------------------------------------------------------------------------


@pytest.fixture
def locked_times(monkeypatch):
    """Refuse to replace files so many times, as Windows does while somebody reads them."""
    left = [0]
    original = os.replace

    def replace(source, target):
        if left[0]:
            left[0] -= 1
            raise PermissionError(13, "Permission denied")
        original(source, target)

    monkeypatch.setattr(files.os, "replace", replace)
    monkeypatch.setattr(files.sys, "platform", "win32")
    return left


def test_file_that_is_held_for_a_moment_is_replaced_after_it(tmp_path, locked_times):
    locked_times[0] = 3
    write_json(tmp_path / "report.json", {})
    assert os.listdir(tmp_path) == ["report.json"]


def test_file_that_stays_locked_stays_as_it_was(tmp_path, locked_times, monkeypatch):
    monkeypatch.setattr(files, "_LONGEST_LOCK", 0.1)
    (tmp_path / "report.json").write_text("old")
    locked_times[0] = 1000
    with pytest.raises(SSGIError, match="cannot write .*Permission denied"):
        write_json(tmp_path / "report.json", {})
    assert (tmp_path / "report.json").read_text() == "old"
    assert os.listdir(tmp_path) == ["report.json"]


# --- Two runs at once -------------------------------------------------------------------------------------

WRITER = """
import sys
from pathlib import Path
import numpy as np
from ssgi_addon.exr import write_layers
from ssgi_addon.files import check_writable
path, value = Path(sys.argv[1]), int(sys.argv[2])
for _ in range(40):
    check_writable(path.parent)
    write_layers(path, {"combined": np.full((64, 64, 3), value, np.float32)})
"""


def test_reader_beside_two_writers_sees_whole_files_alone(tmp_path):
    path = tmp_path / "folder" / "result.exr"
    write_layers(path, {"combined": np.zeros((64, 64, 3), np.float32)})
    command = [sys.executable, "-c", WRITER, str(path)]
    writers = [subprocess.Popen([*command, str(value)], env=environment()) for value in (1, 2)]
    seen = set()
    while any(writer.poll() is None for writer in writers):
        found = read_layers(path)["combined"]
        assert (found == found[0, 0, 0]).all()
        seen.add(float(found[0, 0, 0]))
    assert [writer.returncode for writer in writers] == [0, 0]
    assert os.listdir(path.parent) == ["result.exr"]
    assert seen & {1.0, 2.0}


def test_threads_that_write_one_file_do_not_meet(tmp_path):
    failures = []

    def work(value):
        try:
            for _ in range(30):
                check_writable(tmp_path)
                write_json(tmp_path / "report.json", [value] * 1000)
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=work, args=(value,)) for value in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    assert os.listdir(tmp_path) == ["report.json"]
    assert len(set(files.read_json(tmp_path / "report.json"))) == 1


# --- What dead runs leave ---------------------------------------------------------------------------------

KILLED = """
import os, sys
from pathlib import Path
from ssgi_addon.files import replacing, scratch_folder
with scratch_folder() as folder, replacing(Path(sys.argv[1]) / "passes" / "a.exr") as temporary:
    temporary.write_bytes(b"half")
    (folder / "half").touch()
    print("ready", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def runs(tmp_path):
    """Start processes that hold a half-written file and a temporary folder."""
    started = []

    def start():
        variables = environment(TMPDIR=str(tmp_path / "temporary"))
        started.append(
            subprocess.Popen(
                [sys.executable, "-c", KILLED, str(tmp_path / "results")],
                env=variables,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        assert started[-1].stdout.readline() == "ready\n"
        return started[-1]

    (tmp_path / "temporary").mkdir()
    yield start
    for process in started:
        process.kill()
        process.communicate()


@posix_alone
def test_next_run_deletes_what_a_killed_one_left_and_nothing_of_a_live_one(runs, tmp_path, monkeypatch):
    dead, live = runs(), runs()
    dead.kill()
    dead.wait()
    results, temporary = tmp_path / "results", tmp_path / "temporary"
    (results / "passes" / ".ssgi-notes.tmp").write_text("a user's own")
    monkeypatch.setattr(files.tempfile, "gettempdir", lambda: str(temporary))
    files.discard_abandoned(results)
    with files.scratch_folder():
        pass
    left = [path.name for path in (*(results / "passes").iterdir(), *temporary.iterdir())]
    assert len(left) == 3
    assert all(f"-{live.pid}-" in name for name in left if name != ".ssgi-notes.tmp")


def test_file_of_another_machine_goes_only_when_it_is_old(tmp_path):
    fresh, old = tmp_path / ".ssgi-00000000-1-0.tmp", tmp_path / ".ssgi-00000000-1-1.tmp"
    for path in (fresh, old):
        path.touch()
    os.utime(old, (0, 0))
    files.discard_abandoned(tmp_path)
    assert os.listdir(tmp_path) == [fresh.name]


@posix_alone
def test_folder_that_only_looks_like_one_of_ours_stays(tmp_path):
    """A link by the name of a dead run's folder leads to somebody's files."""
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").touch()
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    link = tmp_path / f"ssgi-{files._host()}-{dead.pid}-abcdefgh"
    link.symlink_to(tmp_path / "precious")
    files.new_folder(tmp_path)
    assert link.is_symlink()
    assert (tmp_path / "precious" / "file").exists()


def test_replaced_file_is_on_the_disk_before_its_name(tmp_path, monkeypatch):
    """Else a loss of power could leave the new name with nothing in it."""
    done = []
    monkeypatch.setattr(files.os, "fsync", lambda file: done.append("content"))
    move = files.os.replace
    monkeypatch.setattr(files.os, "replace", lambda a, b: (done.append("name"), move(a, b)))
    with replacing(tmp_path / "a") as temporary:
        temporary.touch()
    assert done == ["content", "name"]


# --- Memory runs out --------------------------------------------------------------------------------------

SHORT_OF_MEMORY = """
import resource, sys
import numpy as np
from pathlib import Path
from ssgi_addon.cli import main
from tests.faults.fuzz_cli import large_passes
path = large_passes(Path(sys.argv[1]))
# Once at first, so that everything is loaded
main(["apply", str(path), "--output", str(path.with_name("first.exr"))])
taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (taken + (int(sys.argv[2]) << 20), -1))
print("limited", file=sys.stderr, flush=True)
sys.exit(main(["apply", str(path), "--output", str(path.with_name("second.exr"))]))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of Linux")
@pytest.mark.parametrize("megabytes", [1, 24])
def test_too_little_memory_is_one_clear_line(tmp_path, megabytes):
    done = subprocess.run(
        [sys.executable, "-c", SHORT_OF_MEMORY, str(tmp_path), str(megabytes)],
        cwd=ROOT, env=environment(MALLOC_TRIM_THRESHOLD_="0"), capture_output=True, text=True, check=False,
    )  # fmt: skip
    said = done.stderr.partition("limited\n")[2].splitlines()
    errors = [line for line in said if not line[:4].strip().endswith("%")]
    assert done.returncode == 1, done.stderr
    assert len(errors) == 1, done.stderr
    assert "memory" in errors[0]
    assert "second.exr" not in os.listdir(tmp_path / "passes")
