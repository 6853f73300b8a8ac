# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements of speed and quality; `README.md` says how to run them and what they gave."""
