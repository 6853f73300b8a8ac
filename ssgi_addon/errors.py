# SPDX-License-Identifier: GPL-3.0-or-later
"""The exceptions that users see as messages instead of tracebacks."""


class SSGIError(Exception):
    """Something a user can put right; the text names the next action."""


class OutputError(SSGIError):
    """A result cannot be written: the next one could not either."""
