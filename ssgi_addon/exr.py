# SPDX-License-Identifier: GPL-3.0-or-later
"""Multilayer EXR files and dictionaries of arrays.

Written are single-part files whose channels are ``ssgi.<layer>.<channel>``: the one layout that
Blender's Image node splits into a socket per layer in 4.5 and in 5.x alike. Read is also what Blender
writes: one part with short names in 4.5 (``ViewLayer.DiffCol.R``), a part per pass with long names
in 5.x (``ViewLayer.Diffuse Color.R``).

The OpenEXR package does the work; Blender's own OpenImageIO does where no wheel of it fits, or where the two
would get in each other's way.
"""

from __future__ import annotations

import ctypes
import io
import os
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .errors import SSGIError
from .exr_header import PartHeader, read_headers
from .exr_library import is_openexr_linked
from .files import replacing

FloatArray = np.ndarray[Any, np.dtype[np.float32]]

PREFIX = "ssgi"
CHANNEL_ORDER = "RGBXYZUVWA"

# Blender 4.5 and older wrote these short names; the passes are known by the long ones everywhere else.
LONG_NAMES = {
    "AO": "Ambient Occlusion",
    "DiffCol": "Diffuse Color",
    "DiffDir": "Diffuse Direct",
    "DiffInd": "Diffuse Indirect",
    "Emit": "Emission",
    "Env": "Environment",
    "GlossCol": "Glossy Color",
    "GlossDir": "Glossy Direct",
    "GlossInd": "Glossy Indirect",
    "IndexMA": "Material Index",
    "IndexOB": "Object Index",
    "TransCol": "Transmission Color",
    "TransDir": "Transmission Direct",
    "TransInd": "Transmission Indirect",
    "VolumeDir": "Volume Direct",
    "VolumeInd": "Volume Indirect",
}

Pixels = dict[str, FloatArray]

_silence = threading.Lock()


def write_layers(
    path: Path | str,
    layers: Mapping[str, FloatArray],
    metadata: Mapping[str, str] | None = None,
    *,
    letters: Mapping[str, str] | None = None,
    is_lasting: bool = True,
) -> None:
    """Write arrays as the layers of one EXR file, losslessly, in 32-bit float.

    Parameters
    ----------
    path
        The file; an older one is replaced at the very end, in one step.
    layers
        ``(H, W, 3)`` arrays become channels R, G, B and ``(H, W)`` arrays channel V, all of one size.
    metadata
        Text attributes of the file.
    letters
        What the channels of a layer are called instead, as many as it has: ``"XYZ"``.
    is_lasting
        Off for files that are read at once and thrown away: they are neither compressed nor brought to the
        disk.

    Raises
    ------
    SSGIError
        If the file cannot be written.
    ValueError
        If there is no layer, or shapes or names do not fit together.
    """
    channels = _split_channels(layers, letters or {})
    write = _write_openexr if _openexr() is not None else _write_openimageio
    with replacing(Path(path), is_lasting=is_lasting) as temporary:
        write(temporary, channels, dict(metadata or {}), compress=is_lasting)
        _check_whole(temporary)


def read_layers(path: Path | str) -> Pixels:
    """Read every layer of an EXR file.

    Passes of Blender get their long names, whatever Blender wrote them. With several view layers in a
    file the keys are ``<view layer>.<pass>``, with one the pass names alone. Nameless channels R, G, B
    are the pass ``Combined``, a nameless Z is ``Depth``; a fourth channel beside R, G, B is left out.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    dict
        ``(H, W)`` for one channel, ``(H, W, n)`` in the order R G B, X Y Z or U V W for more. float32,
        top row first, in the file's display window; pixels outside its data window are 0.

    Raises
    ------
    SSGIError
        If the file is missing, damaged, cut short, of absurd size, or holds no flat image.
    """
    path = Path(path)
    headers = read_headers(path)
    read = _read_openexr if _openexr() is not None else _read_openimageio
    try:
        with _silenced():
            parts = read(path)
    except SSGIError:
        raise
    except MemoryError as error:
        raise SSGIError(f"cannot read {path}: not enough memory") from error
    except Exception as error:  # of a damaged file, the libraries raise several kinds
        raise SSGIError(f"cannot read {path}: {error}; write the file again") from error
    if len(parts) != len(headers) or any(set(h.channels) - p.keys() for h, p in zip(headers, parts)):
        raise SSGIError(f"cannot read {path}: its pixels are damaged; write the file again")
    sizes = {header.display_window for header in headers}
    if len(sizes) > 1:
        raise SSGIError(f"cannot read {path}: its parts differ in size; write them to files of their own")
    channels: Pixels = {}
    for header, pixels in zip(headers, parts):
        for name, values in pixels.items():
            with np.errstate(invalid="ignore"):  # half floats may hold any kind of NaN
                channels[name] = _in_display_window(np.asarray(values, np.float32), header)
    return _join_channels(channels)


def _check_whole(path: Path) -> None:
    """Look at what was written: where the disk fills up at the very end, the libraries say nothing."""
    try:
        read_headers(path)
    except SSGIError as error:
        raise OSError("it came out incomplete, as on a full disk") from error


def _split_channels(layers: Mapping[str, FloatArray], named: Mapping[str, str]) -> Pixels:
    channels = {}
    for name, values in layers.items():
        shape = np.shape(values)
        letters = named.get(name) or {2: "V", 3: "RGB"}.get(len(shape), "")
        if len(shape) not in (2, 3) or shape[2:] not in ((), (len(letters),)):
            expected = f"(H, W, {len(letters)})" if name in named else "(H, W) or (H, W, 3)"
            raise ValueError(f"layer {name!r}: expected {expected}, got {shape}")
        planes = np.asarray(values, np.float32).reshape(shape[0], shape[1], len(letters))
        for index, letter in enumerate(letters):
            channels[f"{PREFIX}.{name}.{letter}"] = np.ascontiguousarray(planes[..., index])
    if len({plane.shape for plane in channels.values()}) != 1:
        raise ValueError(f"layers: expected one size for all, got {[np.shape(v) for v in layers.values()]}")
    return channels


def _join_channels(channels: Pixels) -> Pixels:
    """Group ``layer.pass.channel`` planes into arrays; a layer's name may hold dots."""
    groups: dict[tuple[str, str], Pixels] = {}
    for name, plane in channels.items():
        stem, _, letter = name.rpartition(".")
        layer, _, pass_name = stem.rpartition(".")
        if not pass_name:
            pass_name = "Depth" if letter == "Z" else "Combined"
        groups.setdefault((layer, LONG_NAMES.get(pass_name, pass_name)), {})[letter] = plane
    several = len({layer for layer, _ in groups}) > 1
    return {
        f"{layer}.{pass_name}" if several and layer else pass_name: _stack(planes)
        for (layer, pass_name), planes in groups.items()
    }


def _stack(planes: Pixels) -> FloatArray:
    letters: Iterable[str] = "RGB" if set("RGB") <= planes.keys() else sorted(planes, key=_channel_rank)
    stacked = [planes[letter] for letter in letters]
    return stacked[0] if len(stacked) == 1 else np.stack(stacked, axis=-1)


def _channel_rank(letter: str) -> tuple[int, str]:
    rank = CHANNEL_ORDER.find(letter)
    return (len(CHANNEL_ORDER) if rank < 0 else rank, letter)


def _in_display_window(plane: FloatArray, header: PartHeader) -> FloatArray:
    if header.data_window == header.display_window:
        return np.ascontiguousarray(plane)
    left, top, right, bottom = header.display_window
    x, y = header.data_window[0] - left, header.data_window[1] - top
    width, height = right - left + 1, bottom - top + 1
    placed = np.zeros((height, width), np.float32)
    inner = plane[max(-y, 0) : height - y, max(-x, 0) : width - x]
    placed[max(y, 0) : max(y, 0) + inner.shape[0], max(x, 0) : max(x, 0) + inner.shape[1]] = inner
    return placed


def _openexr() -> ModuleType | None:
    """The OpenEXR package; None where Blender's OpenImageIO is to be used."""
    if is_openexr_linked():
        with suppress(SSGIError):
            _openimageio()
            return None
    try:
        import OpenEXR
    except ImportError:
        return None
    # Before 3.3 the package of this name had another interface.
    return OpenEXR if hasattr(OpenEXR, "File") else None


def _openimageio() -> ModuleType:
    """Blender's OpenImageIO; the official executable has it at hand, the bpy module after a call."""
    try:
        import bpy

        bpy.utils.expose_bundled_modules()
        import OpenImageIO
    except ImportError as error:
        raise SSGIError("nothing here reads EXR files: pip install OpenEXR") from error
    return OpenImageIO


def _read_openexr(path: Path) -> list[Pixels]:
    module = _openexr()
    assert module is not None
    file = module.File(str(path), separate_channels=True)
    return [{name: channel.pixels for name, channel in part.channels.items()} for part in file.parts]


@contextmanager
def _silenced() -> Iterator[None]:
    """Keep a library from printing: of a damaged file it tells the terminal what we tell the user.

    OpenEXR prints by way of Python and by way of C. What others of this process print during the few
    milliseconds is lost, too.
    """
    unread = io.StringIO()
    with _silence, redirect_stdout(unread), redirect_stderr(unread), ExitStack() as undo:
        with suppress(OSError):  # a program with a window may have no outputs at all
            nowhere = os.open(os.devnull, os.O_WRONLY)
            undo.callback(os.close, nowhere)
            _flush_c()
            for output in (1, 2):
                kept = os.dup(output)
                undo.callback(os.close, kept)
                undo.callback(os.dup2, kept, output)
                os.dup2(nowhere, output)
            undo.callback(_flush_c)
        yield


def _flush_c() -> None:
    """Let go of what the C library holds back of the standard outputs."""
    with suppress(OSError, AttributeError, TypeError):  # Windows has no library of that name
        ctypes.CDLL(None).fflush(None)


def _write_openexr(path: Path, channels: Pixels, metadata: dict[str, str], compress: bool) -> None:
    module = _openexr()
    assert module is not None
    compression = module.ZIP_COMPRESSION if compress else module.NO_COMPRESSION
    header = {**metadata, "compression": compression, "type": module.scanlineimage}
    try:
        module.File(header, channels).write(str(path))
    except RuntimeError as error:
        raise OSError(str(error)) from error


def _read_openimageio(path: Path) -> list[Pixels]:
    source = _openimageio().ImageInput.open(str(path))
    parts: list[Pixels] = []
    while source is not None and source.seek_subimage(len(parts), 0):
        names = source.spec().channelnames
        pixels = source.read_image("float")
        if pixels is None:
            raise OSError(source.geterror())
        parts.append({name: pixels[..., index] for index, name in enumerate(names)})
    return parts


def _write_openimageio(path: Path, channels: Pixels, metadata: dict[str, str], compress: bool) -> None:
    module = _openimageio()
    names = sorted(channels)
    height, width = channels[names[0]].shape
    spec = module.ImageSpec(width, height, len(names), "float")
    spec.channelnames = tuple(names)
    spec.attribute("compression", "zip" if compress else "none")
    for key, value in metadata.items():
        spec.attribute(key, value)
    # The temporary name does not end in .exr, so the format is named here.
    target = module.ImageOutput.create("exr")
    pixels = np.stack([channels[name] for name in names], axis=-1)
    if not (target.open(str(path), spec) and target.write_image(pixels) and target.close()):
        raise OSError(target.geterror())
