# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture that cannot fit into memory is refused before the work."""

from __future__ import annotations

import pytest

pytest.importorskip("OpenEXR")

from ssgi_addon import memory
from ssgi_addon.cli import main
from ssgi_addon.errors import SSGIError
from ssgi_addon.memory import APPLY_BYTES, check_memory, memory_limit
from tests.faults.fuzz_cli import HEIGHT, WIDTH, make_good_files


def test_picture_that_cannot_fit_is_refused_with_what_it_needs(monkeypatch):
    monkeypatch.setattr(memory, "memory_limit", lambda: 8 << 30)
    check_memory((1920, 1080), APPLY_BYTES)
    with pytest.raises(SSGIError, match=r"8192 x 4096 pixels need about 2.* GB of memory, .* 8\.6 GB"):
        check_memory((8192, 4096), APPLY_BYTES)


def test_nothing_is_refused_where_the_system_tells_no_limit(monkeypatch):
    monkeypatch.setattr(memory, "memory_limit", lambda: None)
    check_memory((65536, 65536), APPLY_BYTES)


def test_limit_is_that_of_machine_container_and_process(monkeypatch, tmp_path):
    assert memory_limit() is None or memory_limit() > 1 << 28
    monkeypatch.setattr(memory, "_CGROUP_LIMIT", tmp_path / "memory.max")
    unlimited = memory_limit()
    (tmp_path / "memory.max").write_text("max\n")
    assert memory_limit() == unlimited
    (tmp_path / "memory.max").write_text("1000000\n")
    assert memory_limit() == 1000000


def test_apply_refuses_before_it_reads_the_pixels(monkeypatch, tmp_path, capfd):
    make_good_files(tmp_path)
    monkeypatch.setattr(memory, "memory_limit", lambda: WIDTH * HEIGHT * APPLY_BYTES - 1)
    line = ["apply", str(tmp_path / "own" / "a_0001.exr"), "--output", str(tmp_path / "b.exr")]
    assert main(line) == 1
    assert f"{WIDTH} x {HEIGHT} pixels need about" in capfd.readouterr().err
    assert not (tmp_path / "b.exr").exists()
