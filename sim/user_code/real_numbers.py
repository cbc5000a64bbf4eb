"""Numbers that a user's code or program hands in: real ones, not text, truth values or complex numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def real_numbers(given: Any) -> NDArray[np.floating]:
    """An array of its own of what was given; raises TypeError or ValueError, of what are no real numbers or not as many in each row."""
    array = np.asarray(given)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"must be numbers, not {array.dtype}")
    return array.astype(float)
