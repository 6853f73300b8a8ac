# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG files from arrays, with nothing but the standard library."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .files import replacing

SIGNATURE = b"\x89PNG\r\n\x1a\n"
FILTER_UP = 2


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
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.size == 0 or rgb.dtype != np.uint8:
        raise ValueError(f"rgb: expected (H, W, 3) uint8, got {rgb.shape} {rgb.dtype}")
    height, width = rgb.shape[:2]
    header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    parts = [
        SIGNATURE,
        _chunk(b"IHDR", header),
        _chunk(b"sRGB", b"\0"),
        _chunk(b"IDAT", zlib.compress(_filtered_rows(rgb), 6)),
        _chunk(b"IEND", b""),
    ]
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(b"".join(parts))


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
