# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on chunks of pixels by threads; numpy releases the interpreter lock inside its loops."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TypeVar

import numpy as np

from .types import IntArray

# Rays that are traced at a time: enough that the last ones, which cost calls, are few; some 75 bytes each.
RAYS_AT_ONCE = 1_048_576
# Rays of a task that draws or shades them.
RAYS_PER_TASK = 65536

Chunk = TypeVar("Chunk")
Progress = Callable[[float, str], None]
Advance = Callable[[float], None]


def thread_count(threads: int | None) -> int:
    """Return `threads`, or the number of cores this process may use."""
    if threads is not None:
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def split(items: IntArray, per_chunk: int) -> list[IntArray]:
    """Cut a list of pixels into chunks whose sizes do not depend on the number of threads."""
    return [items[begin : begin + per_chunk] for begin in range(0, items.shape[0], per_chunk)]


def saturating() -> np.errstate:
    """Let numbers beyond the range of their type become the nearest thing to them, without a word.

    Whatever the caller has numpy do about that. What ends in no number at all is an error of ours, and told.
    """
    return np.errstate(over="ignore", under="ignore")


def run_chunks(
    work: Callable[[Chunk], None],
    chunks: Sequence[Chunk],
    threads: int | None,
    advance: Advance | None = None,
    cancel: Callable[[], None] | None = None,
) -> None:
    """Call `work` on every chunk; join all threads before returning or raising.

    `advance` is called in this thread with the finished fraction and may raise to cancel the rest. After an
    error `cancel` is called before the threads are joined: it may cut short the chunks at work.
    """
    workers = min(thread_count(threads), len(chunks))
    if workers <= 1:
        for count, chunk in enumerate(chunks, start=1):
            work(chunk)
            if advance is not None:
                advance(count / len(chunks))
        return

    def work_alike(chunk: Chunk) -> None:
        # Threads begin with numpy's own way to take errors
        with saturating():
            work(chunk)

    with ThreadPoolExecutor(workers, thread_name_prefix="ssgi") as pool:
        pending = {pool.submit(work_alike, chunk) for chunk in chunks}
        try:
            while pending:
                done, pending = wait(pending, timeout=0.1, return_when=FIRST_EXCEPTION)
                for future in done:
                    future.result()
                if advance is not None:
                    advance(1.0 - len(pending) / len(chunks))
        except BaseException:
            if cancel is not None:
                cancel()
            pool.shutdown(wait=True, cancel_futures=True)
            raise
