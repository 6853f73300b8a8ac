# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged files: what disks, networks, other programs and malice make of good ones."""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

Rng = np.random.Generator

_ODD_INTEGERS = (0, 1, -1, 2, 255, 256, 65535, 65536, 1 << 20, 2**31 - 1, -(2**31), 1_000_000_007)
_ODD_WINDOWS = (
    (0, 0, 2**31 - 1, 2**31 - 1), (-(2**31), -(2**31), 2**31 - 1, 2**31 - 1), (5, 0, 4, 3), (0, 0, -1, -1),
    (0, 0, 65535, 65535), (0, 0, 65535, 0), (0, 0, 0, 65535), (0, 0, 0, 0), (-100, -100, -90, -90),
    (2**31 - 8, 0, 2**31 - 1, 7), (0, 0, 1023, 1023), (1, 1, 8, 8),
)  # fmt: skip
_ODD_NAMES = (b"\x1b[2J\x1b[31m", b"../../x", b"a\nb", b"%s%n{0}", b"\xff\xfe", b"", b"....", b"R", b"x" * 30)
_TYPES = (b"scanlineimage", b"tiledimage", b"deepscanline", b"deeptile", b"", b"nonsense")


def damaged_exr(good: bytes, rng: Rng) -> bytes:
    """Return an EXR file with one to three things wrong."""
    data = bytearray(good)
    for _ in range(rng.integers(1, 4)):
        change = _EXR_CHANGES[rng.integers(len(_EXR_CHANGES))]
        if len(data) > 64:
            data = bytearray(change(data, rng))
    return bytes(data)


def damaged_json(good: str, rng: Rng) -> str:
    """Return a JSON text with one to three values replaced, or one that is no JSON any more."""
    if rng.random() < 0.2:
        return _damaged_text(good, rng)
    data = json.loads(good)
    for _ in range(rng.integers(1, 4)):
        data = _replaced(data, rng)
    return json.dumps(data)


def _flip_bits(data: bytearray, rng: Rng) -> bytearray:
    for _ in range(rng.integers(1, 9)):
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
    return data


def _flip_bits_of_the_header(data: bytearray, rng: Rng) -> bytearray:
    for _ in range(rng.integers(1, 5)):
        data[rng.integers(min(len(data), 600))] ^= 1 << rng.integers(8)
    return data


def _put_odd_integer(data: bytearray, rng: Rng) -> bytearray:
    at = rng.integers(min(len(data), 600 if rng.random() < 0.7 else len(data)) - 4)
    struct.pack_into("<i", data, at, _ODD_INTEGERS[rng.integers(len(_ODD_INTEGERS))])
    return data


def _truncate(data: bytearray, rng: Rng) -> bytearray:
    return data[: rng.integers(len(data))]


def _append(data: bytearray, rng: Rng) -> bytearray:
    return data + rng.bytes(int(rng.integers(1, 200)))


def _cut_out(data: bytearray, rng: Rng) -> bytearray:
    begin = rng.integers(len(data))
    return data[:begin] + data[begin + rng.integers(1, 64) :]


def _double(data: bytearray, rng: Rng) -> bytearray:
    begin = rng.integers(len(data))
    length = int(rng.integers(1, 256))
    return data[: begin + length] + data[begin:]


def _fill(data: bytearray, rng: Rng) -> bytearray:
    begin, length = rng.integers(len(data)), int(rng.integers(1, 400))
    kept = data[begin : begin + length]
    data[begin : begin + length] = (b"\0" if rng.random() < 0.5 else b"\xff") * len(kept)
    return data


def _change_window(data: bytearray, rng: Rng) -> bytearray:
    name = (b"dataWindow", b"displayWindow")[rng.integers(2)]
    at = data.find(name + b"\0box2i\0")
    if at >= 0:
        window = _ODD_WINDOWS[rng.integers(len(_ODD_WINDOWS))]
        struct.pack_into("<4i", data, at + len(name) + 11, *window)
    return data


def _change_channel(data: bytearray, rng: Rng) -> bytearray:
    """Another pixel type, other sampling or another name, of the same length, of one channel."""
    begin = data.find(b"channels\0chlist\0")
    if begin < 0:
        return data
    at, ends = begin + 20, []
    while at < len(data) and data[at]:
        end = data.find(b"\0", at)
        if end < 0 or end + 17 > len(data):
            break
        ends.append((at, end))
        at = end + 17
    if not ends:
        return data
    start, end = ends[rng.integers(len(ends))]
    kind = rng.integers(4)
    if kind == 0:
        struct.pack_into("<i", data, end + 1, (0, 1, 2, 3, -1, 2**31 - 1)[rng.integers(6)])
    elif kind == 1:
        struct.pack_into("<2i", data, end + 9, *rng.choice([0, 1, 2, -1, 2**31 - 1], 2).tolist())
    else:
        name = _ODD_NAMES[rng.integers(len(_ODD_NAMES))]
        room = end - start
        data[start:end] = (name + bytes(data[start:end])[len(name) :])[:room]
    return data


def _change_compression(data: bytearray, rng: Rng) -> bytearray:
    at = data.find(b"compression\0compression\0")
    if at >= 0:
        data[at + 28] = rng.integers(14)
    return data


def _change_type(data: bytearray, rng: Rng) -> bytearray:
    """What the flags and the attribute say of tiles, deep data and parts."""
    if rng.random() < 0.5:
        flags = struct.unpack_from("<I", data, 4)[0] ^ (0x200, 0x400, 0x800, 0x1000, 0x4000)[rng.integers(5)]
        struct.pack_into("<I", data, 4, flags)
        return data
    at = data.find(b"type\0string\0")
    if at >= 0:
        length = struct.unpack_from("<i", data, at + 12)[0]
        if 0 <= length < 64:
            kind = _TYPES[rng.integers(len(_TYPES))][:length].ljust(length, b"\0")
            data[at + 16 : at + 16 + length] = kind
    return data


_EXR_CHANGES: tuple[Callable[[bytearray, Rng], bytearray], ...] = (
    _flip_bits, _flip_bits_of_the_header, _flip_bits_of_the_header, _put_odd_integer, _put_odd_integer,
    _truncate, _append, _cut_out, _double, _fill, _change_window, _change_window, _change_channel,
    _change_channel, _change_compression, _change_type,
)  # fmt: skip


def _damaged_text(text: str, rng: Rng) -> str:
    begin = int(rng.integers(len(text)))
    kind = rng.integers(6)
    if kind == 0:
        return text[:begin]
    if kind == 1:
        return "[" * 20000 + text
    if kind == 2:
        return text.replace(":", ": 1" + "0" * int(rng.integers(10, 6000)) + ',"a":', 1)
    if kind == 3:
        return text[:begin] + "\x00\ufeff\u2028" + text[begin:]
    if kind == 4:
        return text[:begin] + text[begin + int(rng.integers(1, 40)) :]
    return text[:begin] + text[begin : begin + 300] + text[begin:]


def _odd_value(rng: Rng) -> Any:
    deep: list[Any] = []
    for _ in range(50):
        deep = [deep]
    values = (
        None, True, 0, -1, 1, 0.5, 1e-300, -1e300, 1e300, 10**400, 10**30, float("inf"), float("nan"), 65537,
        "", "x", "../../etc/passwd", "/etc/passwd", "\x1b[31mred\x07", "a\nb", "{0.__class__}%s%n",
        "x" * 5000,
        [], {}, [1, 2], {"a": 1}, [[1]], deep, ["x"] * 500, "inf", "perspective", "draft", [None], [{}],
        [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]], [[0] * 4] * 4, [[1e300] * 4] * 4,
    )  # fmt: skip
    return values[rng.integers(len(values))]


def _replaced(data: Any, rng: Rng) -> Any:
    """Return data with one value at a random depth replaced, removed or doubled."""
    data = copy.deepcopy(data)
    if not isinstance(data, (dict, list)) or not data:
        return _odd_value(rng)
    owner, key = data, None
    while True:
        keys = list(owner) if isinstance(owner, dict) else list(range(len(owner)))
        key = keys[rng.integers(len(keys))]
        if not isinstance(owner[key], (dict, list)) or not owner[key] or rng.random() < 0.35:
            break
        owner = owner[key]
    kind = rng.random()
    if kind < 0.2:
        del owner[key]
    elif kind < 0.3 and isinstance(owner, list):
        owner.append(owner[key])
    else:
        owner[key] = _odd_value(rng)
    return data
