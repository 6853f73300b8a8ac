# SPDX-License-Identifier: GPL-3.0-or-later
import os
import struct
import zlib

import numpy as np
import pytest

from ssgi_addon.errors import SSGIError
from ssgi_addon.png import write_png


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
