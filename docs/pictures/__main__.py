# SPDX-License-Identifier: GPL-3.0-or-later
"""The site's pictures; ``make docs`` calls it.

    python -m docs.pictures              # those that need no Blender: two minutes
    python -m docs.pictures --all        # and those that Blender renders: many minutes
    python -m docs.pictures --committed  # none: those of the repository are used

A file that shows the same already stays as it is.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

_FAST = ("settings_pairs", "how_it_works")
# Each in a process of its own: Blender holds one scene
_BLENDER = ("reflections", "diffuse", "beyond_the_frame", "job_options", "shot_report")


def main() -> None:
    """Draw what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--all", action="store_true", help="also what Blender renders")
    which.add_argument("--committed", action="store_true", help="draw nothing")
    arguments = parser.parse_args()
    if not arguments.committed:
        for name in (*_FAST, *(_BLENDER if arguments.all else ())):
            subprocess.run([sys.executable, "-m", f"docs.pictures.{name}"], check=True)


if __name__ == "__main__":
    main()
