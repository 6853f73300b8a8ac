# SPDX-License-Identifier: GPL-3.0-or-later
"""Borrow a user's scene: change settings for the time of a ``with`` block, then put everything back."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import bpy


class Restorer(ExitStack):
    """Undo temporary changes to Blender data, last change first, however the block ends.

    One undo that fails does not keep the others from running.

    Examples
    --------
    >>> with Restorer() as restorer:
    ...     restorer.change(scene.cycles, samples=1, use_denoising=False)
    ...     bpy.ops.render.render()
    """

    def change(self, owner: bpy.types.bpy_struct, **values: Any) -> None:
        """Set properties of `owner` until the block ends; what already holds the value stays untouched."""
        for name, value in values.items():
            old = getattr(owner, name)
            if old == value:
                continue
            # A property that was never set must not be left behind as "set to its default".
            if owner.is_property_set(name):
                self.callback(setattr, owner, name, old)
            else:
                self.callback(owner.property_unset, name)
            setattr(owner, name, value)
