"""What filters need of a model of the sensors; models of sensors that read the state as a whole or in part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE

Array = NDArray[np.floating]

# How the difference of two attitudes is counted: by components of the quaternion with its sign as it is (also of a state that holds no
# quaternion), by components of the nearer of q and -q, or as the rotation vector, rad in B, from the one to the other.
AttitudeError = Literal["components", "quaternion", "rotation"]


class MeasurementModel(Protocol):
    """A reading z = h(x) + v of a state x = [q, ...] or of a plain vector; every array may have leading batch axes.

    A component of a reading that is missing, between two readings of a slow sensor for one, is NaN; how often a sensor reads is its own
    business. The residual's coordinates are the model's choice: m of them, or one fewer where an attitude is compared as a rotation.
    """

    @property
    def noise(self) -> Array:
        """R, the covariance of v in coordinates of the residual, (..., d, d)."""
        ...

    @property
    def size(self) -> int:
        """Components m of a reading."""
        ...

    def predict(self, state: Array) -> Array:
        """h(x): (..., n) to (..., m)."""
        ...

    def residual(self, reading: Array, predicted: Array) -> Array:
        """How far a reading is from a predicted one, NaN where it is missing; (..., m) twice to (..., d)."""
        ...

    def jacobian(self, state: Array) -> Array:
        """H, the sensitivity of a predicted reading, in coordinates of the residual, to the state's components; (..., n) to (..., d, n)."""
        ...

    def linear(self, errors: AttitudeError) -> Array | None:
        """H, (d, e), where the residual is linear in errors of the state counted in this way, whatever the state; otherwise None."""
        ...


@dataclass(frozen=True, eq=False)
class WholeState:
    """A reading of the state itself, H = I.

    Attributes:
      noise: R, (..., d, d).
      attitude: how a reading's attitude is compared with a predicted one.
    """

    noise: Array
    attitude: AttitudeError = "components"

    @property
    def size(self) -> int:
        """Components of the state."""
        return int(self.noise.shape[-1]) + (self.attitude == "rotation")

    def predict(self, state: Array) -> Array:
        """The state; (..., n)."""
        return state

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Difference of two states; (..., n) twice to (..., n), or (..., n-1) with a rotation vector."""
        return _difference(reading, predicted, self.attitude)

    def jacobian(self, state: Array) -> Array:
        """The unit matrix, or blockdiag(2 Xi', I); (..., n) to (..., d, n)."""
        return _sensitivity(state, np.arange(self.size), self.attitude)

    def linear(self, errors: AttitudeError) -> Array | None:
        """The unit matrix, if errors are counted as the residual is; (n, n) or (n-1, n-1)."""
        return np.eye(self.noise.shape[-1]) if (errors == "rotation") == (self.attitude == "rotation") else None


@dataclass(frozen=True, eq=False)
class PartOfState:
    """A reading of some components of the state, such as attitude and rate without wheel speeds, or a quaternion's vector part.

    Attributes:
      components: which, (m,), in the order of the reading; an attitude that is compared as such comes first, with all of its quaternion.
      states: how many components n the state has.
      noise: R, (..., d, d).
      attitude: how the attitude is compared with a predicted one; "components" where none is read, or a part of its quaternion.

    Raises:
      ValueError: components that the state has not, the same twice, or a part of a quaternion that is to be compared as an attitude.
    """

    components: Sequence[int]
    states: int
    noise: Array
    attitude: AttitudeError = "components"

    def __post_init__(self) -> None:
        chosen = list(self.components)
        if not chosen or len(set(chosen)) < len(chosen) or min(chosen) < 0 or max(chosen) >= self.states:
            raise ValueError(f"components = {chosen}: need one or more of 0 to {self.states - 1}, each once")
        if self.attitude != "components" and chosen[ATTITUDE] != [0, 1, 2, 3]:
            raise ValueError(f"components = {chosen}: an attitude compared by its {self.attitude} needs 0, 1, 2, 3 first")
        if self.noise.shape[-1] != len(chosen) - (self.attitude == "rotation"):
            raise ValueError(f"noise has shape {self.noise.shape}, which does not fit a reading of components {chosen}")

    @cached_property
    def _chosen(self) -> NDArray[np.intp]:
        return np.array(self.components, dtype=np.intp)

    @property
    def size(self) -> int:
        """Components of a reading."""
        return len(self.components)

    def predict(self, state: Array) -> Array:
        """Components of the state; (..., n) to (..., m)."""
        return state[..., self._chosen]

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Difference of components; (..., m) twice to (..., m), or (..., m-1) with a rotation vector."""
        return _difference(reading, predicted, self.attitude)

    def jacobian(self, state: Array) -> Array:
        """Rows of the unit matrix, with 2 Xi' for a rotation vector; (..., n) to (..., d, n)."""
        return _sensitivity(state, self._chosen, self.attitude)

    def linear(self, errors: AttitudeError) -> Array | None:
        """Rows of the unit matrix, (d, e), unless a quaternion is read by components and errors are rotations, or the reverse."""
        return self._rows.get(errors == "rotation")

    @cached_property
    def _rows(self) -> dict[bool, Array]:
        """By whether the state's errors are rotations."""
        if self.attitude == "rotation":
            turned: Array = np.eye(self.states - 1)[np.concatenate([np.arange(3), self._chosen[4:] - 1])]
            return {True: turned}
        rows: dict[bool, Array] = {False: np.eye(self.states)[self._chosen]}
        return rows if (self._chosen < 4).any() else rows | {True: np.eye(self.states - 1)[self._chosen - 1]}


def _difference(reading: Array, predicted: Array, attitude: AttitudeError) -> Array:
    """Of components, the attitude among them being first and counted as it is said."""
    if attitude == "components":
        return reading - predicted
    first: Array
    if attitude == "quaternion":
        first = quaternion.align(reading[..., ATTITUDE], predicted[..., ATTITUDE]) - predicted[..., ATTITUDE]
    else:
        first = quaternion.error(reading[..., ATTITUDE], predicted[..., ATTITUDE])
    return np.concatenate([first, reading[..., 4:] - predicted[..., 4:]], axis=-1)


def _sensitivity(state: Array, components: NDArray[np.intp], attitude: AttitudeError) -> Array:
    """Rows of the unit matrix, those of the quaternion turned into a rotation vector's where it is one; (..., d, n)."""
    rows = np.eye(state.shape[-1])[components]
    if attitude != "rotation":
        return np.broadcast_to(rows, (*state.shape[:-1], *rows.shape))
    out = np.zeros((*state.shape[:-1], len(components) - 1, state.shape[-1]))
    out[..., :3, ATTITUDE] = 2.0 * quaternion.xi(state[..., ATTITUDE]).swapaxes(-1, -2)
    out[..., 3:, :] = rows[4:]
    return out
