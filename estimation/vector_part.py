"""Readings of an attitude of which a filter takes the vector part alone (Rososhansky 2017, eq. 3.11)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

# "quaternion" takes all that is read. "vector" forgets the fourth component, which the thesis computes from the constraint: its sign is
# then never observed, q and -q are two states (`state_space.Signed`), and the state's mirror image explains a reading as well as the state.
Measured = Literal["quaternion", "vector"]


def taken(measurement: Array, measured: Measured) -> Array:
    """What is taken of a reading (..., n), NaN elsewhere."""
    if measured == "quaternion":
        return measurement
    seen = np.array(measurement, dtype=float)
    seen[..., 3] = np.nan
    return seen


def first_taken(measurement: Array, measured: Measured) -> Array:
    """The first reading (..., n), a fourth component that is not taken being the positive one that the constraint gives."""
    seen = np.array(measurement, dtype=float)
    if measured == "vector":
        seen[..., 3] = np.sqrt(np.maximum(0.0, 1.0 - np.sum(seen[..., :3] ** 2, axis=-1)))
    return seen
