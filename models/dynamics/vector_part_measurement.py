"""Readings of an attitude of which the quaternion's vector part alone is taken (Rososhansky 2017, eq. 3.11)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.dynamics.measurement import AttitudeError, PartOfState
from models.dynamics.state_layout import ATTITUDE

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class VectorPart:
    """A reading of the state [q, ...] that forgets the fourth component, which the thesis computes from the constraint.

    Its sign is then never observed: q and -q are two states, which errors of a state must be counted as (`Signed`), and the state's
    mirror image explains a reading as well as the state.

    Attributes:
      noise_of_whole: R of the whole reading, (..., n, n).
    """

    noise_of_whole: Array

    @cached_property
    def _part(self) -> PartOfState:
        size = self.noise_of_whole.shape[-1]
        taken = np.delete(np.arange(size), 3)
        return PartOfState(taken.tolist(), size, self.noise_of_whole[..., taken[:, None], taken])

    @property
    def noise(self) -> Array:
        """R of what is taken, (..., n-1, n-1)."""
        return self._part.noise

    @property
    def size(self) -> int:
        """Components of the whole reading."""
        return int(self.noise_of_whole.shape[-1])

    def predict(self, state: Array) -> Array:
        """The whole state; (..., n)."""
        return state

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Difference of what is taken, by components; (..., n) twice to (..., n-1)."""
        return self._part.predict(reading) - self._part.predict(predicted)

    def jacobian(self, state: Array) -> Array:
        """Rows of the unit matrix; (..., n) to (..., n-1, n)."""
        return self._part.jacobian(state)

    def linear(self, errors: AttitudeError) -> Array | None:
        """Rows of the unit matrix, (n-1, n), unless errors are rotations."""
        return self._part.linear(errors)

    def completed(self, reading: Array) -> Array:
        """A reading (..., n) with the fourth component that the constraint gives, taken to be positive, as a first reading must be.

        If a part of the vector is missing the constraint gives nothing: the attitude is missing as a whole.
        """
        seen = np.array(reading, dtype=float)
        seen[..., 3] = np.sqrt(np.maximum(0.0, 1.0 - np.sum(seen[..., :3] ** 2, axis=-1)))
        seen[..., ATTITUDE] = np.where(np.isnan(seen[..., 3:4]), np.nan, seen[..., ATTITUDE])
        return seen
