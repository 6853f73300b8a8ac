# SPDX-License-Identifier: GPL-3.0-or-later
"""The frontier of error over time: what no other point beats, and what lies on it between two points."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from typing import Protocol, TypeVar


class Measured(Protocol):
    """Anything with seconds and an error, both above zero."""

    @property
    def seconds(self) -> float: ...

    @property
    def error(self) -> float: ...


M = TypeVar("M", bound=Measured)


def on_frontier(points: Sequence[Measured]) -> list[bool]:
    """Return which points no other one beats: none is as fast and as near, and better in one of the two."""

    def beats(one: Measured, other: Measured) -> bool:
        no_worse = one.seconds <= other.seconds and one.error <= other.error
        return no_worse and (one.seconds < other.seconds or one.error < other.error)

    return [not any(beats(other, point) for other in points) for point in points]


def frontier(points: Sequence[M]) -> list[M]:
    """Return the points that no other one beats, the fastest first, one for each time."""
    best = [point for point, is_best in zip(points, on_frontier(points)) if is_best]
    return list({point.seconds: point for point in sorted(best, key=lambda point: point.seconds)}.values())


def error_at(points: Sequence[Measured], seconds: float) -> float | None:
    """Return the error that the frontier of `points` has at a time.

    Between two points the error follows the straight line of the log-log plot. Later than the last it is
    the last one's; None before the first: nothing is as fast.
    """
    front = frontier(points)
    return _interpolate([p.seconds for p in front], [p.error for p in front], seconds)


def seconds_for(points: Sequence[Measured], error: float) -> float | None:
    """Return the time at which the frontier of `points` reaches an error.

    The reverse of `error_at`: the first one's time for larger errors than its own, None where no point is
    as near.
    """
    front = frontier(points)[::-1]
    return _interpolate([p.error for p in front], [p.seconds for p in front], error)


def _interpolate(x: Sequence[float], y: Sequence[float], at: float) -> float | None:
    """Follow y over rising x on logarithmic axes; None below, the last value above."""
    if not x or at < x[0]:
        return None
    if at >= x[-1]:
        return y[-1]
    after = bisect.bisect_right(x, at)
    share = math.log(at / x[after - 1]) / math.log(x[after] / x[after - 1])
    return math.exp((1.0 - share) * math.log(y[after - 1]) + share * math.log(y[after]))


def geometric_mean(values: Sequence[float]) -> float | None:
    """Return the mean of ratios; None of none."""
    return math.exp(math.fsum(map(math.log, values)) / len(values)) if values else None
