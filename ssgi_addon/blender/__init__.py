# SPDX-License-Identifier: GPL-3.0-or-later
"""The only modules that read or write Blender data."""
