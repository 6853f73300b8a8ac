# SPDX-License-Identifier: GPL-3.0-or-later
"""What a picture was made with: told by each result, and compared before results are mixed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .errors import SSGIError
from .exr_header import read_headers

#: What decides a frame's picture: versions, settings and files, as JSON has them.
Recipe = Mapping[str, Any]

#: Text attribute of a result: the recipe of its picture.
RECIPE = "ssgi.made_with"
_NAMED_DIFFERENCES = 4


def recipe_text(recipe: Recipe) -> str:
    """Return the text that a result carries under `RECIPE`."""
    return json.dumps(recipe, sort_keys=True)


def recipe_hash(recipe: Recipe) -> str:
    """Return a short name of a recipe: frames that share it belong together."""
    return hashlib.blake2b(recipe_text(recipe).encode(), digest_size=8).hexdigest()


def recipe_of(path: Path) -> dict[str, Any] | None:
    """Return what a result was made with, nothing where it does not say; None where it is not whole."""
    try:
        told = read_headers(path)[0].texts.get(RECIPE, "")
    except SSGIError:
        return None
    try:
        recipe = json.loads(told)
    except ValueError:
        return {}
    return recipe if isinstance(recipe, dict) else {}


def named_differences(found: Recipe, wanted: Recipe) -> str:
    """Say in short by what a recipe differs from the one that is wanted."""
    differences = list(_differences(found, wanted)) if found else ["no settings"]
    more = len(differences) - _NAMED_DIFFERENCES
    return ", ".join(differences[:_NAMED_DIFFERENCES]) + (f" and {more} more" if more > 0 else "")


def _differences(found: Recipe, wanted: Recipe, prefix: str = "") -> Iterator[str]:
    for name in dict.fromkeys((*wanted, *found)):
        old, new = found.get(name), wanted.get(name)
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            yield from _differences(old, new, f"{prefix}{name}.")
        elif old != new:
            yield f"{prefix}{name} {old} instead of {new}"
