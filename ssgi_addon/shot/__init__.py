# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a shot: what its frames' manifests say together."""
