"""The one exception for what a user wrote or asked for and cannot be run."""

from __future__ import annotations


class BadInput(ValueError):
    """Something that the user wrote cannot be run; the message is one line: what, where, what would be right."""
