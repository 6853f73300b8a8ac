# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether scripts of .blend files may run: a file can do with them whatever its user can."""

from __future__ import annotations

import itertools
import sys

import bpy


def scripts_may_run() -> bool:
    """Whether this Blender was told, by option or preference, to run scripts of the files that it opens."""
    own = list(itertools.takewhile(lambda text: text not in ("--", "-c", "--command"), sys.argv[1:]))
    for argument in reversed(own):
        if argument in ("-y", "--enable-autoexec"):
            return True
        if argument in ("-Y", "--disable-autoexec"):
            return False
    return bool(bpy.context.preferences.filepaths.use_scripts_auto_execute)


def denied_scripts() -> tuple[str, ...]:
    """Return a sentence for the report where scripts or drivers of the open file did not run."""
    if not bpy.app.autoexec_fail:
        return ()
    return (
        f"Scripts or drivers of this file did not run ({bpy.app.autoexec_fail_message}). If you trust it, "
        "allow them with --enable-autoexec, or with Auto Run Python Scripts in Blender's preferences.",
    )
