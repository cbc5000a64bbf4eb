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


def crossed(tilt_xy: float = np.pi / 4, tilt_yz: float = np.pi / 4) -> Array:
    """Spin axes of two wheels in the xy and two in the yz plane (Hill et al. 2021, eq. 11); tilts from y, rad, to (3, 4).

    The paper's letters are a = sin tilt_xy, b = cos tilt_xy, c = cos tilt_yz, d = sin tilt_yz.
    """
    a, b, c, d = np.sin(tilt_xy), np.cos(tilt_xy), np.cos(tilt_yz), np.sin(tilt_yz)
    return np.array(
        [
            [a, -a, 0.0, 0.0],
            [b, b, c, c],
            [0.0, 0.0, d, -d],
        ]
    )
