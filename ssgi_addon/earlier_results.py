# SPDX-License-Identifier: GPL-3.0-or-later
"""Results that an earlier run left in the folder of a job: refused, or kept."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .errors import SSGIError
from .files import check_writable, discard_abandoned
from .job_options import JobOptions
from .manifest import manifest_of, read_manifest
from .recipe import Recipe, named_differences, recipe_hash, recipe_of

Record = dict[str, Any]
SKIPPED = {"what": "frame", "why": "its result was there already"}
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
                f"{path} is there already: switch Overwrite on (--overwrite), or choose another folder"
            )
        _refuse_other_recipe(path, recipe)


def finished_frames(options: JobOptions, stems: Mapping[int, str], recipe: Recipe) -> dict[int, Record]:
    """Return the entries in the report of the frames that `resume` skips.

    An entry is that of the run which rendered the frame, as its manifest says.
    """
    if options.overwrite or not options.resume:
        return {}
    wanted = recipe_hash(recipe)
    manifests = {frame: read_manifest(manifest_of(options.output, stem)) for frame, stem in stems.items()}
    return {
        frame: _skipped(manifest["record"])
        for frame, manifest in manifests.items()
        if manifest.get("settings_hash") == wanted
        and isinstance(manifest.get("record"), dict)
        and _is_whole(options, stems[frame], recipe)
    }


def was_skipped(record: Record) -> bool:
    """Whether a frame's entry in the report says that the run did not render it."""
    return SKIPPED in record.get("skipped", ())


def _is_whole(options: JobOptions, stem: str, recipe: Recipe) -> bool:
    """Whether all results of a frame are there; each kind's last file stands for the others."""
    if recipe_of(options.output / f"{stem}.exr") != recipe:
        return False
    if options.save_passes and not (options.output / "passes" / f"{stem}.json").exists():
        return False
    return not options.compare or (options.output / f"{stem}_compare.png").exists()


def _refuse_other_recipe(path: Path, recipe: Recipe) -> None:
    """Raise where a whole result was made otherwise; one that is not whole will be rendered anew."""
    found = recipe_of(path)
    if found is None or found == recipe:
        return
    raise SSGIError(
        f"{path} was rendered with {named_differences(found, recipe)}: give the same settings to go on, "
        "switch Overwrite on (--overwrite) to render all frames anew, or choose another folder"
    )


def _check_names(stems: Mapping[int, str]) -> None:
    for stem in stems.values():
        if len(os.fsencode(stem + _LONGEST_ENDING)) > _LONGEST_NAME:
            raise SSGIError(
                f"the name {stem}.exr is too long for a file: save the scene under a shorter name"
            )


def _skipped(record: Record) -> Record:
    others = [entry for entry in record.get("skipped", ()) if entry != SKIPPED]
    return {**record, "skipped": [*others, SKIPPED]}
