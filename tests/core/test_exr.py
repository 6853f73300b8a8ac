# SPDX-License-Identifier: GPL-3.0-or-later
import os
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ssgi_addon import exr
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import read_layers, write_layers
from tests.tolerances import HALF_RELATIVE

OpenEXR = pytest.importorskip("OpenEXR")


@pytest.fixture
def layers(rng):
    combined = rng.normal(0, 10, (9, 16, 3)).astype(np.float32)
    visibility = rng.uniform(0, 1, (9, 16)).astype(np.float32)
    combined[0, 0] = np.inf, -np.inf, np.nan
    visibility[1, 1] = 1e-42  # a denormal number
    return {"combined": combined, "visibility": visibility}


def write_raw(path, channels, compression=OpenEXR.ZIP_COMPRESSION, **header):
    OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage, **header}, channels).write(
        str(path)
    )


def assert_same_bits(found, expected):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert found[name].dtype == np.float32
        assert found[name].shape == values.shape
        assert found[name].flags.c_contiguous
        assert found[name].tobytes() == values.tobytes()


def test_layers_read_back_bit_by_bit(tmp_path, layers):
    write_layers(tmp_path / "a.exr", layers)
    assert_same_bits(read_layers(tmp_path / "a.exr"), layers)


@pytest.mark.parametrize("size", [(1, 1), (1, 37), (37, 1), (17, 3)])
def test_odd_sizes_read_back(tmp_path, rng, size):
    layers = {"depth": rng.uniform(1, 2, size).astype(np.float32)}
    write_layers(tmp_path / "a.exr", layers)
    assert_same_bits(read_layers(tmp_path / "a.exr"), layers)


def test_strided_arrays_of_other_types_are_written(tmp_path):
    values = np.arange(60, dtype=np.float64).reshape(3, 4, 5)[:, ::-1, :3]
    write_layers(tmp_path / "a.exr", {"combined": values})
    np.testing.assert_array_equal(read_layers(tmp_path / "a.exr")["combined"], values)


def test_channel_names_are_those_that_blender_splits(tmp_path, layers):
    write_layers(tmp_path / "a.exr", layers)
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    assert len(file.parts) == 1
    assert sorted(file.channels()) == [
        "ssgi.combined.B",
        "ssgi.combined.G",
        "ssgi.combined.R",
        "ssgi.visibility.V",
    ]


def test_letters_and_compression_are_those_asked_for(tmp_path, layers):
    motion = np.arange(4 * layers["visibility"].size, dtype=np.float32).reshape(
        *layers["visibility"].shape, 4
    )
    layers = {**layers, "Vector": motion}
    write_layers(tmp_path / "a.exr", layers, letters={"Vector": "XYZW"}, is_lasting=False)
    header = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    assert {f"ssgi.Vector.{letter}" for letter in "XYZW"} <= header.channels().keys()
    assert header.header()["compression"] == OpenEXR.NO_COMPRESSION
    assert_same_bits(read_layers(tmp_path / "a.exr"), layers)


def test_letters_that_do_not_fit_are_refused(tmp_path, layers):
    with pytest.raises(ValueError, match=r"'combined': expected \(H, W, 4\)"):
        write_layers(tmp_path / "a.exr", layers, letters={"combined": "XYZW"})


def test_metadata_is_in_the_header(tmp_path, layers):
    write_layers(tmp_path / "a.exr", layers, {"software": "ssgi 1.2.3"})
    assert OpenEXR.File(str(tmp_path / "a.exr")).header()["software"] == "ssgi 1.2.3"


def test_nothing_but_the_file_is_left(tmp_path, layers):
    write_layers(tmp_path / "a.exr", layers)
    write_layers(tmp_path / "a.exr", layers)
    assert os.listdir(tmp_path) == ["a.exr"]


def test_unwritable_folder_is_one_clear_line(read_only_folder, layers):
    with pytest.raises(SSGIError, match="cannot write"):
        write_layers(read_only_folder / "a.exr", layers)


@pytest.mark.parametrize(
    "layers",
    [
        {},
        {"a": np.zeros(3, np.float32)},
        {"a": np.zeros((2, 2, 4), np.float32)},
        {"a": np.zeros((2, 2), np.float32), "b": np.zeros((2, 3), np.float32)},
    ],
)
def test_layers_that_do_not_fit_are_refused(tmp_path, layers):
    with pytest.raises(ValueError, match="layer"):
        write_layers(tmp_path / "a.exr", layers)
    assert os.listdir(tmp_path) == []


def plane(value, dtype=np.float32):
    return np.full((4, 6), value, dtype)


def test_short_names_become_long_ones(tmp_path):
    channels = {f"View.Layer.DiffCol.{letter}": plane(i) for i, letter in enumerate("RGB")}
    channels |= {f"View.Layer.Combined.{letter}": plane(i) for i, letter in enumerate("RGBA")}
    channels |= {f"View.Layer.Normal.{letter}": plane(i) for i, letter in enumerate("XYZ")}
    channels["View.Layer.Depth.Z"] = plane(7)
    channels["View.Layer.Rough.X"] = plane(8)
    write_raw(tmp_path / "a.exr", channels)
    found = read_layers(tmp_path / "a.exr")
    assert found.keys() == {"Diffuse Color", "Combined", "Normal", "Depth", "Rough"}
    for name in ("Diffuse Color", "Combined", "Normal"):
        np.testing.assert_array_equal(found[name][0, 0], [0, 1, 2])
    assert found["Depth"][0, 0] == 7
    assert found["Rough"].shape == (4, 6)


def test_a_part_per_pass_reads_like_one_part(tmp_path):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [
        OpenEXR.Part(
            {**header, "name": "View.Layer.Diffuse Color"},
            {f"View.Layer.Diffuse Color.{letter}": plane(i) for i, letter in enumerate("RGB")},
        ),
        OpenEXR.Part({**header, "name": "View.Layer.Depth"}, {"View.Layer.Depth.Z": plane(7)}),
    ]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    found = read_layers(tmp_path / "a.exr")
    assert found.keys() == {"Diffuse Color", "Depth"}
    np.testing.assert_array_equal(found["Diffuse Color"][3, 5], [0, 1, 2])


def test_several_view_layers_keep_their_names(tmp_path):
    write_raw(tmp_path / "a.exr", {"Near.Depth.Z": plane(1), "Far.Depth.Z": plane(2)})
    assert read_layers(tmp_path / "a.exr").keys() == {"Near.Depth", "Far.Depth"}


def test_nameless_channels_are_combined_and_depth(tmp_path):
    write_raw(tmp_path / "a.exr", {letter: plane(i) for i, letter in enumerate("RGBAZ")})
    found = read_layers(tmp_path / "a.exr")
    assert found.keys() == {"Combined", "Depth"}
    np.testing.assert_array_equal(found["Combined"][0, 0], [0, 1, 2])


def test_half_floats_are_read(tmp_path, rng):
    values = rng.uniform(0.1, 100, (4, 6)).astype(np.float32)
    write_raw(tmp_path / "a.exr", {"known.V": values.astype(np.float16)})
    np.testing.assert_allclose(read_layers(tmp_path / "a.exr")["known"], values, rtol=HALF_RELATIVE)


def test_pixels_stand_where_the_display_window_has_them(tmp_path, rng):
    values = rng.uniform(1, 2, (4, 6)).astype(np.float32)
    windows = {
        "dataWindow": (np.array([3, -1], np.int32), np.array([8, 2], np.int32)),
        "displayWindow": (np.array([1, 0], np.int32), np.array([6, 4], np.int32)),
    }
    write_raw(tmp_path / "a.exr", {"known.V": values}, **windows)
    expected = np.zeros((5, 6), np.float32)
    expected[:3, 2:] = values[1:, :4]
    np.testing.assert_array_equal(read_layers(tmp_path / "a.exr")["known"], expected)


def test_data_window_outside_the_display_window_is_black(tmp_path):
    windows = {
        "dataWindow": (np.array([100, 100], np.int32), np.array([105, 103], np.int32)),
        "displayWindow": (np.array([0, 0], np.int32), np.array([5, 4], np.int32)),
    }
    write_raw(tmp_path / "a.exr", {"known.V": plane(1)}, **windows)
    np.testing.assert_array_equal(read_layers(tmp_path / "a.exr")["known"], np.zeros((5, 6)))


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"])
def test_every_compression_is_read(tmp_path, compression):
    values = np.tile(np.linspace(0, 1, 40, dtype=np.float16), (70, 1))
    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    write_raw(tmp_path / "a.exr", {"R": values, "G": values, "B": values}, kind)
    found = read_layers(tmp_path / "a.exr")["Combined"]
    assert np.abs(found - values[..., None]).max() < 0.05


def test_tiles_are_read(tmp_path, rng):
    values = rng.uniform(0, 1, (50, 70)).astype(np.float32)
    header = {
        "type": OpenEXR.tiledimage,
        "tiles": OpenEXR.TileDescription(),
        "compression": OpenEXR.ZIP_COMPRESSION,
    }
    OpenEXR.File(header, {"known.V": values}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_layers(tmp_path / "a.exr")["known"], values)


@pytest.fixture
def good_file(tmp_path, rng):
    path = tmp_path / "good.exr"
    write_layers(path, {"combined": rng.uniform(0, 1, (40, 30, 3)).astype(np.float32)})
    return path.read_bytes()


@pytest.mark.parametrize("share", [0.0, 0.001, 0.02, 0.1, 0.5, 0.9, 0.9999])
def test_truncated_file_is_one_clear_line(tmp_path, good_file, share, capfd):
    path = tmp_path / "a.exr"
    path.write_bytes(good_file[: int(share * len(good_file))])
    with pytest.raises(SSGIError, match="cannot read"):
        read_layers(path)
    assert capfd.readouterr() == ("", "")


def with_window(data, name, window):
    at = data.index(name + b"\0box2i\0") + len(name) + 7
    return data[: at + 4] + struct.pack("<4i", *window) + data[at + 20 :]


@pytest.mark.parametrize(
    "window",
    [
        (0, 0, 2**31 - 1, 2**31 - 1),
        (0, 0, 65535, 65535),
        (5, 0, 4, 39),
        (-(2**31), 0, 2**31 - 1, 1),
        (0, 0, 29, 60000),
    ],
)
@pytest.mark.parametrize("name", [b"dataWindow", b"displayWindow"])
def test_absurd_sizes_are_refused_before_anything_is_allocated(tmp_path, good_file, name, window):
    path = tmp_path / "a.exr"
    path.write_bytes(with_window(good_file, name, window))
    if (name, window) == (b"displayWindow", (0, 0, 29, 60000)):
        assert read_layers(path)["combined"].shape == (60001, 30, 3)  # odd, and small enough to be meant
        return
    with pytest.raises(SSGIError, match="cannot read"):
        read_layers(path)


def test_damaged_pixels_are_one_clear_line(tmp_path, good_file, capfd):
    path = tmp_path / "a.exr"
    damaged = bytearray(good_file)
    damaged[len(damaged) // 2 :] = bytes(len(damaged) - len(damaged) // 2)
    path.write_bytes(damaged)
    with pytest.raises(SSGIError, match="cannot read"):
        read_layers(path)
    assert capfd.readouterr() == ("", "")


def test_other_files_are_one_clear_line(tmp_path):
    (tmp_path / "a.exr").write_text("a text that is long enough")
    with pytest.raises(SSGIError, match="not an OpenEXR file"):
        read_layers(tmp_path / "a.exr")
    with pytest.raises(SSGIError, match="cannot read"):
        read_layers(tmp_path / "missing.exr")
    with pytest.raises(SSGIError, match="cannot read"):
        read_layers(tmp_path)


def test_more_than_a_file_of_its_size_can_hold_is_refused(tmp_path):
    """A megabyte is let through for small files, and what deflate could hold for larger ones."""
    path = tmp_path / "a.exr"
    write_layers(path, {"combined": np.zeros((40, 30, 3), np.float32)})
    small = path.read_bytes()
    for side, is_held in ((200, True), (400, False)):
        path.write_bytes(with_window(small, b"dataWindow", (0, 0, side - 1, side - 1)))
        with pytest.raises(SSGIError) as raised:
            read_layers(path)
        assert ("cannot hold" in str(raised.value)) != is_held


def test_black_picture_of_full_size_is_no_absurd_one(tmp_path):
    """Nothing shrinks further: a check that is too strict would refuse it."""
    layers = {name: np.zeros((1080, 1920, 3), np.float32) for name in ("combined", "direct", "albedo")}
    write_layers(tmp_path / "a.exr", layers)
    assert_same_bits(read_layers(tmp_path / "a.exr"), layers)


def test_what_is_printed_before_and_after_a_reading_is_printed(tmp_path, layers, capfd):
    write_layers(tmp_path / "a.exr", layers)
    print("before")
    read_layers(tmp_path / "a.exr")
    print("after")
    assert capfd.readouterr().out == "before\nafter\n"


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_fuzzed_file_ends_in_an_error_or_a_picture(tmp_path, good_file, data):
    changed = bytearray(good_file)
    header_end = 400
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, header_end) | st.integers(0, len(changed) - 1))
        changed[position] = data.draw(st.integers(0, 255))
    path = tmp_path / "fuzzed.exr"
    path.write_bytes(changed)
    try:
        found = read_layers(path)
    except SSGIError:
        return
    assert all(values.size < 1 << 26 for values in found.values())


@pytest.fixture
def openimageio(monkeypatch):
    pytest.importorskip("bpy")
    monkeypatch.setattr(exr, "_openexr", lambda: None)


def test_blenders_own_library_reads_what_openexr_wrote(tmp_path, layers, monkeypatch):
    pytest.importorskip("bpy")
    write_layers(tmp_path / "a.exr", layers)
    monkeypatch.setattr(exr, "_openexr", lambda: None)
    assert_same_bits(read_layers(tmp_path / "a.exr"), layers)


def test_openexr_reads_what_blenders_own_library_wrote(tmp_path, layers, monkeypatch):
    pytest.importorskip("bpy")
    with monkeypatch.context() as patch:
        patch.setattr(exr, "_openexr", lambda: None)
        write_layers(tmp_path / "a.exr", layers, {"software": "ssgi"})
    assert_same_bits(read_layers(tmp_path / "a.exr"), layers)
    assert OpenEXR.File(str(tmp_path / "a.exr")).header()["software"] == "ssgi"
    assert os.listdir(tmp_path) == ["a.exr"]


def test_blenders_own_library_refuses_damaged_pixels(tmp_path, good_file, openimageio, capfd):
    damaged = bytearray(good_file)
    damaged[len(damaged) // 2 :] = bytes(len(damaged) - len(damaged) // 2)
    (tmp_path / "a.exr").write_bytes(damaged)
    with pytest.raises(SSGIError, match="cannot read"):
        read_layers(tmp_path / "a.exr")
    assert capfd.readouterr() == ("", "")


def test_blenders_own_library_reports_an_unwritable_folder(read_only_folder, layers, openimageio):
    with pytest.raises(SSGIError, match="cannot write"):
        write_layers(read_only_folder / "a.exr", layers)
