# SPDX-License-Identifier: GPL-3.0-or-later
"""Anything through the public API: it is refused by name, or the light is finite and never negative."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Collection
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssgi_addon.core import (
    Camera,
    DiffuseSettings,
    Environment,
    Fill,
    GBuffer,
    IndirectLight,
    ReflectionSettings,
    Settings,
    composite,
    render_indirect,
)
from tests.budget import examples
from tests.core import fuzz
from tests.core.synthetic import make_settings, random_gbuffer, uniform_gbuffer
from tests.core.test_pipeline import IMAGES, assert_in_range, assert_same

WHITE = Environment.constant((1.0, 1.0, 1.0))
KINDS = (ReflectionSettings, DiffuseSettings, Settings)
OPTIONS = [(kind, item) for kind in KINDS for item in fields(kind) if item.metadata]
METHODS = ("hemisphere", "horizon", "bitmask", "ssao")
# One value of each way to be bad; a normal may be negative, and endless depth and thickness have a meaning.
BAD = (np.nan, np.inf, -np.inf, -1.0, 1e30)
MEANT = (("depth", np.inf), ("thickness", np.inf), ("normal", -1.0))


def assert_picture(gbuffer: GBuffer, light: IndirectLight) -> None:
    assert_in_range(light)
    picture = composite(gbuffer, light)
    assert np.isfinite(picture).all()
    assert picture.min() >= 0.0


def frozen(values: dict[str, Any]) -> bytes:
    """Return all that arguments hold, and how they lie in memory."""
    arrays = {
        name: (value.dtype.str, value.strides, value.tobytes())
        for name, value in values.items() if isinstance(value, np.ndarray)
    }  # fmt: skip
    return pickle.dumps((arrays, {name: repr(value) for name, value in values.items()}))


def made_or_named(make: Callable[..., Any], arguments: dict[str, Any], names: Collection[str]) -> Any:
    """Return what is made of arguments; None if one of them is refused, which must be by its name."""
    try:
        return make(**arguments)
    except ValueError as error:
        text = str(error)
    name, colon, rest = text.partition(": ")
    assert colon, text
    assert name in names, text
    assert rest.startswith("expected"), text
    return None


@given(st.data())
@examples(max_examples=60)
def test_any_pixels_in_any_form_give_light_in_range_and_stay_as_they_are(data):
    shape = data.draw(st.sampled_from(fuzz.SIZES))
    given_passes = data.draw(fuzz.passes(shape))
    before = frozen(given_passes)
    gbuffer = GBuffer(**given_passes)
    camera = fuzz.plain_camera(shape, data.draw(st.booleans()))
    light = render_indirect(gbuffer, camera, data.draw(fuzz.settings()), data.draw(fuzz.skies()))
    assert_picture(gbuffer, light)
    assert frozen(given_passes) == before


@given(st.data())
@examples(max_examples=100)
def test_what_is_no_image_of_the_frames_size_is_named(data):
    shape = data.draw(st.sampled_from([(3, 5), (2, 2), (1, 1)]))
    given_passes = data.draw(fuzz.passes(shape))
    name = data.draw(st.sampled_from(sorted(given_passes)))
    _, _, channels = fuzz.PASSES[name]
    given_passes[name] = data.draw(fuzz.no_images((*shape, *channels)))
    with pytest.raises(ValueError, match=r"^\w+: expected .*got") as caught:
        GBuffer(**given_passes)
    # All others are compared with the shape of depth, so it may be one of them that is named
    named = str(caught.value).partition(":")[0]
    assert named == name or (name == "depth" and named in given_passes)


@given(st.data())
@examples(max_examples=60)
def test_any_settings_that_are_taken_light_a_frame(data):
    rng = np.random.default_rng(data.draw(fuzz.SEEDS))
    shape = data.draw(st.sampled_from([(1, 1), (5, 7), (13, 4)]))
    gbuffer = random_gbuffer(rng, shape)
    if data.draw(st.booleans()):
        gbuffer = replace(gbuffer, thickness=rng.exponential(1.0, shape), behind=random_gbuffer(rng, shape))
    camera = fuzz.plain_camera(shape, data.draw(st.booleans()))
    light = render_indirect(gbuffer, camera, data.draw(fuzz.settings()), data.draw(fuzz.skies()))
    assert_picture(gbuffer, light)


@pytest.mark.parametrize(("kind", "item"), OPTIONS, ids=lambda of: getattr(of, "name", None))
def test_settings_out_of_range_or_of_another_kind_are_named(kind, item):
    for value in fuzz.bad_values(item):
        with pytest.raises(ValueError, match=rf"^{kind.__name__}\.{item.name}: expected .*got"):
            kind(**{item.name: value})


@pytest.mark.parametrize("count", [4096, 257])
def test_as_many_rays_as_may_be_asked_for_are_traced(count, rng):
    gbuffer = random_gbuffer(rng, (2, 3))
    settings = make_settings(rays=count, glossy_rays=count, sky_rays=count, filter=True)
    image = rng.random((4, 8, 3)) ** 8
    light = render_indirect(
        gbuffer, Camera.perspective(3, 2, 1.0), settings, Environment.equirectangular(image, np.eye(4))
    )
    assert_picture(gbuffer, light)


ANY_SIZE = st.one_of(st.integers(1, 9), st.sampled_from([0, -1, 2.0, True, "3", None, np.int32(4), 10**400]))


@given(st.data())
@examples(max_examples=200)
def test_any_camera_is_refused_by_name_or_sees_light_in_range(data):
    make, arguments = data.draw(fuzz.lenses(data.draw(ANY_SIZE), data.draw(ANY_SIZE)))
    camera = made_or_named(make, arguments, arguments)
    if camera is None or camera.width * camera.height > 100:
        return
    gbuffer = random_gbuffer(np.random.default_rng(5), (camera.height, camera.width))
    method = data.draw(st.sampled_from(METHODS))
    settings = make_settings(rays=2, bounces=2, filter=True)
    settings = replace(settings, diffuse=replace(settings.diffuse, method=method))
    sky = Environment.equirectangular(np.random.default_rng(6).random((4, 8, 3)), camera.world_from_view)
    assert_picture(gbuffer, render_indirect(gbuffer, camera, settings, sky))
    # The same camera as another view, and seen by one
    plain = fuzz.plain_camera((4, 5), data.draw(st.booleans()))
    frame = random_gbuffer(np.random.default_rng(7), (4, 5))
    assert_picture(frame, render_indirect(frame, plain, settings, sky, [(gbuffer, camera)]))
    assert_picture(gbuffer, render_indirect(gbuffer, camera, settings, sky, [(frame, plain)]))


@given(st.data())
@examples(max_examples=40)
def test_any_views_and_fill_give_light_in_range(data):
    shape = data.draw(st.sampled_from([(4, 5), (9, 3), (16, 17)]))
    gbuffer = data.draw(fuzz.gbuffers(shape))
    camera = fuzz.plain_camera(shape, data.draw(st.booleans()))
    other = data.draw(st.sampled_from([(4, 4), (3, 8)]))
    rng = np.random.default_rng(data.draw(fuzz.SEEDS))
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pose[:3, 3] = rng.normal(size=3)
    view_camera = replace(fuzz.plain_camera(other, data.draw(st.booleans())), world_from_view=pose)
    fill = Fill(
        data.draw(fuzz.images(other, 1.0, 9.0)),
        data.draw(fuzz.images((*other, 3), -1.0, 1.0)),
        data.draw(fuzz.images((*other, 3), 0.0, 2.0)),
        data.draw(fuzz.images((*other, 3), 0.0, 2.0)),
        fuzz.plain_camera(other, data.draw(st.booleans())),
        data.draw(st.one_of(fuzz.images(other, 1.0, 9.0), st.just(4.0))),
        is_denoised=data.draw(st.booleans()),
    )
    views = [(data.draw(fuzz.gbuffers(other)), view_camera)]
    light = render_indirect(
        gbuffer, camera, data.draw(fuzz.settings()), data.draw(fuzz.skies()), views, fill=fill
    )
    assert_picture(gbuffer, light)


@given(st.data())
@examples(max_examples=40)
def test_any_environment_is_refused_by_name_or_lights_a_frame(data):
    gbuffer, camera = uniform_gbuffer((3, 4)), Camera.perspective(4, 3, 1.0)
    shape = data.draw(st.sampled_from([(1, 1), (2, 9), (6, 5)]))
    if data.draw(st.booleans()):
        colour = data.draw(st.lists(st.sampled_from([*fuzz.GARBAGE, 0.5]), min_size=2, max_size=4))
        sky = made_or_named(Environment.constant, {"rgb": colour}, ["rgb"])
    else:
        image = st.one_of(fuzz.images((*shape, 3), 0.0, 2.0), fuzz.no_images((*shape, 3)))
        arguments = {"image": data.draw(image), "world_from_view": data.draw(fuzz.poses())}
        sky = made_or_named(Environment.equirectangular, arguments, arguments)
    if sky is not None:
        assert_picture(gbuffer, render_indirect(gbuffer, camera, data.draw(fuzz.settings()), sky))


@given(st.data())
@examples(max_examples=40)
def test_damage_of_a_bad_pixel_stays_in_its_pixel_whatever_the_settings(data):
    """A frame with a bad pixel has the light of the frame in which that pixel is black, or background."""
    shape = data.draw(st.sampled_from([(12, 15), (17, 16), (3, 5)]))
    rng = np.random.default_rng(data.draw(fuzz.SEEDS))
    gbuffer = replace(random_gbuffer(rng, shape), thickness=rng.random(shape))
    name = data.draw(
        st.sampled_from(["depth", "normal", "albedo", "specular", "roughness", "direct", "source"])
    )
    bad = data.draw(st.sampled_from([value for value in BAD if (name, value) not in MEANT]))
    at = data.draw(st.integers(0, shape[0] - 1)), data.draw(st.integers(0, shape[1] - 1))
    images = {}
    for value in (bad, np.inf if name == "depth" else 0.0):
        image = getattr(gbuffer, name).copy()
        image[at] = value
        images[value] = replace(gbuffer, **{name: image})
    settings, sky = data.draw(fuzz.settings()), data.draw(fuzz.skies())
    camera = fuzz.plain_camera(shape, data.draw(st.booleans()))
    found, expected = (render_indirect(frame, camera, settings, sky) for frame in images.values())
    assert_in_range(found)
    assert_same(found, expected)


@pytest.mark.parametrize("wrong", [None, "light", np.ones((3, 4, 3))])
def test_composite_names_what_is_no_frame_and_no_light(wrong):
    gbuffer = uniform_gbuffer((3, 4))
    light = render_indirect(gbuffer, Camera.perspective(4, 3, 1.0), make_settings(rays=1))
    with pytest.raises(ValueError, match=r"^light: expected .*got"):
        composite(gbuffer, wrong)
    with pytest.raises(ValueError, match=r"^gbuffer: expected .*got"):
        composite(wrong, light)


def test_bright_and_dark_extremes_of_good_values_give_light_in_range(rng):
    """Everything that counts as good at its brightest: no sum and no square leaves the range of float32."""
    shape = (9, 12)
    plain = random_gbuffer(rng, shape)
    bright = np.full((*shape, 3), 9.9e14)
    for albedo in (bright, bright * 1e-10):
        gbuffer = replace(
            plain, albedo=albedo, specular=bright, direct=bright, source=bright, glossy_source=bright,
            reflectance=albedo,
        )  # fmt: skip
        for method in METHODS:
            settings = make_settings(rays=3, bounces=6, filter=True, glossy={"reuse": 4, "hidden_light": 1.0})
            settings = replace(settings, diffuse=replace(settings.diffuse, method=method))
            sky = Environment.constant((9.9e14,) * 3)
            assert_picture(gbuffer, render_indirect(gbuffer, Camera.perspective(12, 9, 1.0), settings, sky))


def test_absurd_sizes_are_lit(rng):
    """A prime number of pixels, one row or column of many, and a frame that ends one pixel after a tile."""
    for shape in ((1, 4099), (4099, 1), (127, 131), (257, 129), (2, 1025)):
        gbuffer = random_gbuffer(rng, shape)
        light = render_indirect(
            gbuffer, fuzz.plain_camera(shape, False), make_settings(rays=1, filter=True), WHITE
        )
        assert_picture(gbuffer, light)
        assert all(getattr(light, name).shape[:2] == shape for name in IMAGES)


def test_a_frame_one_pixel_wider_and_higher_than_full_hd_is_lit():
    shape = (1081, 1921)
    tilted = np.broadcast_to([0.0, 0.6, 0.8], (*shape, 3))
    gbuffer = uniform_gbuffer(shape, np.linspace(9.0, 2.0, shape[0])[:, None], normal=tilted)
    settings = make_settings(rays=1, filter=True, reflections=False)
    settings = replace(settings, diffuse=replace(settings.diffuse, resolution="quarter"))
    light = render_indirect(gbuffer, fuzz.plain_camera(shape, False), settings, WHITE)
    assert_picture(gbuffer, light)
    assert light.diffuse[-1, -1].max() > 0.0
