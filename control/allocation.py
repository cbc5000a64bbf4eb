"""Sharing a body torque among wheels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class PseudoInverseAllocation:
    """Least-squares wheel torques, tau = -W^+ torque_B: the wheels take up what the body is to be given.

    McCafferty-Leroux et al. (2024, eq. 10) with u = W tau = -torque_B; Markley & Crassidis (2014, eq. 7.157). A demand beyond the
    drives' limit is scaled as a whole, so that its direction is kept.

    Attributes:
      wheel_axes: W, (3, wheels).
      torque_limit: N m a wheel.
    """

    wheel_axes: Array
    torque_limit: float

    @cached_property
    def _inverse(self) -> Array:
        return np.linalg.pinv(self.wheel_axes)

    def step(self, torque_B: Array) -> Array:
        """Torque of each motor on its wheel, (..., wheels) N m; torque_B (..., 3) N m."""
        wheel = -(self._inverse @ torque_B[..., None])[..., 0]
        peak = np.max(np.abs(wheel), axis=-1, keepdims=True)
        return wheel * np.minimum(1.0, self.torque_limit / np.maximum(peak, 1e-300))
