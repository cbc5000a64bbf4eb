"""The one exception of the Python face: what the command would say in a line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from sim.bad_input import BadInput
from sim.cli.in_words import SHOW_TRACEBACK, in_words
from sim.text.one_line import one_line


class NacsError(ValueError):
    """What went wrong, in one line: what, where, and what would be right.

    Attributes:
      exit_code: of the command in the same case: 2 for bad input, 3 for a simulation that failed.
    """

    def __init__(self, line: str, exit_code: int = 2) -> None:
        super().__init__(line)
        self.exit_code = exit_code


@contextmanager
def in_one_line() -> Iterator[None]:
    """Turn whatever goes wrong in the block into a NacsError; NACS_TRACEBACK=1 lets it through."""
    try:
        yield
    except NacsError:
        raise
    except Exception as wrong:
        if os.environ.get(SHOW_TRACEBACK) and not isinstance(wrong, BadInput):
            raise
        code, said = in_words(wrong)
        raise NacsError(one_line(said), code) from None


@contextmanager
def extra(package: str, name: str) -> Iterator[None]:
    """Say which extra of the distribution a package comes with, if the block cannot import it."""
    try:
        yield
    except ImportError:
        raise NacsError(f"this needs {package}: pip install 'nacs-twin[{name}]'") from None
