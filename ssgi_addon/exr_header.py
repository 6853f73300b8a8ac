# SPDX-License-Identifier: GPL-3.0-or-later
"""Look at an EXR file's headers before a library allocates what they ask for.

The OpenEXR libraries trust the sizes in a header and read a truncated file as far as it goes, with
chatter on the terminal. This checks the file's structure first (OpenEXR file layout,
https://openexr.com/en/latest/OpenEXRFileLayout.html), so that a bad file ends in one clear line.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from .core.camera import LARGEST_SIDE
from .errors import SSGIError

MAGIC = b"\x76\x2f\x31\x01"
FLAG_TILED, FLAG_DEEP, FLAG_MULTIPART = 0x200, 0x800, 0x1000

# Scanlines in one chunk, by compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB
LINES_PER_CHUNK = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)
BYTES_PER_VALUE = (4, 2, 4)  # UINT, HALF, FLOAT

LARGEST_HEADER = 1 << 22
MOST_CHANNELS = 16384
# Deflate shrinks at most 1032 times, and no compression up to PIZ does more: what claims to hold more is no
# picture. Those after it may, and a display window adds an empty margin for nothing: they may ask for the
# memory of a modest picture all the same.
SMALL_BYTES, MODEST_BYTES = 1 << 20, 1 << 28
STRONGEST_COMPRESSION, PIZ = 1100, 4

Box = tuple[int, int, int, int]  # x_min, y_min, x_max, y_max, all inclusive
Attributes = dict[str, tuple[str, bytes]]  # kind and value by name


@dataclass(frozen=True)
class PartHeader:
    """What one part of an EXR file says about itself."""

    channels: tuple[str, ...]
    data_window: Box
    display_window: Box
    bytes_per_pixel: int
    compression: int
    lines_per_chunk: int | None  # None: tiles, or a compression this does not know
    chunk_count: int | None  # as stated in the file
    tile: tuple[int, int] | None  # width and height
    texts: Mapping[str, str]  # attributes that are text

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture, the display window."""
        return _size(self.display_window)

    @property
    def rows(self) -> int:
        """Of the data window."""
        return _size(self.data_window)[1]


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


def _read_attributes(stream: BinaryIO) -> Attributes:
    attributes = {}
    while name := _read_name(stream):
        kind = _read_name(stream)
        length = struct.unpack("<i", stream.read(4))[0]
        if not 0 <= length <= LARGEST_HEADER:
            raise _BadFileError("its header is damaged; write the file again")
        value = stream.read(length)
        if len(value) < length:
            raise _BadFileError("it ends inside its header; write the file again")
        attributes[name] = kind, value
    return attributes


def _read_name(stream: BinaryIO) -> str:
    name = bytearray()
    while (byte := stream.read(1)) != b"\0":
        if not byte or len(name) >= 255:
            raise _BadFileError("it ends inside its header; write the file again")
        name += byte
    return name.decode("utf-8", "replace")


def _part(attributes: Attributes, *, tiled: bool) -> PartHeader:
    values = {name: value for name, (_, value) in attributes.items()}
    missing = {"channels", "compression", "dataWindow", "displayWindow"} - values.keys()
    if missing:
        raise _BadFileError(f"its header has no {' and no '.join(sorted(missing))}; write the file again")
    kind = values.get("type", b"")
    if kind.startswith(b"deep"):
        raise _BadFileError("it holds deep data; flatten it first")
    channels, bytes_per_pixel = _channels(values["channels"])
    compression = values["compression"][0]
    tiled = tiled or kind.startswith(b"tiled")
    known = not tiled and compression < len(LINES_PER_CHUNK)
    return PartHeader(
        channels=channels,
        data_window=struct.unpack("<4i", values["dataWindow"]),
        display_window=struct.unpack("<4i", values["displayWindow"]),
        bytes_per_pixel=bytes_per_pixel,
        compression=compression,
        lines_per_chunk=LINES_PER_CHUNK[compression] if known else None,
        chunk_count=struct.unpack("<i", values["chunkCount"])[0] if "chunkCount" in values else None,
        tile=struct.unpack_from("<2I", values["tiles"]) if tiled and "tiles" in values else None,
        texts={
            name: value.decode("utf-8", "replace")
            for name, (kind, value) in attributes.items()
            if kind == "string"
        },
    )


def _channels(data: bytes) -> tuple[tuple[str, ...], int]:
    """Names of the channels, and the bytes of one pixel over all of them."""
    names, bytes_per_pixel, at = [], 0, 0
    while data[at]:
        end = data.index(b"\0", at)
        kind, _linear, x_sampling, y_sampling = struct.unpack_from("<IB3x2i", data, end + 1)
        if (x_sampling, y_sampling) != (1, 1):
            raise _BadFileError("it holds subsampled channels; write it with full-size channels")
        names.append(data[at:end].decode("utf-8", "replace"))
        bytes_per_pixel += BYTES_PER_VALUE[kind]
        at = end + 17
    if not 0 < len(names) <= MOST_CHANNELS:
        raise _BadFileError(f"it holds {len(names)} channels; write the file again")
    return tuple(names), bytes_per_pixel


def _check_sizes(parts: list[PartHeader], file_size: int) -> None:
    limit = STRONGEST_COMPRESSION * file_size
    deflated = stored = shown = 0
    for part in parts:
        if part.tile is not None:
            _area(part.tile)
        held = _area(_size(part.data_window)) * part.bytes_per_pixel
        stored += held
        deflated += held if part.compression <= PIZ else 0
        shown += _area(_size(part.display_window)) * 4 * len(part.channels)  # float32 once it is read
    if deflated > max(SMALL_BYTES, limit) or max(stored, shown) > max(MODEST_BYTES, limit):
        claimed = max(stored, shown) >> 20
        raise _BadFileError(f"its header claims {claimed} MB, which a file of its size cannot hold")


def _size(window: Box) -> tuple[int, int]:
    left, top, right, bottom = window
    return right - left + 1, bottom - top + 1


def _area(size: tuple[int, int]) -> int:
    """Return the pixels of a window or a tile; refuse what is not the size of a picture."""
    width, height = size
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
        raise _BadFileError(f"its header claims {width} x {height} pixels; write the file again")
    return width * height


def _check_chunks(stream: BinaryIO, parts: list[PartHeader], file_size: int, *, multipart: bool) -> None:
    """Follow each part's chunk table; the chunk that lies last must end inside the file."""
    truncated = _BadFileError("it is not complete (the end is missing or was never written); write it again")
    last_chunks = []
    for part in parts:
        count = part.chunk_count
        if count is None:
            if part.lines_per_chunk is None:
                return  # tiles without a count: the library finds what is missing
            count = -(-part.rows // part.lines_per_chunk)
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
