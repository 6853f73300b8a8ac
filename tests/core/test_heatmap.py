# SPDX-License-Identifier: GPL-3.0-or-later
"""The error map: its scale, its ramp, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.heatmap import ERROR_RANGE, color_errors, error_map, legend_bar, legend_labels

# Rec. 709 luma of sRGB-encoded values: enough to tell lighter from darker
LUMA = np.array([0.2126, 0.7152, 0.0722])


def test_equal_pictures_take_the_dark_end():
    picture = np.random.default_rng(1).random((4, 5, 3))
    colors = error_map(picture, picture)
    assert colors.shape == (4, 5, 3)
    assert colors.dtype == np.uint8
    assert (colors == color_errors(0.0)).all()


def test_a_pixels_color_is_that_of_its_relative_error():
    reference = np.ones((2, 2, 3))
    image = reference.copy()
    image[0, 1] = 1.5
    # (1.5 - 1)² / (1² + 0.01 · 1²), by hand
    expected = 0.25 / 1.01
    colors = error_map(image, reference)
    np.testing.assert_array_equal(colors[0, 1], color_errors(expected))
    np.testing.assert_array_equal(colors[0, 0], color_errors(0.0))


def test_ramp_grows_lighter_with_the_error():
    luma = color_errors(np.geomspace(*ERROR_RANGE, 200)) @ LUMA
    assert (np.diff(luma) > -1.0).all()  # rounding to whole numbers may step back by less than one
    assert luma[-1] - luma[0] > 200.0


def test_errors_beyond_the_range_take_its_ends():
    low, high = ERROR_RANGE
    np.testing.assert_array_equal(color_errors([low / 100, low]), color_errors([low, low]))
    np.testing.assert_array_equal(color_errors([high * 100, np.inf]), color_errors([high, high]))


def test_light_on_a_black_reference_takes_the_bright_end():
    image = np.zeros((1, 2, 3))
    image[0, 0] = 0.5
    np.testing.assert_array_equal(error_map(image, np.zeros_like(image))[0], color_errors([np.inf, 0.0]))


def test_legend_runs_over_the_range_with_a_label_at_each_decade():
    bar = legend_bar(100, 7)
    assert bar.shape == (7, 100, 3)
    np.testing.assert_array_equal(bar[:, [0, -1]], np.tile(color_errors(ERROR_RANGE), (7, 1, 1)))
    assert legend_labels() == [(0.0, "0.001"), (0.25, "0.01"), (0.5, "0.1"), (0.75, "1"), (1.0, "10")]


def test_pictures_of_different_sizes_are_refused():
    with pytest.raises(ValueError, match="shape"):
        error_map(np.ones((2, 2, 3)), np.ones((2, 3, 3)))
