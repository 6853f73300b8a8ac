# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark "error against time": every way to a picture, on the same scenes, by the same clock."""
