"""A known direction seen from the body: the measurement model of a sun sensor, a magnetometer or a star."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.measurement import AttitudeError
from models.dynamics.state_layout import ATTITUDE

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class DirectionMeasurement:
    """A known direction or field of N as it is seen in B, h = A(q) r: what a sun sensor or a magnetometer reads.

    Residuals are by components. For a unit vector with an error of sigma rad about each axis across it, R = sigma^2 I serves as well as
    the singular sigma^2 (I - b b'), the third component being known anyway (Shuster & Oh 1981).

    Attributes:
      direction_N: r, (..., 3), of length one or in the field's unit; leading axes as those of states.
      noise: R, (..., 3, 3).
    """

    direction_N: Array
    noise: Array

    @property
    def size(self) -> int:
        """Three."""
        return 3

    def predict(self, state: Array) -> Array:
        """A(q) r in B; (..., n) to (..., 3)."""
        return (quaternion.attitude_matrix(state[..., ATTITUDE]) @ self.direction_N[..., None])[..., 0]

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Component by component; (..., 3)."""
        return reading - predicted

    def jacobian(self, state: Array) -> Array:
        """2 [A(q) r x] Xi(q)', for [A(q) r x] is the sensitivity to a rotation vector in B (Markley & Crassidis 2014, sec. 6.2).

        A quaternion's length is no attitude: what changes it alone changes nothing. (..., n) to (..., 3, n).
        """
        by_rotation = quaternion.cross_matrix(self.predict(state))
        out = np.zeros((*by_rotation.shape[:-1], state.shape[-1]))
        out[..., ATTITUDE] = 2.0 * by_rotation @ quaternion.xi(state[..., ATTITUDE]).swapaxes(-1, -2)
        return out

    def linear(self, errors: AttitudeError) -> None:  # noqa: ARG002
        """It is not."""
        return
