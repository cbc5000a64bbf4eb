"""Reaction-wheel arrays: the spin axes of the wheels in the body frame, as the columns of W (3, wheels)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def pyramid(azimuth: float = np.pi / 4, elevation: float = np.pi / 4) -> Array:
    """Spin axes of four wheels in a pyramid (McCafferty-Leroux et al. 2024, eq. 6, signs as printed); rad to (3, 4)."""
    ca, sa, cb, sb = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return np.array(
        [
            [ca * cb, ca * cb, -ca * cb, -ca * cb],
            [-sa * cb, sa * cb, -sa * cb, sa * cb],
            [-sb, -sb, -sb, -sb],
        ]
    )
