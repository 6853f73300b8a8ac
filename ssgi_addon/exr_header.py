# SPDX-License-Identifier: GPL-3.0-or-later
"""Look at an EXR file's headers before a library allocates what they ask for.

The OpenEXR libraries trust the sizes in a header and read a truncated file as far as it goes, with
chatter on the terminal. This checks the file's structure first (OpenEXR file layout,
https://openexr.com/en/latest/OpenEXRFileLayout.html), so that a bad file ends in one clear line.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from .errors import SSGIError

MAGIC = b"\x76\x2f\x31\x01"
FLAG_TILED, FLAG_DEEP, FLAG_MULTIPART = 0x200, 0x800, 0x1000

# Scanlines in one chunk, by compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB
LINES_PER_CHUNK = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)
BYTES_PER_VALUE = (4, 2, 4)  # UINT, HALF, FLOAT

# An 8K x 4K frame with a hundred float channels is 13 GB; deflate, the strongest common compression,
# shrinks at most 1032 times. What claims more than both is not a picture.
LARGEST_SIDE = 65536
LARGEST_HEADER = 1 << 22
MODEST_BYTES = 1 << 28
STRONGEST_COMPRESSION = 1100

Box = tuple[int, int, int, int]  # x_min, y_min, x_max, y_max, all inclusive


@dataclass(frozen=True)
class PartHeader:
    """What one part of an EXR file says about itself."""

    channels: tuple[str, ...]
    data_window: Box
    display_window: Box
    bytes_per_pixel: int
    lines_per_chunk: int | None  # None: tiles, or a compression this does not know
    chunk_count: int | None  # as stated in the file

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the data window."""
        x_min, y_min, x_max, y_max = self.data_window
        return y_max - y_min + 1, x_max - x_min + 1


def read_headers(path: Path) -> list[PartHeader]:
    """Read and check the headers and the chunk tables of an EXR file.

    Raises
    ------
    SSGIError
        If the file cannot be read, is no flat image, claims an absurd size, or ends too early.
    """
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            return _read_checked(stream, size)
    except OSError as error:
        raise SSGIError(f"cannot read {path}: {error.strerror or error}; check the path") from error
    except _BadFileError as error:
        raise SSGIError(f"cannot read {path}: {error}") from error
    except (struct.error, IndexError, ValueError) as error:
        raise SSGIError(f"cannot read {path}: its header is damaged; write the file again") from error


class _BadFileError(Exception):
    """Why a file cannot be read; the caller adds its name."""


def _read_checked(stream: BinaryIO, size: int) -> list[PartHeader]:
    head = stream.read(8)
    if len(head) < 8 or head[:4] != MAGIC:
        raise _BadFileError("it is not an OpenEXR file")
    flags = struct.unpack("<I", head[4:])[0]
    if flags & FLAG_DEEP:
        raise _BadFileError("it holds deep data; flatten it first")
    parts: list[PartHeader] = []
    while (attributes := _read_attributes(stream)) or not parts:
        parts.append(_part(attributes, tiled=bool(flags & FLAG_TILED)))
        if not flags & FLAG_MULTIPART:
            break
    _check_sizes(parts, size)
    _check_chunks(stream, parts, size, multipart=bool(flags & FLAG_MULTIPART))
    return parts


def _read_attributes(stream: BinaryIO) -> dict[str, bytes]:
    attributes = {}
    while name := _read_name(stream):
        _read_name(stream)  # the attribute's type, which its name implies
        length = struct.unpack("<i", stream.read(4))[0]
        if not 0 <= length <= LARGEST_HEADER:
            raise _BadFileError("its header is damaged; write the file again")
        value = stream.read(length)
        if len(value) < length:
            raise _BadFileError("it ends inside its header; write the file again")
        attributes[name] = value
    return attributes


def _read_name(stream: BinaryIO) -> str:
    name = bytearray()
    while (byte := stream.read(1)) != b"\0":
        if not byte or len(name) >= 255:
            raise _BadFileError("it ends inside its header; write the file again")
        name += byte
    return name.decode("utf-8", "replace")


def _part(attributes: dict[str, bytes], *, tiled: bool) -> PartHeader:
    missing = {"channels", "compression", "dataWindow", "displayWindow"} - attributes.keys()
    if missing:
        raise _BadFileError(f"its header has no {' and no '.join(sorted(missing))}; write the file again")
    kind = attributes.get("type", b"")
    if kind.startswith(b"deep"):
        raise _BadFileError("it holds deep data; flatten it first")
    channels, bytes_per_pixel = _channels(attributes["channels"])
    compression = attributes["compression"][0]
    tiled = tiled or kind.startswith(b"tiled")
    known = not tiled and compression < len(LINES_PER_CHUNK)
    return PartHeader(
        channels=channels,
        data_window=struct.unpack("<4i", attributes["dataWindow"]),
        display_window=struct.unpack("<4i", attributes["displayWindow"]),
        bytes_per_pixel=bytes_per_pixel,
        lines_per_chunk=LINES_PER_CHUNK[compression] if known else None,
        chunk_count=struct.unpack("<i", attributes["chunkCount"])[0] if "chunkCount" in attributes else None,
    )


def _channels(data: bytes) -> tuple[tuple[str, ...], int]:
    """Names of the channels, and the bytes of one pixel over all of them."""
    names, bytes_per_pixel, at = [], 0, 0
    while data[at]:
        end = data.index(b"\0", at)
        kind, _linear, x_sampling, y_sampling = struct.unpack_from("<iB3x2i", data, end + 1)
        if (x_sampling, y_sampling) != (1, 1):
            raise _BadFileError("it holds subsampled channels; write it with full-size channels")
        names.append(data[at:end].decode("utf-8", "replace"))
        bytes_per_pixel += BYTES_PER_VALUE[kind]
        at = end + 17
    return tuple(names), bytes_per_pixel


def _check_sizes(parts: list[PartHeader], file_size: int) -> None:
    total = 0
    for part in parts:
        for window in (part.data_window, part.display_window):
            width, height = window[2] - window[0] + 1, window[3] - window[1] + 1
            if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
                raise _BadFileError(f"its header claims {width} x {height} pixels; write the file again")
            total += width * height * part.bytes_per_pixel
    # Both windows were counted: the pixels in the file, and the picture they are placed in.
    if total > max(MODEST_BYTES, 2 * STRONGEST_COMPRESSION * file_size):
        raise _BadFileError(f"its header claims {total >> 20} MB, which a file of its size cannot hold")


def _check_chunks(stream: BinaryIO, parts: list[PartHeader], file_size: int, *, multipart: bool) -> None:
    """Follow each part's chunk table; the chunk that lies last must end inside the file."""
    truncated = _BadFileError("it is not complete (the end is missing or was never written); write it again")
    last_chunks = []
    for part in parts:
        count = part.chunk_count
        if count is None:
            if part.lines_per_chunk is None:
                return  # tiles without a count: the library finds what is missing
            count = -(-part.shape[0] // part.lines_per_chunk)
        if not 0 < count <= file_size // 8:
            raise truncated
        table = stream.read(8 * count)
        if len(table) < 8 * count:
            raise truncated
        offsets = struct.unpack(f"<{count}Q", table)
        if min(offsets) == 0 or max(offsets) >= file_size:
            raise truncated
        if part.lines_per_chunk is not None:
            last_chunks.append(max(offsets))
    for offset in last_chunks:
        stream.seek(offset + (8 if multipart else 4))  # past the part number and the line
        length = stream.read(4)
        if len(length) < 4 or stream.tell() + struct.unpack("<i", length)[0] > file_size:
            raise truncated
