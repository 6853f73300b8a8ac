# SPDX-License-Identifier: GPL-3.0-or-later
"""The filter: less noise on a surface, nothing across its edges, and no light made or lost."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import Camera, GBuffer
from ssgi_addon.core.denoise import filter_light
from tests.core.synthetic import Plane, capture, random_gbuffer, uniform_gbuffer
from tests.tolerances import FILTER_RELATIVE

SHAPE = (40, 50)


def smooth(
    gbuffer: GBuffer, signal: np.ndarray, variance=1.0, levels=4, threads: int | None = 1
) -> np.ndarray:
    height, width = gbuffer.shape
    camera = Camera.perspective(width, height, 1.0)
    signal = np.asarray(signal, dtype=np.float32)
    variance = np.broadcast_to(np.asarray(variance, dtype=np.float32), gbuffer.shape).copy()
    levels = np.broadcast_to(np.asarray(levels, dtype=np.int64), gbuffer.shape).copy()
    before = signal.copy(), variance.copy(), levels.copy()
    pixel = np.arange(height * width)
    (result,) = filter_light(
        gbuffer, camera, pixel, [signal.reshape(pixel.size, -1)], variance.ravel(), levels.ravel(), threads
    )
    result = result.reshape(signal.shape)
    for array, copy in zip((signal, variance, levels), before, strict=True):
        np.testing.assert_array_equal(array, copy)
    assert result.shape == signal.shape
    assert result.dtype == np.float32
    return result


def wall() -> GBuffer:
    return uniform_gbuffer(SHAPE, 5.0)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.7, -0.2, 0.7)])
def test_even_light_stays_even_on_any_plane(normal):
    gbuffer = capture(Camera.perspective(SHAPE[1], SHAPE[0], 1.0), [Plane((0.0, 0.0, -5.0), normal)])
    signal = np.full((*SHAPE, 4), 0.7)
    np.testing.assert_allclose(smooth(gbuffer, signal), signal, rtol=FILTER_RELATIVE)


def test_noise_falls_and_the_mean_stays(rng):
    signal = rng.gamma(0.5, 2.0, (*SHAPE, 3))
    luminance = signal @ [0.2126, 0.7152, 0.0722]
    result = smooth(wall(), signal, luminance.var())
    inside = (slice(8, -8), slice(8, -8))
    assert result[inside].std() < 0.25 * signal[inside].std()
    assert result.mean() == pytest.approx(signal.mean(), rel=0.05)


def test_result_stays_within_the_range_of_its_input(rng):
    signal = rng.random((*SHAPE, 3)) * rng.choice([1e-3, 1e3], (*SHAPE, 1))
    result = smooth(random_gbuffer(rng, SHAPE), signal, rng.random(SHAPE))
    assert result.min() >= signal.min() * (1.0 - FILTER_RELATIVE)
    assert result.max() <= signal.max() * (1.0 + FILTER_RELATIVE)


def test_light_does_not_cross_a_step_in_depth():
    gbuffer = uniform_gbuffer(SHAPE, np.where(np.arange(SHAPE[1]) < 25, 3.0, 6.0))
    signal = np.zeros((*SHAPE, 3))
    signal[:, :25] = 1.0
    np.testing.assert_allclose(smooth(gbuffer, signal, 100.0), signal, atol=FILTER_RELATIVE)


def test_light_does_not_cross_an_edge_between_perpendicular_walls():
    camera = Camera.perspective(SHAPE[1], SHAPE[0], 1.0)
    floor, back = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), Plane((0.0, 0.0, -6.0), (0.0, 0.0, 1.0))
    gbuffer = capture(camera, [floor, back])
    is_floor = gbuffer.normal[..., 1:2] > 0.5
    assert 100 < is_floor.sum() < is_floor.size - 100
    signal = np.where(is_floor, 1.0, 0.0) * np.ones(3)
    np.testing.assert_allclose(smooth(gbuffer, signal, 100.0), signal, atol=FILTER_RELATIVE)


def test_background_and_pixels_of_no_level_are_untouched(rng):
    signal = rng.random((*SHAPE, 3)).astype(np.float32)
    depth = np.full(SHAPE, 5.0)
    depth[:20] = np.inf
    levels = np.full(SHAPE, 3)
    levels[30:] = 0
    result = smooth(uniform_gbuffer(SHAPE, depth), signal, 1.0, levels)
    np.testing.assert_array_equal(result[:20], signal[:20])
    np.testing.assert_array_equal(result[30:], signal[30:])
    assert (result[20:30] != signal[20:30]).any(axis=-1).all()


@pytest.mark.parametrize("size", [1, 3, 5, 9])
def test_background_at_the_centre_of_odd_frames_is_no_trouble(size):
    """There the distance is endless and the offset from the axis zero."""
    signal = np.ones((size, size, 3))
    np.testing.assert_array_equal(smooth(uniform_gbuffer((size, size), np.inf), signal), signal)


def test_edges_that_noise_does_not_explain_stay(rng):
    """Contact shadows: a step in light on one plane, with little noise."""
    signal = np.ones((*SHAPE, 3))
    signal[:, :25] = 0.2
    result = smooth(wall(), signal, 1e-8, 5)
    # The passes that go by geometry alone reach a few pixels
    np.testing.assert_allclose(result[:, 10:15], 0.2, atol=FILTER_RELATIVE)
    np.testing.assert_allclose(result[:, 35:40], 1.0, atol=FILTER_RELATIVE)


def test_one_bright_pixel_stays_local():
    signal = np.ones((*SHAPE, 3))
    signal[20, 25] = 1e5
    result = smooth(wall(), signal, 1.0)
    far = np.hypot(*(np.indices(SHAPE) - np.array([20, 25])[:, None, None])) > 2 * 2**4
    np.testing.assert_allclose(result[far], 1.0, rtol=FILTER_RELATIVE)


def test_scaling_the_light_by_powers_of_two_scales_the_result_exactly(rng):
    signal, variance = rng.random((*SHAPE, 3)), rng.random(SHAPE)
    gbuffer = random_gbuffer(rng, SHAPE)
    plain = smooth(gbuffer, signal, variance)
    np.testing.assert_array_equal(smooth(gbuffer, signal * 2.0**10, variance * 2.0**20), plain * 2.0**10)


@pytest.mark.parametrize("axis", [0, 1])
def test_flips_flip_the_result(axis, rng):
    signal, variance = rng.random((*SHAPE, 3)), rng.random(SHAPE)
    depth = rng.uniform(4.9, 5.1, SHAPE)
    plain = smooth(uniform_gbuffer(SHAPE, depth), signal, variance)
    flipped = smooth(
        uniform_gbuffer(SHAPE, np.flip(depth, axis)), np.flip(signal, axis), np.flip(variance, axis)
    )
    np.testing.assert_allclose(np.flip(flipped, axis), plain, rtol=FILTER_RELATIVE)


def test_threads_and_bands_do_not_change_a_bit(rng):
    shape = (1500, 60)  # several bands
    signal, variance = rng.random((*shape, 3)), rng.random(shape)
    gbuffer = random_gbuffer(rng, shape)
    alone = smooth(gbuffer, signal, variance, threads=1)
    for threads in (2, 8):
        np.testing.assert_array_equal(smooth(gbuffer, signal, variance, threads=threads), alone)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (3, 5)])
def test_frames_smaller_than_the_filter_are_smoothed(shape, rng):
    result = smooth(uniform_gbuffer(shape, 2.0), rng.random((*shape, 3)), 1.0, 5)
    assert np.isfinite(result).all()


def test_black_stays_black_and_finite():
    assert (smooth(wall(), np.zeros((*SHAPE, 3)), 0.0) == 0.0).all()
