# SPDX-License-Identifier: GPL-3.0-or-later
import math

import numpy as np
import pytest

from ssgi_addon.core import metrics
from ssgi_addon.core.metrics import bias, compare_images, flip, pixel_subsets, relmse, ssim
from tests.tolerances import METRIC_RELATIVE


@pytest.fixture
def pair(rng):
    reference = rng.gamma(0.5, 1.0, (23, 31, 3)).astype(np.float32)
    return (reference * rng.uniform(0.5, 1.5, reference.shape)).astype(np.float32), reference


def test_relmse_is_its_formula(pair):
    image, reference = pair
    total = 0.0
    mean = sum(float(value) for value in reference.flat) / reference.size
    for v, r in zip(image.flat, reference.flat):
        total += (float(v) - float(r)) ** 2 / (float(r) ** 2 + 0.01 * mean**2)
    assert relmse(image, reference, trim=0.0) == pytest.approx(total / reference.size, rel=METRIC_RELATIVE)


def test_relmse_without_light_is_near_one():
    reference = np.full((4, 4, 3), 7.0, np.float32)
    assert relmse(np.zeros_like(reference), reference) == pytest.approx(1 / 1.01, rel=METRIC_RELATIVE)


def test_relmse_does_not_change_with_the_brightness(pair):
    image, reference = pair
    assert relmse(image * 64, reference * 64) == pytest.approx(relmse(image, reference), rel=METRIC_RELATIVE)


def test_equal_pictures_have_no_error(pair):
    _, reference = pair
    assert compare_images(reference, reference) | {"flip": None} == {
        "relmse": 0.0,
        "bias": 0.0,
        "ssim": pytest.approx(1.0, abs=METRIC_RELATIVE),
        "flip": None,
    }


def test_black_pictures_have_no_error():
    black = np.zeros((8, 8, 3), np.float32)
    assert (relmse(black, black), bias(black, black), ssim(black, black)) == (0.0, 0.0, 1.0)


def test_light_on_a_black_reference_is_reported_as_unmeasurable():
    black = np.zeros((8, 8, 3), np.float32)
    assert math.isinf(relmse(black + 1, black))
    assert compare_images(black + 1, black)["relmse"] is None


def test_the_worst_pixel_of_a_thousand_is_left_out():
    reference = np.ones((25, 40, 3), np.float32)
    image = reference.copy()
    image[3, 5] = 1000.0
    assert relmse(image, reference) == 0.0
    assert relmse(image, reference, trim=0.0) > 0.0
    image[4, 5] = 1000.0
    assert relmse(image, reference) > 0.0


def test_pictures_below_a_thousand_pixels_keep_every_pixel():
    reference = np.ones((27, 37, 3), np.float32)
    image = reference.copy()
    image[3, 5] = 2.0
    assert relmse(image, reference) == relmse(image, reference, trim=0.0) > 0.0


def test_bias_has_the_sign_of_the_error():
    reference = np.full((4, 4, 3), 2.0, np.float32)
    assert bias(reference - 0.5, reference) == -0.5
    assert bias(reference + 0.25, reference) == 0.25


def test_masks_count_their_pixels_against_the_whole_brightness():
    reference = np.ones((2, 2), np.float32)
    reference[0] = 3.0
    image = reference.copy()
    image[1, 1] += 1.0
    mask = np.array([[False, False], [True, True]])
    assert relmse(image, reference, mask=mask) == pytest.approx(0.5 / 1.04, rel=METRIC_RELATIVE)
    assert bias(image, reference, mask=mask) == 0.5
    assert bias(image, reference, mask=~mask) == 0.0


def test_empty_mask_has_no_figures(pair):
    nothing = np.zeros(pair[0].shape[:2], bool)
    assert set(compare_images(*pair, mask=nothing).values()) == {None}


def slow_ssim(image, reference):
    """One channel, pixel by pixel, with the two-dimensional window of the paper."""
    y, x = np.mgrid[-5:6, -5:6]
    window = np.exp(-(x**2 + y**2) / (2 * 1.5**2))
    window /= window.sum()
    height, width = image.shape
    padded = [np.pad(picture, 5, mode="symmetric") for picture in (image, reference)]
    total = 0.0
    for row, column in np.ndindex(height, width):
        a, b = (picture[row : row + 11, column : column + 11] for picture in padded)
        mean_a, mean_b = (window * a).sum(), (window * b).sum()
        var_a, var_b = (window * (a - mean_a) ** 2).sum(), (window * (b - mean_b) ** 2).sum()
        covariance = (window * (a - mean_a) * (b - mean_b)).sum()
        total += ((2 * mean_a * mean_b + 1e-4) * (2 * covariance + 9e-4)) / (
            (mean_a**2 + mean_b**2 + 1e-4) * (var_a + var_b + 9e-4)
        )
    return total / (height * width)


@pytest.mark.parametrize("size", [(1, 1), (3, 5), (16, 21)])
def test_ssim_is_the_published_one(rng, size):
    shown = rng.uniform(0, 1, (2, *size))
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    assert ssim(*linear) == pytest.approx(slow_ssim(*shown), rel=1e-6)


def test_ssim_falls_with_noise(rng):
    reference = np.full((32, 32, 3), 0.2) + np.linspace(0, 0.5, 32)[:, None]
    noise = rng.normal(0, 1, reference.shape)
    values = [ssim(reference + amount * noise, reference) for amount in (0.0, 0.01, 0.05, 0.2)]
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(1.0)


def test_exposure_is_in_stops(pair):
    image, reference = pair
    assert ssim(image, reference, exposure=2.0) == ssim(image * 4, reference * 4)


def test_flip_is_left_out_without_its_evaluator(pair, monkeypatch):
    monkeypatch.setattr(metrics.importlib.util, "find_spec", lambda name: None)
    assert flip(*pair) is None
    assert compare_images(*pair)["flip"] is None


def test_flip_grows_with_the_error(pair):
    pytest.importorskip("flip_evaluator")
    image, reference = pair
    assert flip(reference, reference) == 0.0
    assert 0.0 < flip(0.9 * reference, reference) < flip(0.1 * reference, reference) <= 1.0
    assert flip(image[..., 0], reference[..., 0]) > 0.0


def test_inputs_stay_as_they_are(pair):
    copies = [picture.copy() for picture in pair]
    compare_images(*pair)
    for picture, copy in zip(pair, copies):
        np.testing.assert_array_equal(picture, copy)


@pytest.mark.parametrize("function", [relmse, bias, ssim, flip])
def test_what_is_not_finite_is_refused_and_not_trimmed_away(pair, function):
    image, reference = pair
    image[2, 3, 1] = np.nan
    with pytest.raises(ValueError, match="image: expected finite values, got 1"):
        function(image, reference)


def test_other_shapes_are_refused(pair):
    image, reference = pair
    with pytest.raises(ValueError, match="shape of the reference"):
        relmse(image[1:], reference)
    with pytest.raises(ValueError, match="mask: expected bool"):
        relmse(image, reference, mask=np.ones((2, 2), bool))
    with pytest.raises(ValueError, match="trim"):
        relmse(image, reference, trim=1.0)


def slanted_plane(height=20, width=30, tilt=0.03):
    y, x = np.mgrid[:height, :width] + 0.5
    return 1.0 / (0.2 + tilt * (x - 0.3 * y) / width)


def test_slanted_plane_has_no_silhouettes():
    assert not metrics.find_silhouettes(slanted_plane(tilt=0.15)).any()


def test_silhouettes_are_one_pixel_around_a_step():
    depth = slanted_plane()
    depth[8:12, 10:15] *= 0.5
    found = metrics.find_silhouettes(depth)
    assert found[9, 9:11].all()
    assert found[7:9, 12].all()
    assert not found[:5].any()
    assert not found[:, :7].any()
    assert found.sum() < 0.2 * found.size


def test_the_edge_to_the_sky_is_a_silhouette():
    depth = slanted_plane()
    depth[:6] = np.inf
    found = metrics.find_silhouettes(depth)
    assert found[5:7].all()
    assert not found[:4].any()
    assert not found[9:].any()


def test_subsets_split_the_frame():
    depth = slanted_plane()
    depth[:, 15:] += 3.0
    known = np.where(np.arange(20)[:, None] < 10, 0.95, 0.5) * np.ones((20, 30))
    subsets = pixel_subsets(depth, known)
    assert subsets["all"].all()
    assert (subsets["known"] == (known >= 0.9)).all()
    assert (subsets["rest"] == ~(subsets["known"] | subsets["silhouettes"])).all()
    assert subsets["rest"].any()
    with pytest.raises(ValueError, match="known"):
        pixel_subsets(depth, known[1:])
