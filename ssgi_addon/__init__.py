# SPDX-License-Identifier: GPL-3.0-or-later
"""Screen-space global illumination: indirect light from the passes of a direct-light render."""

__version__ = "1.0.0-rc.1"
