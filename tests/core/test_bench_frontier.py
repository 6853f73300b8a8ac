# SPDX-License-Identifier: GPL-3.0-or-later
"""The frontier and what is read from it, on points whose answers are plain."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.bench.frontier import error_at, frontier, geometric_mean, on_frontier, seconds_for


@dataclass(frozen=True)
class Spot:
    seconds: float
    error: float


# On the line error = 1 / seconds of the log-log plot, and one that is beaten
LINE = [Spot(1.0, 1.0), Spot(4.0, 0.25), Spot(2.0, 2.0), Spot(16.0, 0.0625)]
numbers = st.floats(1e-3, 1e3)
clouds = st.lists(st.builds(Spot, numbers, numbers), min_size=1, max_size=12)


def test_beaten_point_is_not_on_the_frontier():
    assert on_frontier(LINE) == [True, True, False, True]
    assert frontier(LINE[::-1]) == [LINE[0], LINE[1], LINE[3]]


def test_between_two_points_the_error_follows_the_plot_s_straight_line():
    assert error_at(LINE, 2.0) == pytest.approx(0.5)
    assert error_at(LINE, 8.0) == pytest.approx(0.125)
    assert seconds_for(LINE, 0.5) == pytest.approx(2.0)


def test_before_the_first_point_nothing_is_as_fast_and_after_the_last_nothing_is_nearer():
    assert error_at(LINE, 0.99) is None
    assert error_at(LINE, 100.0) == 0.0625
    assert seconds_for(LINE, 0.06) is None
    assert seconds_for(LINE, 7.0) == 1.0
    assert error_at([], 1.0) is None


@given(clouds, numbers)
def test_no_point_beats_the_frontier_and_more_time_brings_no_more_error(cloud, seconds):
    front = frontier(cloud)
    assert [spot.seconds for spot in front] == sorted({spot.seconds for spot in front})
    assert all(one.error > other.error for one, other in pairwise(front))
    now, later = error_at(cloud, seconds), error_at(cloud, 2.0 * seconds)
    if now is not None:
        assert later <= now * (1.0 + 1e-12)
        assert now <= min(spot.error for spot in cloud if spot.seconds <= seconds) * (1.0 + 1e-12)


@given(clouds)
def test_points_of_the_frontier_are_met_both_ways(cloud):
    for spot in frontier(cloud):
        assert error_at(cloud, spot.seconds) == pytest.approx(spot.error)
        assert seconds_for(cloud, spot.error) == pytest.approx(spot.seconds)


def test_mean_of_a_half_and_a_double_is_one():
    assert geometric_mean([0.5, 2.0]) == pytest.approx(1.0)
    assert geometric_mean([]) is None
