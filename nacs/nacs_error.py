"""The one exception of the Python face."""

from __future__ import annotations


class NacsError(ValueError):
    """What went wrong, in one line: what, where, and what would be right.

    Attributes:
      exit_code: of the command in the same case: 2 for bad input, 3 for a simulation that failed.
    """

    def __init__(self, line: str, exit_code: int = 2) -> None:
        super().__init__(line)
        self.exit_code = exit_code
