# SPDX-License-Identifier: GPL-3.0-or-later
"""Results that an earlier run left in the folder of a job: refused, or kept."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .errors import SSGIError
from .exr_header import read_headers
from .files import check_writable, discard_abandoned, read_json
from .job_options import JobOptions

Record = dict[str, Any]
#: What decides a frame's picture beside the content of the scene: versions and settings, as JSON has them.
Recipe = Mapping[str, Any]

SKIPPED = {"what": "frame", "why": "its result was there already"}
#: Text attribute of a result: the recipe of its picture.
RECIPE = "ssgi.made_with"
_NAMED_DIFFERENCES = 4
# Of all that a frame's files are called; most file systems take names of so many bytes.
_LONGEST_ENDING, _LONGEST_NAME = "_environment.json", 255


def check_output(options: JobOptions, stems: Mapping[int, str], recipe: Recipe) -> None:
    """Find out before hours of work whether the results can be written, and tidy up after dead runs.

    Parameters
    ----------
    options
        Folder and frames; with `overwrite` earlier results are no reason to refuse, with `resume` only those
        of another recipe.
    stems
        Names of the files of each frame, without their endings.
    recipe
        Of the pictures to come.

    Raises
    ------
    SSGIError
        If the folder cannot be written, or holds results that must not be replaced, nor kept.
    """
    check_writable(options.output)
    _check_names(stems)
    discard_abandoned(options.output)
    if options.overwrite:
        return
    for stem in stems.values():
        path = options.output / f"{stem}.exr"
        if not path.exists():
            continue
        if not options.resume:
            raise SSGIError(
                f"{path} is there already: switch Overwrite on (--overwrite), skip it (--resume), or "
                "choose another folder"
            )
        _refuse_other_recipe(path, recipe)


def finished_frames(options: JobOptions, stems: Mapping[int, str], recipe: Recipe) -> dict[int, Record]:
    """Return the entries in the report of the frames that `resume` skips.

    An entry is that of the run which rendered the frame, where its report is still there.
    """
    if options.overwrite or not options.resume:
        return {}
    done = [frame for frame, stem in stems.items() if _is_finished(options, stem, recipe)]
    earlier = _earlier_records(options.output / "report.json") if done else {}
    return {frame: _skipped(earlier.get(frame), frame) for frame in done}


def was_skipped(record: Record) -> bool:
    """Whether a frame's entry in the report says that the run did not render it."""
    return SKIPPED in record.get("skipped", ())


def recipe_text(recipe: Recipe) -> str:
    """Return the text that a result carries under `RECIPE`."""
    return json.dumps(recipe, sort_keys=True)


def recipe_hash(recipe: Recipe) -> str:
    """Return a short name of a recipe: frames that share it belong together."""
    return hashlib.blake2b(recipe_text(recipe).encode(), digest_size=8).hexdigest()


def _is_finished(options: JobOptions, stem: str, recipe: Recipe) -> bool:
    """Whether all that is written of a frame is there; each kind's last file stands for the others."""
    if _recipe_of(options.output / f"{stem}.exr") != recipe:
        return False
    if options.save_passes and not (options.output / "passes" / f"{stem}.json").exists():
        return False
    return not options.compare or (options.output / f"{stem}_compare.png").exists()


def _recipe_of(path: Path) -> dict[str, Any] | None:
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


def _refuse_other_recipe(path: Path, recipe: Recipe) -> None:
    """Raise where a whole result was made otherwise; one that is not whole will be rendered anew."""
    found = _recipe_of(path)
    if found is None or found == recipe:
        return
    differences = list(_differences(found, recipe)) if found else ["no settings"]
    named, more = ", ".join(differences[:_NAMED_DIFFERENCES]), len(differences) - _NAMED_DIFFERENCES
    others = f" and {more} more" if more > 0 else ""
    raise SSGIError(
        f"{path} was rendered with {named}{others}: give the same settings to go on, switch Overwrite on "
        "(--overwrite) to render all frames anew, or choose another folder"
    )


def _differences(found: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for name in dict.fromkeys((*wanted, *found)):
        old, new = found.get(name), wanted.get(name)
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            yield from _differences(old, new, f"{prefix}{name}.")
        elif old != new:
            yield f"{prefix}{name} {old} instead of {new}"


def _check_names(stems: Mapping[int, str]) -> None:
    for stem in stems.values():
        if len(os.fsencode(stem + _LONGEST_ENDING)) > _LONGEST_NAME:
            raise SSGIError(
                f"the name {stem}.exr is too long for a file: save the scene under a shorter name"
            )


def _earlier_records(path: Path) -> dict[int, Record]:
    """Read the entries of a report; none where it is gone or damaged, for the pictures are what counts."""
    try:
        return {record["frame"]: record for record in read_json(path)["frames"] if record["seconds"]}
    except (SSGIError, KeyError, TypeError):
        return {}


def _skipped(record: Record | None, frame: int) -> Record:
    record = record or {"frame": frame, "seconds": {}, "peak_memory_mb": None, "metrics": None}
    others = [entry for entry in record.get("skipped", ()) if entry != SKIPPED]
    return {**record, "skipped": [*others, SKIPPED]}
