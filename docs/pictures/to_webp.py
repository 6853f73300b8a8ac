# SPDX-License-Identifier: GPL-3.0-or-later
"""Make WebP files of PNG files, which go: pictures of scenes take a tenth of the room.

python -m docs.pictures.to_webp FILE.png ...
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

from docs.pictures.panels import write_webp

# Text and fine noise stand in these pictures.
QUALITY = 90


def convert(path: Path) -> Path:
    """Replace a PNG file by a WebP file beside it."""
    with PillowImage.open(path) as image:
        pixels = np.asarray(image.convert("RGB"))
    target = path.resolve().with_suffix(".webp")
    write_webp(target, pixels, QUALITY)
    path.unlink()
    return target


def main() -> None:
    """Convert what is named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.png")
    for path in parser.parse_args().files:
        convert(path)


if __name__ == "__main__":
    main()
