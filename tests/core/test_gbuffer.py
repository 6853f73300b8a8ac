# SPDX-License-Identifier: GPL-3.0-or-later
"""G-buffers: what counts as background, what counts as a bad pixel, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ssgi_addon.core import GBuffer
from tests.core.synthetic import uniform_gbuffer
from tests.tolerances import UNIT_NORMAL

SHAPE = (3, 4)
LIGHT = ("albedo", "specular", "direct", "source", "glossy_source")
BAD_LIGHT = (np.nan, np.inf, -np.inf, -1.0, 1e20)
ANY_FLOAT = st.floats(width=32, allow_nan=True, allow_infinity=True, allow_subnormal=True)


def passes(**changes: object) -> dict[str, object]:
    rng = np.random.default_rng(3)
    normal = rng.normal(size=(*SHAPE, 3))
    values = {name: rng.random((*SHAPE, 3)) for name in LIGHT}
    return {
        "depth": rng.uniform(1.0, 9.0, SHAPE),
        "normal": normal / np.linalg.norm(normal, axis=-1, keepdims=True),
        "roughness": rng.random(SHAPE),
        "thickness": rng.random(SHAPE),
        **values,
        **changes,
    }


def test_good_passes_are_kept_as_they_are():
    given_passes = passes()
    gbuffer = GBuffer(**given_passes)
    for name, value in given_passes.items():
        kept = getattr(gbuffer, name)
        assert kept.dtype == np.float32
        assert kept.flags.c_contiguous
        rtol = UNIT_NORMAL if name == "normal" else 0.0
        np.testing.assert_allclose(kept, np.float32(value), rtol=rtol)
    assert gbuffer.shape == SHAPE
    assert not gbuffer.is_background.any()


@pytest.mark.parametrize("bad", BAD_LIGHT)
@pytest.mark.parametrize("name", LIGHT)
def test_bad_pixel_of_light_is_black_and_its_neighbours_unchanged(name, bad):
    given_passes = passes()
    given_passes[name][1, 2, 1] = bad
    kept = getattr(GBuffer(**given_passes), name)
    assert (kept[1, 2] == 0.0).all()
    others = np.ones(SHAPE, bool)
    others[1, 2] = False
    np.testing.assert_array_equal(kept[others], np.float32(given_passes[name])[others])


@pytest.mark.parametrize("bad", [*BAD_LIGHT, 0.0, 1e-40])
def test_bad_depth_is_background_with_no_normal(bad):
    given_passes = passes()
    given_passes["depth"][1, 2] = bad
    gbuffer = GBuffer(**given_passes)
    expected = np.zeros(SHAPE, bool)
    expected[1, 2] = True
    np.testing.assert_array_equal(gbuffer.is_background, expected)
    assert np.isposinf(gbuffer.depth[1, 2])
    assert (gbuffer.normal[1, 2] == 0.0).all()


@pytest.mark.parametrize("bad", [(np.nan, 0, 1), (0, 0, 0), (np.inf, 0, 0), (0, -1e30, 0), (1e-5, 0, 0)])
def test_pixel_without_a_usable_normal_is_background(bad):
    given_passes = passes()
    given_passes["normal"][0, 0] = bad
    gbuffer = GBuffer(**given_passes)
    assert gbuffer.is_background[0, 0]
    assert gbuffer.is_background.sum() == 1


@pytest.mark.parametrize("length", [0.05, 0.7, 3.0, 1e6])
def test_averaged_normals_become_unit_vectors(length):
    gbuffer = uniform_gbuffer(SHAPE, normal=np.broadcast_to([0.0, 0.6 * length, 0.8 * length], (*SHAPE, 3)))
    np.testing.assert_allclose(gbuffer.normal[0, 0], [0.0, 0.6, 0.8], atol=UNIT_NORMAL)


@pytest.mark.parametrize("bad", [np.nan, -1.0, 1e20])
def test_bad_roughness_and_thickness_are_zero(bad):
    given_passes = passes()
    given_passes["roughness"][1, 1] = given_passes["thickness"][1, 1] = bad
    gbuffer = GBuffer(**given_passes)
    assert gbuffer.roughness[1, 1] == gbuffer.thickness[1, 1] == 0.0


def test_roughness_ends_at_one_and_thickness_may_be_endless():
    gbuffer = GBuffer(**passes(roughness=np.full(SHAPE, 1.5), thickness=np.full(SHAPE, np.inf)))
    assert (gbuffer.roughness == 1.0).all()
    assert np.isposinf(gbuffer.thickness).all()


def test_real_light_is_kept_however_bright():
    assert (GBuffer(**passes(direct=np.full((*SHAPE, 3), 1e5))).direct == 1e5).all()


def test_depths_from_millimetres_to_megametres_are_surfaces():
    depth = np.broadcast_to(np.geomspace(1e-3, 1e6, SHAPE[1]), SHAPE)
    assert not GBuffer(**passes(depth=depth)).is_background.any()


def test_source_falls_back_to_direct_and_glossy_source_to_source():
    gbuffer = GBuffer(**passes(source=None, glossy_source=None))
    assert gbuffer.diffuse_source is gbuffer.direct
    assert gbuffer.reflection_source is gbuffer.direct
    gbuffer = GBuffer(**passes(glossy_source=None))
    assert gbuffer.reflection_source is gbuffer.source
    gbuffer = GBuffer(**passes())
    assert gbuffer.diffuse_source is gbuffer.source
    assert gbuffer.reflection_source is gbuffer.glossy_source


@given(
    arrays.arrays(np.float32, (2, 3, 3), elements=ANY_FLOAT),
    arrays.arrays(np.float32, (2, 3), elements=ANY_FLOAT),
)
def test_no_input_leaves_anything_unusable(light, scalar):
    before = light.copy(), scalar.copy()
    gbuffer = GBuffer(scalar, light, light, light, scalar, light, source=light, thickness=scalar)
    np.testing.assert_array_equal(light, before[0])
    np.testing.assert_array_equal(scalar, before[1])
    for name in ("albedo", "specular", "direct", "source", "roughness"):
        value = getattr(gbuffer, name)
        assert np.isfinite(value).all()
        assert (value >= 0.0).all()
    assert (gbuffer.depth > 0.0).all()
    assert (np.isinf(gbuffer.depth) == gbuffer.is_background).all()
    length = np.linalg.norm(gbuffer.normal, axis=-1)
    np.testing.assert_allclose(length, np.where(gbuffer.is_background, 0.0, 1.0), atol=UNIT_NORMAL)
    with np.errstate(over="raise"):
        assert np.isfinite(1.0 / gbuffer.depth).all()


@pytest.mark.parametrize("dtype", [np.float16, np.float64, np.int32, np.uint8])
def test_other_number_types_and_strides_are_converted(dtype):
    albedo = np.ones((SHAPE[1], SHAPE[0], 3), dtype=dtype).transpose(1, 0, 2)
    gbuffer = GBuffer(**passes(albedo=albedo))
    assert gbuffer.albedo.dtype == np.float32
    assert gbuffer.albedo.flags.c_contiguous


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("depth", np.ones((3, 4, 1))),
        ("depth", np.ones((0, 4))),
        ("depth", 1.0),
        ("depth", np.full(SHAPE, "far")),
        ("normal", np.ones(SHAPE)),
        ("albedo", np.ones((4, 3, 3))),
        ("albedo", None),
        ("specular", np.ones((*SHAPE, 4))),
        ("direct", np.ones((*SHAPE, 3), dtype=complex)),
        ("direct", np.ones((*SHAPE, 3), dtype=bool)),
        ("source", np.ones((3, 3, 3))),
        ("glossy_source", np.ones(SHAPE)),
        ("roughness", np.ones((*SHAPE, 1))),
        ("thickness", np.ones((1, 1))),
        ("behind", np.ones(SHAPE)),
        ("behind", uniform_gbuffer((4, 4))),
    ],
)
def test_bad_arrays_are_named(field, value):
    with pytest.raises(ValueError, match=rf"^{field}: expected .*got"):
        GBuffer(**passes(**{field: value}))
