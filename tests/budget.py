# SPDX-License-Identifier: GPL-3.0-or-later
"""How much tests try: a few examples in every run, many with ``--stress``. Those tried are counted."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable
from typing import Any

import hypothesis

Test = Callable[..., None]

# Examples tried so far, by test.
tried: Counter[str] = Counter()
_times = 1


def multiply(times: int) -> None:
    """Let all tests that are collected from now on try so many times their examples."""
    global _times
    _times = times


def times() -> int:
    """Return how many times the examples of an ordinary run are tried; asked while tests are collected."""
    return _times


def examples(max_examples: int, **options: Any) -> Callable[[Test], Test]:
    """Return a decorator that limits and counts the examples of a property test; it stands below `given`.

    Parameters
    ----------
    max_examples
        In an ordinary run.
    options
        Further ones of `hypothesis.settings`.
    """

    def decorate(test: Test) -> Test:
        @functools.wraps(test)
        def counted(*arguments: Any, **named: Any) -> None:
            tried[f"{test.__module__}.{test.__qualname__}"] += 1
            test(*arguments, **named)

        limited: Test = hypothesis.settings(max_examples=max_examples * _times, **options)(counted)
        return limited

    return decorate
