# SPDX-License-Identifier: GPL-3.0-or-later
import json
import os
from dataclasses import fields, replace

import numpy as np
import pytest

from ssgi_addon.core import Camera, Environment, Fill, GBuffer, Settings
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import write_layers
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import read_passes, remembered_settings, write_passes
from ssgi_addon.surface_light import handed_on
from tests.tolerances import SOLVED_POSE_PX, SOLVED_ROTATION, UNIT_NORMAL

pytest.importorskip("OpenEXR")

HEIGHT, WIDTH = 24, 32


def random_gbuffer(rng, height=HEIGHT, width=WIDTH, **more):
    normal = rng.normal(size=(height, width, 3))
    depth = rng.uniform(1, 9, (height, width))
    depth[:2], normal[:2] = np.inf, 0.0
    colors = {name: rng.gamma(0.5, 1.0, (height, width, 3)) for name in ("albedo", "specular", "direct")}
    return GBuffer(depth=depth, normal=normal, roughness=rng.uniform(0, 1, depth.shape), **colors, **more)


def random_fill(rng, camera):
    surfaces = random_gbuffer(rng, camera.height, camera.width)
    samples = rng.uniform(1, 9, surfaces.shape)
    lights = surfaces.direct, surfaces.albedo
    return Fill(surfaces.depth, surfaces.normal, *lights, camera, samples, is_denoised=True)


@pytest.fixture
def camera(rng):
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    pose[:3, 3] = 1 / 3, -2 / 7, np.pi
    return Camera.perspective(
        WIDTH, HEIGHT, 0.9, shift_px=(1 / 3, -2.1), pixel_aspect=1.1, world_from_view=pose
    )


@pytest.fixture
def plain_frame(rng, camera):
    return CapturedFrame(random_gbuffer(rng), camera, None, "cycles", True, True)


@pytest.fixture
def full_frame(rng, camera):
    more = {name: rng.gamma(0.5, 1.0, (HEIGHT, WIDTH, 3)) for name in ("source", "glossy_source")}
    thickness = rng.uniform(0, 1, (HEIGHT, WIDTH))
    thickness[4, 4] = np.inf
    behind = random_gbuffer(rng, behind=random_gbuffer(rng, source=more["source"]))
    side = Camera.orthographic(8, 6, 3.3, world_from_view=camera.world_from_view)
    return CapturedFrame(
        gbuffer=random_gbuffer(rng, thickness=thickness, behind=behind, **more),
        camera=camera,
        environment=Environment.equirectangular(rng.uniform(0, 9, (8, 16, 3)), camera.world_from_view),
        engine="eevee",
        emission_in_direct=False,
        world_in_direct=False,
        views=(
            (random_gbuffer(rng, 6, 8), side),
            (random_gbuffer(rng, 6, 8, thickness=np.ones((6, 8))), side),
        ),
        layers={"Diffuse Direct": more["source"].astype(np.float32), "Mist": thickness.astype(np.float32)},
        seconds={"geometry": 0.1, "light": 1 / 3},
        notes=("3 materials transmit light: ±",),
        fill=random_fill(rng, side),
    )


def assert_same_gbuffer(found, expected):
    for item in fields(GBuffer):
        a, b = getattr(found, item.name), getattr(expected, item.name)
        if item.name == "behind" and b is not None:
            assert_same_gbuffer(a, b)
        elif b is None:
            assert a is None
        else:
            assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), item.name


def assert_same_camera(found, expected):
    for item in fields(Camera):
        np.testing.assert_array_equal(getattr(found, item.name), getattr(expected, item.name))


def assert_same_fill(found, expected):
    if expected is None:
        assert found is None
        return
    assert_same_camera(found.camera, expected.camera)
    for name in ("depth", "normal", "diffuse", "glossy", "samples"):
        a, b = getattr(found, name), getattr(expected, name)
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), name
    assert found.is_denoised == expected.is_denoised


@pytest.mark.parametrize("name", ["plain_frame", "full_frame"])
def test_frame_reads_back_bit_by_bit(tmp_path, request, name):
    frame = request.getfixturevalue(name)
    found = read_passes(write_passes(frame, tmp_path / "passes", "scene_0001"))
    assert_same_gbuffer(found.gbuffer, frame.gbuffer)
    assert_same_camera(found.camera, frame.camera)
    assert len(found.views) == len(frame.views)
    for (found_gbuffer, found_camera), (gbuffer, camera) in zip(found.views, frame.views):
        assert_same_gbuffer(found_gbuffer, gbuffer)
        assert_same_camera(found_camera, camera)
    if frame.environment is None:
        assert found.environment is None
    else:
        np.testing.assert_array_equal(found.environment.image, frame.environment.image)
        np.testing.assert_array_equal(found.environment.world_from_view, frame.environment.world_from_view)
    assert_same_fill(found.fill, frame.fill)
    for attribute in ("engine", "emission_in_direct", "world_in_direct", "notes", "seconds"):
        assert getattr(found, attribute) == getattr(frame, attribute), attribute
    assert found.layers.keys() == frame.layers.keys()
    for layer, values in frame.layers.items():
        np.testing.assert_array_equal(found.layers[layer], values)


def test_file_names_are_the_stem(tmp_path, full_frame):
    write_passes(full_frame, tmp_path, "scene_0007")
    assert sorted(os.listdir(tmp_path)) == [
        "scene_0007.exr",
        "scene_0007.json",
        "scene_0007_environment.exr",
        "scene_0007_fill.exr",
        "scene_0007_view1.exr",
        "scene_0007_view2.exr",
    ]


def test_settings_are_remembered(tmp_path, plain_frame):
    base = Settings.preset("draft")
    settings = replace(base, seed=7, diffuse=replace(base.diffuse, rays=9), thickness=0.25, unknown="mean")
    path = write_passes(plain_frame, tmp_path, "a", settings)
    assert remembered_settings(path) == settings
    assert remembered_settings(write_passes(plain_frame, tmp_path, "b")) is None
    assert remembered_settings(tmp_path / "c.exr") is None


def test_unknown_settings_are_one_clear_line(tmp_path, plain_frame):
    path = write_passes(plain_frame, tmp_path, "a", Settings())
    data = json.loads(path.with_suffix(".json").read_text())
    data["settings"]["rays_of_tomorrow"] = 3
    path.with_suffix(".json").write_text(json.dumps(data))
    with pytest.raises(SSGIError, match="rays_of_tomorrow"):
        remembered_settings(path)


def test_camera_may_come_from_another_file(tmp_path, plain_frame, camera):
    path = write_passes(plain_frame, tmp_path, "a")
    moved = replace(camera, fx=camera.fx * 2)
    other = write_passes(replace(plain_frame, camera=moved), tmp_path, "b")
    assert_same_camera(read_passes(path, other.with_suffix(".json")).camera, moved)


def test_passes_without_their_json_are_refused(tmp_path, plain_frame):
    path = write_passes(plain_frame, tmp_path, "a")
    path.with_suffix(".json").unlink()
    with pytest.raises(SSGIError, match=r"needs a\.json"):
        read_passes(path)


def change(data, *keys, value=None):
    for key in keys[:-1]:
        data = data[key]
    if value is None:
        del data[keys[-1]]
    else:
        data[keys[-1]] = value


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("camera", "fx"), None),
        (("camera", "fx"), 0.0),
        (("camera", "fx"), "wide"),
        (("camera", "projection"), "panoramic"),
        (("camera", "world_from_view"), [[1, 0], [0, 1]]),
        (("camera", "width"), -3),
        (("camera",), [1, 2]),
        (("engine",), None),
        (("version",), 99),
        (("layers",), ["Mist"]),
        (("views",), [{"passes": "a.exr"}]),
        (("views",), [{"passes": "missing.exr", "camera": {}}]),
    ],
)
def test_damaged_json_is_one_clear_line(tmp_path, plain_frame, keys, value):
    path = write_passes(plain_frame, tmp_path, "a")
    data = json.loads(path.with_suffix(".json").read_text())
    change(data, *keys, value=value)
    path.with_suffix(".json").write_text(json.dumps(data))
    with pytest.raises(SSGIError) as raised:
        read_passes(path)
    assert str(tmp_path) in str(raised.value)


def blender_passes(camera, rng, version="5.2"):
    """The passes of a Cycles render as its EXR file has them."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    depth = 5.0 + np.sin(0.3 * x) + np.cos(0.2 * y)
    normal_vs = rng.normal(size=(HEIGHT, WIDTH, 3))
    normal_vs /= np.linalg.norm(normal_vs, axis=-1, keepdims=True)
    rotation = camera.world_from_view[:3, :3]
    layers = {
        "Depth": depth,
        "Position": camera.pixel_to_view(x, y, depth) @ rotation.T + camera.world_from_view[:3, 3],
        "Normal": normal_vs @ rotation.T,
        "SSGI Roughness": rng.uniform(0, 1, depth.shape),
    }
    light = ("Diffuse Color", "Diffuse Direct", "Glossy Color", "Glossy Direct", "Emission", "Environment")
    layers |= {name: rng.uniform(0, 1, (HEIGHT, WIDTH, 3)) for name in light}
    sky = np.s_[:3, :5]
    for name, values in layers.items():
        values[sky] = 1e10 if name == "Depth" else 0.0
    layers["Environment"][sky] = 2.0
    return {name: values.astype(np.float32) for name, values in layers.items()}, normal_vs


def test_blender_passes_become_a_frame(tmp_path, rng, camera):
    layers, normal_vs = blender_passes(camera, rng)
    write_layers(tmp_path / "a.exr", layers)
    frame = read_passes(tmp_path / "a.exr")
    gbuffer = frame.gbuffer
    assert frame.engine == "cycles"
    assert frame.emission_in_direct
    assert frame.world_in_direct
    assert gbuffer.is_background[:3, :5].all()
    assert gbuffer.is_background.sum() == 15
    is_surface = ~gbuffer.is_background
    np.testing.assert_allclose(gbuffer.normal[is_surface], normal_vs[is_surface], rtol=0, atol=UNIT_NORMAL)
    diffuse = layers["Diffuse Color"] * layers["Diffuse Direct"]
    glossy = layers["Glossy Color"] * layers["Glossy Direct"]
    np.testing.assert_array_equal(gbuffer.source, handed_on(layers, gbuffer.roughness))
    assert (gbuffer.reflectance >= layers["Diffuse Color"]).all()
    np.testing.assert_array_equal(gbuffer.glossy_source, diffuse + glossy)
    np.testing.assert_array_equal(
        gbuffer.direct, diffuse + glossy + layers["Emission"] + layers["Environment"]
    )
    np.testing.assert_array_equal(gbuffer.roughness, layers["SSGI Roughness"])
    np.testing.assert_allclose(
        [frame.camera.fx, frame.camera.fy, frame.camera.cx, frame.camera.cy],
        [camera.fx, camera.fy, camera.cx, camera.cy],
        rtol=0,
        atol=SOLVED_POSE_PX,
    )
    np.testing.assert_allclose(
        frame.camera.world_from_view, camera.world_from_view, rtol=0, atol=10 * SOLVED_ROTATION
    )


def test_light_through_glass_and_volumes_is_direct_light(tmp_path, rng, camera):
    layers, _ = blender_passes(camera, rng)
    write_layers(tmp_path / "a.exr", layers)
    more = ("Transmission Color", "Transmission Direct", "Transmission Indirect", "Volume Direct")
    glass = {name: rng.uniform(0, 1, (HEIGHT, WIDTH, 3)).astype(np.float32) for name in more}
    write_layers(tmp_path / "b.exr", layers | glass)
    added = read_passes(tmp_path / "b.exr").gbuffer.direct - read_passes(tmp_path / "a.exr").gbuffer.direct
    expected = glass["Volume Direct"] + glass["Transmission Color"] * (
        glass["Transmission Direct"] + glass["Transmission Indirect"]
    )
    np.testing.assert_allclose(added, expected, rtol=0, atol=1e-6)


def test_combined_without_its_bounces_serves_where_emission_is_missing(tmp_path, rng, camera):
    layers, _ = blender_passes(camera, rng)
    write_layers(tmp_path / "a.exr", layers)
    direct = read_passes(tmp_path / "a.exr").gbuffer.direct
    bounces = {
        name: rng.uniform(0, 1, (HEIGHT, WIDTH, 3)).astype(np.float32) for name in ("Diffuse", "Glossy")
    }
    layers["Combined"] = direct.copy()
    for name, values in bounces.items():
        layers[f"{name} Indirect"] = values
        layers["Combined"] += values * layers[f"{name} Color"]
    del layers["Emission"], layers["Environment"]
    write_layers(tmp_path / "b.exr", layers)
    np.testing.assert_allclose(read_passes(tmp_path / "b.exr").gbuffer.direct, direct, rtol=0, atol=1e-6)


def test_denoising_roughness_is_unmixed(tmp_path, rng, camera):
    layers, _ = blender_passes(camera, rng)
    roughness = layers.pop("SSGI Roughness")
    diffuse, glossy = (layers[f"{name} Color"].mean(axis=-1) for name in ("Diffuse", "Glossy"))
    total = np.maximum(diffuse + glossy, 1e-6)
    layers["Denoising Roughness"] = (diffuse + roughness * glossy) / total
    write_layers(tmp_path / "a.exr", layers)
    found = read_passes(tmp_path / "a.exr").gbuffer.roughness
    has_gloss = glossy > 0.1
    np.testing.assert_allclose(found[has_gloss], roughness[has_gloss], rtol=0, atol=1e-5)
    assert (found[glossy == 0.0] == 1.0).all()


def test_missing_roughness_is_said(tmp_path, rng, camera):
    layers, _ = blender_passes(camera, rng)
    del layers["SSGI Roughness"]
    write_layers(tmp_path / "a.exr", layers)
    frame = read_passes(tmp_path / "a.exr")
    assert (frame.gbuffer.roughness == 0.5).all()
    assert any("roughness" in note for note in frame.notes)


def test_each_missing_pass_is_named(tmp_path, rng, camera):
    layers, _ = blender_passes(camera, rng)
    for name in ("Normal", "Glossy Direct", "Emission"):
        del layers[name]
    write_layers(tmp_path / "a.exr", layers)
    with pytest.raises(SSGIError, match="lacks the passes Normal, Glossy Direct, Emission: switch them on"):
        read_passes(tmp_path / "a.exr")


def test_position_is_not_needed_where_the_camera_is_given(tmp_path, rng, camera, plain_frame):
    layers, _ = blender_passes(camera, rng)
    del layers["Position"]
    write_layers(tmp_path / "a.exr", layers)
    with pytest.raises(SSGIError, match="lacks the pass Position: .*--camera"):
        read_passes(tmp_path / "a.exr")
    own = write_passes(plain_frame, tmp_path, "own")
    own.with_suffix(".json").rename(tmp_path / "camera.json")
    data = json.loads((tmp_path / "camera.json").read_text())
    (tmp_path / "camera.json").write_text(json.dumps(data["camera"]))
    assert_same_camera(read_passes(tmp_path / "a.exr", tmp_path / "camera.json").camera, camera)


def test_camera_of_another_picture_is_refused(tmp_path, rng, camera, plain_frame):
    layers, _ = blender_passes(camera, rng)
    write_layers(tmp_path / "a.exr", layers)
    smaller = replace(camera, width=WIDTH // 2)
    own = write_passes(replace(plain_frame, camera=smaller), tmp_path, "own")
    (tmp_path / "camera.json").write_text(
        json.dumps({"camera": json.loads(own.with_suffix(".json").read_text())["camera"]})
    )
    with pytest.raises(SSGIError, match="use the camera of this picture"):
        read_passes(tmp_path / "a.exr", tmp_path / "camera.json")


def test_unsolvable_pose_is_one_clear_line(tmp_path, rng, camera):
    layers, _ = blender_passes(camera, rng)
    layers["Position"] = rng.uniform(0, 1, layers["Position"].shape).astype(np.float32)
    write_layers(tmp_path / "a.exr", layers)
    with pytest.raises(SSGIError, match="no perspective or orthographic camera fits .*--camera"):
        read_passes(tmp_path / "a.exr")


def test_the_view_layer_that_has_the_passes_is_taken(tmp_path, rng, camera):
    import OpenEXR

    layers, _ = blender_passes(camera, rng)
    channels = {f"Composite.Combined.{letter}": np.zeros((HEIGHT, WIDTH), np.float32) for letter in "RGBA"}
    for name, values in layers.items():
        letters = "V" if values.ndim == 2 else "XYZ" if name in ("Normal", "Position") else "RGB"
        planes = values[..., None] if values.ndim == 2 else values
        channels |= {
            f"My.Layer.{name}.{letter}": np.ascontiguousarray(planes[..., i])
            for i, letter in enumerate(letters)
        }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_passes(tmp_path / "a.exr").gbuffer.albedo, layers["Diffuse Color"])
