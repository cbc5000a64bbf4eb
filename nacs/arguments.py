"""Arguments of the public functions: of the right kind, or told in one line."""

from __future__ import annotations

import operator
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nacs.nacs_error import NacsError


def whole(name: str, value: Any, least: int = 0) -> int:
    """A whole number, NumPy's too; raises NacsError."""
    try:
        if isinstance(value, bool | np.bool_) or operator.index(value) < least:
            raise TypeError
        return operator.index(value)
    except TypeError:
        raise NacsError(f"{name}={value!r:.60}: must be a whole number of at least {least}") from None


def whole_if_given(name: str, value: Any, least: int = 0) -> int | None:
    """The same, or None."""
    return None if value is None else whole(name, value, least)


def real(name: str, value: Any) -> float:
    """A finite number; raises NacsError."""
    try:
        number = float(value) if not isinstance(value, str | bytes | bool) else np.nan
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise NacsError(f"{name}={value!r:.60}: must be a number")
    return number


def text(name: str, value: Any) -> str:
    """A text or a path as text; raises NacsError."""
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):
        raise NacsError(f"{name}={value!r:.60}: must be a name or a path")
    return str(value)


def path(name: str, value: Any) -> Path:
    """A path; raises NacsError."""
    return Path(text(name, value))


def table(name: str, value: Any) -> dict[str, Any]:
    """A dictionary, None being an empty one; raises NacsError."""
    if value is not None and not isinstance(value, Mapping):
        raise NacsError(f"{name}={value!r:.60}: must be a dictionary")
    if strange := [key for key in value or {} if not isinstance(key, str)]:
        raise NacsError(f"{name}: {strange[0]!r:.60} is no text, as keys are")
    return dict(value or {})


def several(name: str, value: Any, of: str) -> tuple[Any, ...]:
    """A list of things, in words `of`; raises NacsError."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Sequence | np.ndarray):
        raise NacsError(f"{name}={value!r:.60}: must be a list of {of}")
    return tuple(value)


def check_workers(workers: int, own: Iterable[Any]) -> None:
    """Raise NacsError if other processes could not be started, or not be told what is flown."""
    if workers == 1:
        return
    if not all(isinstance(one, str) for one in own):
        raise NacsError(f"workers={workers}: other processes cannot have filters and laws of this one; say workers=1, or FILE.py:CLASS")
    script = getattr(sys.modules["__main__"], "__file__", None)
    if script and Path(script).suffix == ".py" and "__name__" not in Path(script).read_text(encoding="utf-8", errors="replace"):
        guard = 'put what it does under `if __name__ == "__main__":`'
        raise NacsError(f"workers={workers}: every worker would run {Path(script).name} again; {guard}, or say workers=1")
