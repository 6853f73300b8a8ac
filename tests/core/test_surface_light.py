# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces hand on does not depend on the angle that the camera sees them at."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import Camera, GBuffer
from ssgi_addon.surface_light import handed_on, reflectance, seen_from_elsewhere
from tests.tolerances import REPEATED_SUM

CAMERA = Camera.perspective(8, 6, 0.6)
SHAPE = (6, 8, 3)


def image(rgb) -> np.ndarray:
    return np.broadcast_to(np.float32(rgb), SHAPE).copy()


def passes(diffuse_color, glossy_color, diffuse_direct=2.0, glossy_direct=5.0) -> dict[str, np.ndarray]:
    return {
        "Diffuse Color": image(diffuse_color),
        "Glossy Color": image(glossy_color),
        "Diffuse Direct": image(diffuse_direct),
        "Glossy Direct": image(glossy_direct),
    }


def normals(tilt: float) -> np.ndarray:
    return image((0.0, np.sin(tilt), np.cos(tilt)))


def test_matte_surfaces_hand_on_their_colour():
    light = passes((0.8, 0.4, 0.0), 0.0)
    np.testing.assert_array_equal(handed_on(light, image(1.0)[..., 0]), image((1.6, 0.8, 0.0)))
    found = reflectance(light["Diffuse Color"], light["Glossy Color"], normals(0.3), CAMERA)
    np.testing.assert_array_equal(found, light["Diffuse Color"])


@pytest.mark.parametrize("gloss", [0.04, 0.3, 0.7, 0.95])
def test_what_gloss_takes_from_a_colour_is_put_back(gloss):
    color = np.float32([0.6, 0.3, 0.1])
    light = passes(color * (1.0 - gloss), gloss)
    np.testing.assert_allclose(handed_on(light, image(0.3)[..., 0]), image(2.0 * color), rtol=REPEATED_SUM)


def test_reflectance_is_that_of_the_material_at_every_angle():
    """Fresnel by Schlick over a base colour: from head-on to grazing."""
    base, head_on = np.float32([0.6, 0.3, 0.1]), 0.04
    mean = head_on + (1.0 - head_on) / 21.0
    expected = base + (1.0 - base) * mean
    y, x = np.mgrid[0:6, 0:8] + 0.5
    away = CAMERA.pixel_to_view(x, y, np.ones((6, 8)))
    for tilt in (0.0, 0.5, 1.0, 1.3):
        cosine = -(away * normals(tilt)).sum(axis=-1) / np.linalg.norm(away, axis=-1)
        gloss = (head_on + (1.0 - head_on) * (1.0 - cosine[..., None]) ** 5) * np.ones(3)
        found = reflectance(
            (base * (1.0 - gloss)).astype(np.float32), gloss.astype(np.float32), normals(tilt), CAMERA
        )
        seen = cosine > 0.1
        np.testing.assert_allclose(
            found[seen], np.broadcast_to(expected, SHAPE)[seen], rtol=1e3 * REPEATED_SUM
        )


def test_only_rough_metals_hand_on_their_gloss():
    light = passes(0.0, (0.9, 0.7, 0.5))
    np.testing.assert_array_equal(handed_on(light, image(0.1)[..., 0]), image(0.0))
    np.testing.assert_array_equal(handed_on(light, image(0.5)[..., 0]), 5.0 * light["Glossy Color"])


def test_nothing_reflects_more_than_all_light(rng):
    color, gloss = rng.random((2, *SHAPE)).astype(np.float32)
    color *= 1.0 - gloss
    found = reflectance(color, gloss, normals(0.7), CAMERA)
    assert found.min() >= 0.0
    assert found.max() <= 1.0 + REPEATED_SUM


def test_gloss_of_lamps_is_left_out_of_what_views_from_elsewhere_show_to_mirrors():
    shape = (1, 4)
    metal, paint, _, shiny = range(4)  # the third one shines of its own
    albedo, specular, source, glossy = np.zeros((4, *shape, 3), dtype=np.float32)
    albedo[0, paint] = albedo[0, shiny] = 0.5
    specular[0, metal] = specular[0, shiny] = 0.8
    source[0] = np.array([0.3, 0.2, 5.0, 0.2])[:, None]
    glossy[0] = np.array([9.0, 0.2, 5.0, 7.0])[:, None]
    normal = np.broadcast_to(np.float32([0.0, 0.0, 1.0]), (*shape, 3))
    gbuffer = GBuffer(
        np.ones(shape),
        normal,
        albedo,
        specular,
        np.full(shape, 0.3),
        glossy,
        source=source,
        glossy_source=glossy,
    )
    found = seen_from_elsewhere(gbuffer)
    np.testing.assert_array_equal(
        found.reflection_source[0, :, 0], source[0, :, 0] * np.float32([0, 1, 1, 1])
    )
    np.testing.assert_array_equal(found.diffuse_source, gbuffer.diffuse_source)
