"""What goes wrong as the one exception of the Python face: what the command would say in a line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from nacs.nacs_error import NacsError
from sim.bad_input import BadInput
from sim.cli.in_words import SHOW_TRACEBACK, in_words
from sim.text.one_line import one_line


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
