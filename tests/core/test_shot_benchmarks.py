# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks of shots: the model's arithmetic, the reading of traces, the page that tells what was found."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.shot_model import (
    Cost,
    ShotParts,
    fitted,
    frames_seconds,
    shot_cost,
    shot_seconds,
    storage_rate,
    tasks_cost,
    workers_of_link,
)
from benchmarks.shot_storage import Use
from benchmarks.shot_tables import TABLES, results_of
from tests.budget import examples
from tests.core.settings_pages import text_of

# A task starts for 6 s and reads 8 MB; a frame takes 2 s and writes 3 MB.
PARTS = ShotParts(
    prepare=Cost(20.0, 8e6, 1e6, 30.0),
    task=Cost(6.0, 8e6, 0.0, 25.0),
    frame=Cost(2.0, 0.0, 3e6, 15.0),
    merge=Cost(1.0, 0.0, 1e5, 10.0),
    merged_frame=Cost(0.5, 4e5, 1e4, 5.0),
)


def test_shot_is_the_sum_of_its_parts():
    """Ten frames in chunks of four are three tasks."""
    whole = shot_cost(PARTS, frames=10, chunk=4)
    assert whole == Cost(20 + 3 * 6 + 10 * 2 + 1 + 5, 8e6 + 24e6 + 4e6, 1e6 + 30e6 + 2e5, 30 + 75 + 150 + 60)


def test_two_tasks_tell_what_a_task_and_a_frame_take():
    few, many = (tasks_cost(PARTS, frames, chunk=frames) for frames in (1, 3))
    assert fitted(few, 1, many, 3) == (PARTS.task, PARTS.frame)


@pytest.mark.parametrize(
    ("frames", "chunk", "workers", "seconds"),
    [(8, 4, 1, 2 * 14), (8, 4, 2, 14), (12, 4, 2, 2 * 14), (3, 4, 5, 6 + 3 * 2), (3, 1, 1, 3 * 8)],
)
def test_queue_gives_each_worker_whole_chunks(frames, chunk, workers, seconds):
    assert frames_seconds(PARTS, frames, chunk, workers) == seconds


@given(st.integers(1, 300), st.integers(1, 20), st.integers(1, 50))
@examples(100)
def test_more_workers_are_never_slower_nor_faster_than_their_number(frames, chunk, workers):
    one, all_ = (frames_seconds(PARTS, frames, chunk, count) for count in (1, workers))
    assert one / workers <= all_ <= one


def test_no_number_of_workers_shortens_the_first_step_and_the_last():
    assert shot_seconds(PARTS, 100, 1, workers=10**6) == 20 + 1 + 50 + 8


def test_rate_is_that_of_the_tasks():
    """A task of two frames takes ten seconds, reads 8 MB and writes 6 MB."""
    assert storage_rate(PARTS, chunk=2, workers=10) == Cost(1.0, 8e6, 6e6, 55.0)


def test_link_is_full_where_its_busier_direction_is():
    assert workers_of_link(PARTS, chunk=2, bytes_per_second=8e6) == 10
    assert workers_of_link(PARTS, chunk=12, bytes_per_second=12e6) == 10


TRACE = """\
7 openat(AT_FDCWD</work>, "{0}/a.blend", O_RDONLY) = 3<{0}/a.blend>
7 read(3<{0}/a.blend>, ""..., 4) = 4
7 mmap(NULL, 6, PROT_READ, MAP_PRIVATE, 3<{0}/a.blend>, 0) = 0x7f7354800000
7 openat(AT_FDCWD</work>, "{0}/none", O_RDONLY) = -1 ENOENT (No such file or directory)
7 openat(AT_FDCWD</work>, "/usr/lib/libc.so", O_RDONLY) = 3</usr/lib/libc.so>
8 writev(4<{0}/b.exr>, [{{iov_base=""..., iov_len=3}}], 1 <unfinished ...>
7 read(3</usr/lib/libc.so>, ""..., 832) = 832
8 <... writev resumed>) = 3
8 fsync(4<{0}/b.exr>) = 0
8 rename("{0}/b.tmp", "{0}/b.exr") = 0
"""


def test_trace_tells_what_a_process_did_with_a_folder(tmp_path):
    (tmp_path / "a.blend").write_bytes(b"0123456789")
    use = Use.of(TRACE.format(tmp_path).splitlines(), tmp_path)
    assert use == Use(
        opened=1, in_vain=1, other=1, flushed=1, asked=10, written=3,
        files={str(tmp_path / "a.blend"): 10}, elsewhere=1,
    )  # fmt: skip
    assert use.cost == Cost(0.0, 10, 3, 2)


@pytest.mark.parametrize("table", TABLES)
def test_page_tells_what_is_stored(table):
    assert TABLES[table]() in text_of("farms.md")


def test_no_stop_left_a_fault():
    results = results_of("kills")
    assert results["same_by_one_process"] == results["pictures"]
    assert [found["faults"] for found in (results["kills"], results["full_disk"])] == [[], []]
