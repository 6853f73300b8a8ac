# SPDX-License-Identifier: GPL-3.0-or-later
import os
import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ssgi_addon import png
from ssgi_addon.errors import SSGIError
from ssgi_addon.png import write_png
from tests.budget import examples


def read_png(path):
    """Decode what `write_png` writes, by the PNG specification: filters none and up."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed, width, height = 8, b"", 0, 0
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length)[0] == zlib.crc32(kind + body)
        if kind == b"IHDR":
            width, height, depth, color, *rest = struct.unpack(">2I5B", body)
            assert (depth, color, rest) == (8, 2, [0, 0, 0])
        packed += body if kind == b"IDAT" else b""
        at += 12 + length
    assert kind == b"IEND"
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 3 * width)
    picture = np.zeros((height, 3 * width), np.uint8)
    for y, row in enumerate(rows):
        above = picture[y - 1] if y else np.zeros(3 * width, np.uint8)
        picture[y] = row[1:] + {0: np.uint8(0), 2: above}[row[0]]
    return picture.reshape(height, width, 3)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (5, 3), (61, 127)])
def test_picture_reads_back(tmp_path, rng, size):
    picture = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", picture)
    np.testing.assert_array_equal(read_png(tmp_path / "a.png"), picture)


def test_strided_picture_reads_back(tmp_path, rng):
    picture = rng.integers(0, 256, (10, 20, 3), dtype=np.uint8)[::-2, ::3]
    write_png(tmp_path / "a.png", picture)
    np.testing.assert_array_equal(read_png(tmp_path / "a.png"), picture)


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((2, 2), np.uint8),
        np.zeros((2, 2, 4), np.uint8),
        np.zeros((2, 2, 3), np.float32),
        np.zeros((0, 2, 3), np.uint8),
    ],
)
def test_other_arrays_are_refused(tmp_path, picture):
    with pytest.raises(ValueError, match="rgb: expected"):
        write_png(tmp_path / "a.png", picture)
    assert os.listdir(tmp_path) == []


def test_unwritable_folder_is_one_clear_line(read_only_folder):
    with pytest.raises(SSGIError, match="cannot write"):
        write_png(read_only_folder / "a.png", np.zeros((1, 1, 3), np.uint8))


def pack(rows, width, kind=(8, 2, 0, 0, 0)):
    """A PNG file of filtered rows, as another program might write it: pixels in two pieces."""

    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    packed = zlib.compress(b"".join(rows))
    parts = [chunk(b"IHDR", struct.pack(">2I5B", width, len(rows), *kind)), chunk(b"tEXt", b"a\0b")]
    parts += [chunk(b"IDAT", packed[:5]), chunk(b"IDAT", packed[5:]), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@given(arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3))))
@examples(50)
def test_any_picture_is_read_as_it_was_written(picture):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.png"
        write_png(path, picture)
        np.testing.assert_array_equal(png.read_png(path), picture)
        np.testing.assert_array_equal(read_png(path), picture)


@given(
    arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3))),
    st.lists(st.sampled_from([png.FILTER_NONE, png.FILTER_UP]), min_size=9, max_size=9),
)
@examples(50)
def test_rows_of_both_kinds_are_read(picture, kinds):
    rows = picture.reshape(picture.shape[0], -1)
    above = np.vstack([np.zeros_like(rows[:1]), rows[:-1]])
    filtered = [
        bytes([kind]) + (row if kind == png.FILTER_NONE else row - up).tobytes()
        for kind, row, up in zip(kinds, rows, above)
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.png"
        path.write_bytes(pack(filtered, picture.shape[1]))
        np.testing.assert_array_equal(png.read_png(path), picture)


@given(st.data())
@examples(100)
def test_damaged_file_is_one_clear_line_or_a_picture(data):
    whole = png.png_bytes(np.arange(60, dtype=np.uint8).reshape(4, 5, 3))
    at = data.draw(st.integers(0, len(whole) - 1))
    damaged = data.draw(
        st.sampled_from([whole[:at], whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :], whole[at:]])
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.png"
        path.write_bytes(damaged)
        if damaged == whole:
            return
        with pytest.raises(SSGIError, match="cannot read .*a.png"):
            png.read_png(path)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"not a picture", "no PNG"),
        (pack([b"\1" + bytes(6)], 2), "another way"),
        (pack([b"\0" + bytes(8)], 2, (8, 6, 0, 0, 0)), "not of the kind"),
        (pack([b"\0" + bytes(6)], 2, (8, 2, 0, 0, 1)), "not of the kind"),
        (pack([b"\0" + bytes(6)], 3_000_000_000), "not of the kind"),
        (pack([b"\0" + bytes(6)] * 2, 1), "pixels are damaged"),
        (pack([b"\0"], 1), "pixels are damaged"),
    ],
)
def test_other_files_are_one_clear_line(tmp_path, data, why):
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(SSGIError, match=why):
        png.read_png(tmp_path / "a.png")


def test_missing_file_is_one_clear_line(tmp_path):
    with pytest.raises(SSGIError, match="cannot read"):
        png.read_png(tmp_path / "a.png")
