# SPDX-License-Identifier: GPL-3.0-or-later
"""Frame numbers as a short text, as the command line takes them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

# Fewer frames than these, evenly apart, are shorter one by one
_SHORTEST_RUN = 3


def frame_ranges(frames: Iterable[int]) -> str:
    """Return frame numbers as ``1-4,7-21:2,30``, in rising order, each once."""
    return ",".join(_range_text(run) for run in _even_runs(sorted(set(frames))))


def _even_runs(numbers: list[int]) -> Iterator[list[int]]:
    """Cut rising numbers into runs that are evenly apart, each as long as it gets from the left."""
    begin = 0
    while begin < len(numbers):
        end = begin + 1
        step = numbers[end] - numbers[begin] if end < len(numbers) else 1
        while end < len(numbers) and numbers[end] - numbers[end - 1] == step:
            end += 1
        # Two numbers far apart are no run: the second may begin a longer one
        if step > 1 and end - begin < _SHORTEST_RUN:
            end = begin + 1
        yield numbers[begin:end]
        begin = end


def _range_text(run: list[int]) -> str:
    first, last = run[0], run[-1]
    step = run[1] - first if len(run) > 1 else 1
    if len(run) < _SHORTEST_RUN and step == 1:
        return ",".join(map(str, run))
    return f"{first}-{last}" if step == 1 else f"{first}-{last}:{step}"
