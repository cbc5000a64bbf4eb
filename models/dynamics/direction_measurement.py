"""Known directions seen from the body: the measurement model of a sun sensor, a magnetometer or a few stars."""

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


@dataclass(frozen=True, eq=False)
class DirectionsOfAttitude:
    """Readings of the state [q, ...] of which a few known directions alone are taken, as the attitude that is read makes them appear.

    That leaves what a sensor of directions says of the attitude: nothing about a turn around the only one, and nothing linear.

    Attributes:
      directions_N: (k, 3), of length one.
      noise_of_direction: R of each, (..., 3, 3).
    """

    directions_N: Array
    noise_of_direction: Array

    @property
    def noise(self) -> Array:
        """R, as if each direction had errors of its own, (..., 3 k, 3 k)."""
        one = self.noise_of_direction
        return np.einsum("ab,...ij->...aibj", np.eye(len(self.directions_N)), one).reshape(*one.shape[:-2], self._rows, self._rows)

    @property
    def size(self) -> int:
        """Components of the reading that are looked at: those of the quaternion."""
        return 4

    @property
    def _rows(self) -> int:
        return 3 * len(self.directions_N)

    def predict(self, state: Array) -> Array:
        """The attitude; (..., n) to (..., 4)."""
        return state[..., ATTITUDE]

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Difference of the directions as they appear, by components; (..., 4) twice to (..., 3 k)."""
        return self._seen(reading) - self._seen(predicted)

    def jacobian(self, state: Array) -> Array:
        """Of all directions, one after the other; (..., n) to (..., 3 k, n)."""
        each = [DirectionMeasurement(direction, self.noise_of_direction).jacobian(state) for direction in self.directions_N]
        return np.concatenate(each, axis=-2)

    def linear(self, errors: AttitudeError) -> None:  # noqa: ARG002
        """It is not."""
        return

    def _seen(self, attitude: Array) -> Array:
        """(..., 4) or more to (..., 3 k)."""
        seen = quaternion.attitude_matrix(attitude[..., ATTITUDE])[..., None, :, :] @ self.directions_N[..., None]
        return seen[..., 0].reshape(*attitude.shape[:-1], self._rows)
