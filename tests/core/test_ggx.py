# SPDX-License-Identifier: GPL-3.0-or-later
"""The GGX lobe: samples and weights against quadrature of the published formulas in float64."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import ggx
from ssgi_addon.core.lobes import Lobes
from ssgi_addon.core.sampling import tangent_frame
from tests.tolerances import LOBE_MOMENT, UNIT_NORMAL

LOBES = [(cosine, roughness) for cosine in (1.0, 0.7, 0.3, 0.1) for roughness in (0.3, 0.5, 0.8, 1.0)]


def view_at(cosine: float) -> np.ndarray:
    sine = np.sqrt(1.0 - cosine * cosine)
    return np.array([[sine * 0.8], [sine * 0.6], [cosine]])


def hemisphere(count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (3, N) on a grid that is denser around the normal, and their solid angles (N,)."""
    steps = (np.arange(count) + 0.5) / count
    angle = (np.arange(2 * count) + 0.5) * (np.pi / count)
    steps, angle = np.meshgrid(steps, angle, indexing="ij")
    z = 1.0 - steps**3
    radius = np.sqrt(1.0 - z * z)
    solid_angle = 3.0 * steps**2 / count * (np.pi / count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z]).reshape(3, -1), solid_angle.ravel()


def ggx_d(cosine: np.ndarray, alpha: float) -> np.ndarray:
    return alpha**2 / (np.pi * (cosine**2 * (alpha**2 - 1.0) + 1.0) ** 2)


def smith(cosine: np.ndarray, alpha: float) -> np.ndarray:
    return 0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 / cosine**2 - 1.0)) - 1.0)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=0)


def lobes_at(cosine: float, roughness: float, is_elongated: bool = True) -> Lobes:
    """Return the lobe of one point whose normal is +Z."""
    return Lobes.at(np.array([[0.0], [0.0], [1.0]]), view_at(cosine), np.array([roughness]), is_elongated)


def sample(cosine: float, roughness: float, count: int = 256) -> np.ndarray:
    """Return microfacet normals (3, N) for a grid of sample points."""
    grid = (np.arange(count) + 0.5) / count
    u, v = (values.reshape(-1, 1) for values in np.meshgrid(grid, grid))
    return ggx.sample_visible_normal(view_at(cosine), np.array([roughness**2]), u, v)[..., 0]


@pytest.mark.parametrize(("cosine", "roughness"), LOBES)
def test_sampled_normals_have_the_density_of_visible_normals(cosine, roughness):
    alpha, view = roughness**2, view_at(cosine)
    normals, solid_angle = hemisphere()
    visible = np.maximum((normals * view).sum(axis=0), 0.0) * ggx_d(normals[2], alpha)
    density = visible / (cosine * (1.0 + smith(np.array(cosine), alpha)))
    assert (density * solid_angle).sum() == pytest.approx(1.0, abs=LOBE_MOMENT)
    found = sample(cosine, roughness)
    for moment in (lambda h: h, lambda h: h * h, lambda h: h[[0]] * h[[2]]):
        expected = (moment(normals) * density * solid_angle).sum(axis=1)
        np.testing.assert_allclose(moment(found).mean(axis=1), expected, atol=LOBE_MOMENT)


@pytest.mark.parametrize(("cosine", "roughness"), LOBES)
def test_mean_weight_is_the_directional_albedo(cosine, roughness):
    """The mean of f cos / pdf over the samples is the integral of f cos over the light's directions."""
    alpha, view = roughness**2, view_at(cosine)
    light, solid_angle = hemisphere()
    half = light + view
    half /= np.linalg.norm(half, axis=0)
    shadowing = 1.0 / (1.0 + smith(np.array(cosine), alpha) + smith(light[2], alpha))
    expected = (ggx_d(half[2], alpha) * shadowing / (4.0 * cosine) * solid_angle).sum()
    lobes = lobes_at(cosine, roughness)
    grid = (np.arange(256) + 0.5) / 256
    u, v = (values.reshape(-1, 1) for values in np.meshgrid(grid, grid))
    direction, pdf = lobes.draw(u, v, is_mirror=False)
    wide = Lobes(*(part[:, None] for part in (lobes.normal, lobes.axis, lobes.view)), lobes.alpha)
    assert (wide.value(direction) / pdf).mean() == pytest.approx(expected, abs=LOBE_MOMENT)
    assert expected <= 1.0 + LOBE_MOMENT


@pytest.mark.parametrize(("cosine", "roughness"), LOBES[::3])
def test_round_lobes_are_drawn_with_the_density_that_they_say(cosine, roughness):
    lobes = lobes_at(cosine, roughness, is_elongated=False)
    light, solid_angle = hemisphere()
    expected = (lobes.value(light) * solid_angle).sum()
    grid = (np.arange(256) + 0.5) / 256
    direction, pdf = lobes.draw(*(part.reshape(-1, 1) for part in np.meshgrid(grid, grid)), is_mirror=False)
    wide = Lobes(*(part[:, None] for part in (lobes.normal, lobes.axis, lobes.view)), lobes.alpha)
    assert (wide.value(direction) / pdf).mean() == pytest.approx(expected, abs=LOBE_MOMENT)


def test_round_lobes_look_the_same_all_around_their_mirror_direction():
    lobes = lobes_at(0.3, 0.3, is_elongated=False)
    assert lobes.value(lobes.axis) > 0.0
    tangent, bitangent = tangent_frame(lobes.axis)
    angle = np.linspace(0.0, 2.0 * np.pi, 9)[None]
    around = np.cos(0.1) * lobes.axis + np.sin(0.1) * (np.cos(angle) * tangent + np.sin(angle) * bitangent)
    values = lobes.value(around)
    np.testing.assert_allclose(values, values[0], rtol=UNIT_NORMAL)
    stretched = lobes_at(0.3, 0.3).value(around)
    assert stretched.max() > 2.0 * stretched.min()


def test_sampled_normals_are_unit_vectors_above_the_surface_in_float32(rng):
    view = rng.normal(size=(3, 300))
    view[2] = np.abs(view[2]) * rng.choice([1.0, 1e-3], 300)
    view = (view / np.linalg.norm(view, axis=0)).astype(np.float32)
    alpha = (rng.random(300) ** 2).clip(1e-6).astype(np.float32)
    u, v = rng.random((2, 16, 300)).astype(np.float32)
    normals = ggx.sample_visible_normal(view, alpha, u, v)
    assert normals.dtype == np.float32
    np.testing.assert_allclose((normals**2).sum(axis=0), 1.0, atol=UNIT_NORMAL)
    assert (normals[2] >= 0.0).all()


def test_smooth_surfaces_reflect_about_their_normal():
    normals = ggx.sample_visible_normal(view_at(0.4), np.array([1e-6]), np.array([[0.3]]), np.array([[0.9]]))
    np.testing.assert_allclose(normals[:, 0, 0], [0.0, 0.0, 1.0], atol=UNIT_NORMAL)


def test_nothing_is_reflected_below_the_surface_and_at_most_everything_above(rng):
    normal, view = (unit(rng.normal(size=(3, 2000))) for _ in range(2))
    for is_elongated in (True, False):
        lobes = Lobes.at(normal, view, rng.random(2000), is_elongated)
        light, pdf = lobes.draw(*rng.random((2, 1, 2000)), is_mirror=False)
        weight = lobes.value(light[:, 0]) / pdf[0]
        below = (normal * light[:, 0]).sum(axis=0) <= 0.0
        assert (weight[below] == 0.0).all()
        faces = (normal * view).sum(axis=0) > 1e-3
        assert (weight[faces] <= 1.0 + LOBE_MOMENT).all()


def test_mirrors_reflect_about_their_normal(rng):
    normal, view = (unit(rng.normal(size=(3, 100))) for _ in range(2))
    view *= np.sign((normal * view).sum(axis=0))
    drawn, _ = Lobes.at(normal, view, np.zeros(100)).draw(*rng.random((2, 1, 100)), is_mirror=True)
    expected = 2.0 * (normal * view).sum(axis=0) * normal - view
    np.testing.assert_allclose(drawn[:, 0], expected, atol=UNIT_NORMAL)
