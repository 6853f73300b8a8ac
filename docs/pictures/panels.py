# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures side by side with their titles, as small WebP files; needs Pillow (the extra ``docs``)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image as PillowImage
from PIL import ImageDraw, ImageFont

from ssgi_addon.core.metrics import display_referred
from ssgi_addon.files import replacing

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"

Shown = npt.NDArray[np.uint8]
Panel = tuple[str, npt.NDArray[np.floating]]

_GAP, _TITLE_HEIGHT, _TITLE_SIZE = 6, 20, 13
_PAPER, _INK = (255, 255, 255), (40, 40, 44)
_QUALITY = 84
# Mean difference of two drawings of one picture, of 255: below, the file stays as it is.
_SAME = 0.5


def to_screen(image: npt.ArrayLike, exposure: float = 0.0) -> Shown:
    """Return scene-linear light ``(H, W, 3)``, or grey ``(H, W)`` from 0 to 1, as it is shown."""
    values = np.asarray(image, dtype=np.float32)
    if values.ndim == 2:
        return np.repeat(np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)[..., None], 3, axis=2)
    return np.rint(display_referred(values, exposure) * 255.0).astype(np.uint8)


def difference(one: Shown, other: Shown, gain: int) -> Shown:
    """Return how far apart two pictures are, so many times as bright."""
    apart = np.abs(one.astype(np.int32) - other) * gain
    return np.minimum(apart, 255).astype(np.uint8)


def write_panels(path: Path, panels: Sequence[tuple[str, Shown]]) -> None:
    """Write pictures of one height side by side, a title above each."""
    height = panels[0][1].shape[0]
    width = sum(shown.shape[1] for _, shown in panels) + _GAP * (len(panels) - 1)
    sheet = PillowImage.new("RGB", (width, height + _TITLE_HEIGHT), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(_TITLE_SIZE)
    left = 0
    for title, shown in panels:
        draw.text((left + 1, 1), title, fill=_INK, font=font)
        sheet.paste(PillowImage.fromarray(shown), (left, _TITLE_HEIGHT))
        left += shown.shape[1] + _GAP
    write_webp(path, np.asarray(sheet))


def write_webp(path: Path, rgb: Shown, quality: int = _QUALITY) -> None:
    """Write a picture ``(H, W, 3)``, unless the file shows the same already."""
    buffer = io.BytesIO()
    PillowImage.fromarray(rgb).save(buffer, "WEBP", quality=quality, method=6)
    if path.exists() and _is_same(path, buffer):
        print(f"{path.relative_to(ROOT)}: as it was", flush=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1024:.0f} KB", flush=True)


def _is_same(path: Path, encoded: io.BytesIO) -> bool:
    """Whether two files show the same: encoders and processors differ in last bits."""
    with PillowImage.open(path) as there, PillowImage.open(encoded) as new:
        if there.size != new.size:
            return False
        one, other = (np.asarray(image.convert("RGB"), dtype=np.float32) for image in (there, new))
    return float(np.abs(one - other).mean()) < _SAME
