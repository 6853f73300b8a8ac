# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of our own: nobody waits for them, and none is left over."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from ssgi_addon.child import Child, environment, printed_error, ssgi_command
from ssgi_addon.progress import MARK, tell, understand

# Seconds after which what a test waits for counts as never coming
PATIENCE = 60.0
posix_alone = pytest.mark.skipif(os.name != "posix", reason="signals and process groups")


@pytest.fixture
def start():
    """Start a Python script as a child; none outlives the test."""
    children = []

    def begin(script, *arguments):
        children.append(Child([sys.executable, "-c", script, *map(str, arguments)], environment()))
        return children[-1]

    yield begin
    for child in children:
        child.kill()


def wait_until(is_true):
    end = time.monotonic() + PATIENCE
    while not is_true():
        assert time.monotonic() < end, "never came"
        time.sleep(0.01)


def is_alive(pid):
    """Whether a process does anything: one that ended and that nobody asked after yet does not."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_what_is_told_is_understood(capsys):
    tell(0.25, "Direct light")
    assert understand(capsys.readouterr().out) == (0.25, "Direct light")


@pytest.mark.parametrize("line", ["", "Saved: 'a.png'", f"{MARK}ing 0.5 x", "ssgi: error: no"])
def test_other_lines_are_not_understood(line):
    assert understand(line) is None


def test_child_that_says_nothing_is_not_waited_for(start):
    child = start("import time; time.sleep(600)")
    assert child.news() is None
    assert not child.has_ended()


def test_newest_progress_is_the_news_and_no_news_twice(start):
    child = start(
        "from ssgi_addon.progress import tell\ntell(0.1, 'a')\nprint('Fra:1')\ntell(0.2, 'b')\nprint('bye')"
    )
    wait_until(child.has_ended)
    assert child.news() == (0.2, "b")
    assert child.news() is None
    assert child.failure() is None


def test_output_that_is_no_text_is_read_all_the_same(start):
    child = start(f"import os; os.write(1, b'\\xff\\xfe\\n{MARK} 0.5 half\\n')")
    wait_until(child.has_ended)
    assert child.news() == (0.5, "half")


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("import sys; print('ssgi: error: no camera'); sys.exit(1)", "no camera"),
        ("import sys; print('ssgi: error: no camera\\nbye'); sys.exit(1)", "no camera"),
        ("import sys; sys.exit(3)", "it ended with exit status 3"),
        ("raise KeyError('scene')", "it ended with exit status 1; its last words: KeyError: 'scene'"),
        pytest.param(
            "import os; os.kill(os.getpid(), 11)", "it crashed (SIGSEGV)", marks=posix_alone, id="SIGSEGV"
        ),
        pytest.param(
            "import os; os.kill(os.getpid(), 9)",
            "it was killed: memory may have run out",
            marks=posix_alone,
            id="SIGKILL",
        ),
    ],
)
def test_failure_says_its_reason(start, script, reason):
    child = start(script)
    wait_until(child.has_ended)
    assert child.failure() == reason


def test_program_that_is_missing_is_an_error_at_once(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        Child([str(tmp_path / "blender")], environment())


WITH_CHILD_OF_ITS_OWN = """
import subprocess, sys
from ssgi_addon.progress import tell
own = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
tell(0.5, str(own.pid))
"""


def news_of(child):
    found = []
    wait_until(lambda: found.append(child.news()) or found[-1])
    return found[-1]


@posix_alone
def test_kill_ends_what_the_child_started_too(start):
    child = start(WITH_CHILD_OF_ITS_OWN + "own.wait()")
    own = int(news_of(child)[1])
    assert is_alive(child.pid)
    assert is_alive(own)
    child.kill()
    assert not is_alive(child.pid)
    wait_until(lambda: not is_alive(own))


@posix_alone
def test_child_has_ended_although_what_it_started_holds_its_output(start):
    child = start(WITH_CHILD_OF_ITS_OWN)
    wait_until(child.has_ended)
    assert not is_alive(int(child.news()[1]))


def test_child_may_be_killed_after_its_end_and_twice(start):
    child = start("")
    wait_until(child.has_ended)
    child.kill()
    child.kill()


@posix_alone
def test_child_ends_with_a_parent_that_is_killed(tmp_path):
    """It cleans up, and its parent's other children do not keep it alive."""
    child = f"""
import time
from pathlib import Path
from ssgi_addon.child import ended_with_parent
with ended_with_parent(lambda: Path({str(tmp_path / "clean")!r}).touch()):
    Path({str(tmp_path / "runs")!r}).touch()
    time.sleep(600)
"""
    parent = f"""
import subprocess, sys, time
from ssgi_addon.child import Child, environment
child = Child([sys.executable, "-c", {child!r}], environment())
sibling = Child([sys.executable, "-c", "import time; time.sleep(3)"], environment())
print(child.pid, flush=True)
time.sleep(600)
"""
    with subprocess.Popen(
        [sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True, env=environment()
    ) as process:
        pid = int(process.stdout.readline())
        wait_until((tmp_path / "runs").exists)
        assert is_alive(pid)
        os.kill(process.pid, signal.SIGKILL)
    wait_until(lambda: not is_alive(pid))
    assert (tmp_path / "clean").exists()


def test_child_that_ends_by_itself_does_not_clean(start, tmp_path):
    child = start(
        "import sys, threading\nfrom pathlib import Path\nfrom ssgi_addon.child import ended_with_parent\n"
        "with ended_with_parent(Path(sys.argv[1]).touch):\n    print('work')\n"
        "sys.exit(threading.active_count() - 1)",
        tmp_path / "clean",
    )
    wait_until(child.has_ended)
    assert child.failure() is None
    assert not (tmp_path / "clean").exists()


def test_command_runs_in_the_blender_that_is_named_or_in_this_python():
    assert ssgi_command("/opt/blender", "demo", options=["-noaudio"]) == [
        "/opt/blender", "-noaudio", "--command", "ssgi", "demo",
    ]  # fmt: skip
    assert ssgi_command("", "demo") == [sys.executable, "-m", "ssgi_addon", "demo"]


def test_last_printed_error_counts():
    assert printed_error(["ssgi: error: a", "b", "ssgi: error: c", "d"]) == "c"
    assert printed_error(["b"]) == ""
