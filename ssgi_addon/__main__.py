# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m ssgi_addon``: the command line."""

from .cli import console

if __name__ == "__main__":
    console()
