# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the passes find the same by another numpy: sines, roots and sums may round differently there.

The same small job in two environments, then the comparison. Run from the repository's root, the first with
each Python:

    python -m benchmarks.numpy_versions --save FILE.npz
    python -m benchmarks.numpy_versions --compare ONE.npz OTHER.npz [--output FILE.json]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import record
from benchmarks.inputs import analytic_room
from benchmarks.stability import DARKEST, IMAGES, recorded_rays, settings_by_name
from ssgi_addon.core import Environment, render_indirect

_SIZE = (160, 120)


def compute() -> dict[str, np.ndarray]:
    """Return images and ends of rays by every method, as one flat mapping."""
    frame = analytic_room(*_SIZE)
    found = {"numpy": np.array(np.__version__), "surface": ~frame.gbuffer.is_background}
    for name, settings in settings_by_name().items():
        with recorded_rays() as calls:
            light = render_indirect(
                frame.gbuffer, frame.camera, settings, Environment.constant((1.0, 1.0, 1.0))
            )
        found |= {f"{name}/{image}": getattr(light, image) for image in IMAGES}
        for end in ("pixel", "status", "texel"):
            parts = [getattr(call, end) for call in calls]
            found[f"{name}/{end}"] = np.concatenate(parts) if parts else np.zeros(0, np.int64)
    return found


def compare(one: Any, other: Any) -> dict[str, Any]:
    """Return how many rays ended elsewhere, and the largest relative difference of all other pixels."""
    found: dict[str, Any] = {"numpy": [str(one["numpy"]), str(other["numpy"])], "passes": {}}
    surface = one["surface"]
    for name in settings_by_name():
        is_moved = (one[f"{name}/status"] != other[f"{name}/status"]) | (
            one[f"{name}/texel"] != other[f"{name}/texel"]
        )
        alike = surface.copy()
        alike.reshape(-1)[one[f"{name}/pixel"][is_moved]] = False
        images = {}
        for image in IMAGES:
            first, second = (of[f"{name}/{image}"].astype(np.float64) for of in (one, other))
            scale = np.maximum(second, DARKEST * second[surface].mean())
            off = np.abs(first - second)[alike] / np.maximum(scale[alike], 1e-30)
            images[image] = float(off.max(initial=0.0))
        found["passes"][name] = {"rays": int(is_moved.size), "moved": int(is_moved.sum()), "largest": images}
    return found


def main() -> None:
    """Compute, or compare and store where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--save", type=Path, metavar="FILE.npz")
    parser.add_argument("--compare", type=Path, nargs=2, metavar="FILE.npz")
    parser.add_argument("--output", type=Path, help="JSON file for the comparison")
    arguments = parser.parse_args()
    if arguments.save is not None:
        np.savez_compressed(arguments.save, **compute())
    if arguments.compare is not None:
        one, other = (dict(np.load(path)) for path in arguments.compare)
        found = compare(one, other)
        print(found)
        if arguments.output is not None:
            record.store(arguments.output, {"size": _SIZE}, found)


if __name__ == "__main__":
    main()
