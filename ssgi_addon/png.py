# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG files from arrays, with nothing but the standard library."""

from __future__ import annotations

import itertools
import struct
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .core.camera import LARGEST_SIDE
from .errors import SSGIError
from .files import replacing

SIGNATURE = b"\x89PNG\r\n\x1a\n"
FILTER_NONE, FILTER_UP = 0, 2
# 8 bits a channel, red, green and blue, packed and filtered in the only ways there are, not interlaced
_KIND = (8, 2, 0, 0, 0)


def write_png(path: Path | str, rgb: npt.NDArray[np.uint8]) -> None:
    """Write an sRGB picture, 8 bits a channel, whole or not at all.

    Parameters
    ----------
    path
        The file.
    rgb : (H, W, 3) uint8
        Display-referred, top row first.

    Raises
    ------
    ValueError
        If `rgb` is no ``(H, W, 3)`` array of uint8 with at least one pixel.
    SSGIError
        If the file cannot be written.
    """
    packed = png_bytes(rgb)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(packed)


def png_bytes(rgb: npt.NDArray[np.uint8]) -> bytes:
    """Return what `write_png` writes.

    Raises
    ------
    ValueError
        As there.
    """
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.size == 0 or rgb.dtype != np.uint8:
        raise ValueError(f"rgb: expected (H, W, 3) uint8, got {rgb.shape} {rgb.dtype}")
    height, width = rgb.shape[:2]
    parts = [
        SIGNATURE,
        _chunk(b"IHDR", struct.pack(">2I5B", width, height, *_KIND)),
        _chunk(b"sRGB", b"\0"),
        _chunk(b"IDAT", zlib.compress(_filtered_rows(rgb), 6)),
        _chunk(b"IEND", b""),
    ]
    return b"".join(parts)


def read_png(path: Path | str) -> npt.NDArray[np.uint8]:
    """Read a picture that `write_png` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    (H, W, 3) uint8
        Display-referred, top row first.

    Raises
    ------
    SSGIError
        If the file is missing or damaged, or another program wrote it in another way.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SSGIError(f"cannot read {path}: {error.strerror or error}; check the path") from error
    try:
        return _decode(data)
    except (ValueError, struct.error, zlib.error) as error:
        raise SSGIError(f"cannot read {path}: {error}; write the picture again") from error


def _decode(data: bytes) -> npt.NDArray[np.uint8]:
    chunks = _chunks(data)
    width, height, *kind = struct.unpack(">2I5B", chunks.get(b"IHDR", b""))
    if tuple(kind) != _KIND or not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise ValueError("it is not of the kind that this program writes")
    size = height * (1 + 3 * width)
    # A few bytes may unpack to endlessly many
    filtered = zlib.decompressobj().decompress(chunks.get(b"IDAT", b""), size + 1)
    if len(filtered) != size:
        raise ValueError("its pixels are damaged")
    rows = np.frombuffer(filtered, np.uint8).reshape(height, -1)
    kinds, picture = rows[:, 0], rows[:, 1:].copy()
    if not np.isin(kinds, (FILTER_NONE, FILTER_UP)).all():
        raise ValueError("its rows are packed in another way than this program packs them")
    # Between rows that stand for themselves each one is the sum of those above, modulo 256
    starts = np.flatnonzero(kinds == FILTER_NONE)
    for begin, end in itertools.pairwise((0, *starts[starts > 0], height)):
        np.add.accumulate(picture[begin:end], axis=0, out=picture[begin:end])
    return picture.reshape(height, width, 3)


def _chunks(data: bytes) -> dict[bytes, bytes]:
    """Return the chunks of a whole file by their kinds; those of one kind are joined."""
    if not data.startswith(SIGNATURE):
        raise ValueError("it is no PNG file")
    chunks: dict[bytes, bytes] = {}
    at = len(SIGNATURE)
    while b"IEND" not in chunks:
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + length]
        (check,) = struct.unpack_from(">I", data, at + 8 + length)
        if check != zlib.crc32(kind + body):
            raise ValueError("it is damaged")
        chunks[kind] = chunks.get(kind, b"") + body
        at += 12 + length
    return chunks


def check_whole(path: Path | str) -> None:
    """Look at a PNG that Blender has written: where the disk fills up it says nothing.

    Raises
    ------
    OSError
        If the end is missing.
    """
    end = _chunk(b"IEND", b"")
    if not Path(path).read_bytes().endswith(end):
        raise OSError("it came out incomplete, as on a full disk")


def _filtered_rows(rgb: npt.NDArray[np.uint8]) -> bytes:
    """Each row as the difference to the row above (PNG specification, 9.2): smooth pictures pack smaller."""
    rows = rgb.reshape(rgb.shape[0], -1)
    filtered = np.empty((rows.shape[0], rows.shape[1] + 1), np.uint8)
    filtered[:, 0] = FILTER_UP
    filtered[0, 1:] = rows[0]
    filtered[1:, 1:] = rows[1:] - rows[:-1]  # modulo 256, as the format wants
    return filtered.tobytes()


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
