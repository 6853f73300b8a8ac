# SPDX-License-Identifier: GPL-3.0-or-later
"""The one exception that users see as a message instead of a traceback."""


class SSGIError(Exception):
    """Something a user can put right; the text names the next action."""
