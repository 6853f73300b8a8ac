# SPDX-License-Identifier: GPL-3.0-or-later
"""What the comparison of a result shows: pictures side by side, the error, what is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .heatmap import error_map

FloatArray = np.ndarray[Any, np.dtype[np.float32]]

# Layers of a result, and the picture of the reference, by the names under which `compose` takes them.
DIRECT, OURS, KNOWN, REFERENCE = "direct", "combined", "known", "reference"


@dataclass(frozen=True)
class View:
    """One way to look at a result.

    Attributes
    ----------
    name, label, help
        For the property that chooses it.
    layers
        What it is made of: two pictures share the frame, the first one to the left of the border.
    is_light
        Whether it is scene-linear radiance, to be shown through the scene's view transform; otherwise it is
        display-referred sRGB.
    """

    name: str
    label: str
    help: str
    layers: tuple[str, ...]
    is_light: bool = True

    @property
    def needs_reference(self) -> bool:
        """Whether it takes the render of Cycles' own indirect light."""
        return REFERENCE in self.layers

    @property
    def is_split(self) -> bool:
        """Whether two pictures share the frame."""
        return self.is_light and len(self.layers) == 2


VIEWS = (
    View("SPLIT", "Direct | Ours", "Direct light on the left, the result on the right", (DIRECT, OURS)),
    View(
        "SPLIT_REFERENCE",
        "Ours | Cycles",
        "The result on the left, Cycles' own indirect light on the right",
        (OURS, REFERENCE),
    ),
    View("DIRECT", "Direct", "Direct light alone", (DIRECT,)),
    View("OURS", "Ours", "Direct light with the indirect light that was added", (OURS,)),
    View("REFERENCE", "Cycles", "The render with Cycles' own indirect light", (REFERENCE,)),
    View(
        "ERROR",
        "Error",
        "Error of each pixel against Cycles, from black (a thousandth) to bright yellow (ten or more)",
        (OURS, REFERENCE),
        is_light=False,
    ),
    View(
        "KNOWN",
        "Known",
        "Share of the light that comes from what was captured, from black (none) to white (all)",
        (KNOWN,),
        is_light=False,
    ),
)


def view_named(name: str) -> View:
    """Return the view of that name."""
    return next(view for view in VIEWS if view.name == name)


def compose(view: View, layers: Mapping[str, FloatArray], split: float = 0.5) -> FloatArray:
    """Make the picture of a view.

    Parameters
    ----------
    view
        What to show.
    layers
        ``(H, W, 3)`` scene-linear pictures of one size, and ``known``, ``(H, W)``; at least those that the
        view is made of.
    split
        Place of the border between two pictures, 0 to 1: columns whose centre lies left of it show the
        first one.

    Returns
    -------
    (H, W, 3) float32
        Scene-linear radiance, or display-referred sRGB from 0 to 1; see `View.is_light`.

    Raises
    ------
    ValueError
        If the layers differ in size.
    """
    first, *others = (layers[name] for name in view.layers)
    for other in others:
        if other.shape != first.shape:
            raise ValueError(f"layers: expected one size, got {first.shape} and {other.shape}")
    if view.is_split:
        width = first.shape[1]
        border = int(np.floor(split * width + 0.5))
        return np.concatenate([first[:, :border], others[0][:, border:]], axis=1)
    if others:
        return error_map(first, others[0]).astype(np.float32) / np.float32(255.0)
    if first.ndim == 2:
        return np.repeat(first[..., None], 3, axis=2)
    return first
