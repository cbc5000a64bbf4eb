"""How a filter measures errors of a state: by components, or its quaternion by a small rotation."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.measurement import AttitudeError
from models.dynamics.state_layout import ATTITUDE

Array = NDArray[np.floating]


class StateSpace(Protocol):
    """Error coordinates of states, for a covariance to live in; arrays have leading batch axes."""

    @property
    def attitude(self) -> AttitudeError:
        """How errors of an attitude are counted."""
        ...

    def difference(self, state: Array, reference: Array) -> Array:
        """Coordinates of `state` as seen from `reference`; (..., n) to (..., e)."""
        ...

    def displace(self, reference: Array, error: Array) -> Array:
        """The state with the given coordinates as seen from `reference`; (..., n) and (..., e) to (..., n)."""
        ...

    def transition(self, transition: Array, before: Array, after: Array) -> Array:
        """Sensitivity (..., n, n) of states turned into one of error coordinates, (..., e, e)."""
        ...

    def sensitivity(self, jacobian: Array, state: Array) -> Array:
        """Sensitivity of a reading to the state's components, (..., d, n), turned into one to its errors, (..., d, e)."""
        ...

    def reduce(self, mean: Array, covariance: Array) -> Array:
        """Covariance with the attitude as a rotation vector in B, (..., n-1, n-1), for consistency tests of any filter."""
        ...


def _to_rotation(state: Array) -> Array:
    """Matrix (..., n-1, n) that turns a small change of the state into rotation vector and the rest: blockdiag(2 Xi', I)."""
    size = state.shape[-1]
    out = np.zeros((*state.shape[:-1], size - 1, size))
    out[..., :3, ATTITUDE] = 2.0 * quaternion.xi(state[..., ATTITUDE]).swapaxes(-1, -2)
    rest = np.arange(3, size - 1)
    out[..., rest, rest + 1] = 1.0
    return out


class Euclidean:
    """Errors of a plain vector, which holds no quaternion: differences."""

    attitude: AttitudeError = "components"

    def difference(self, state: Array, reference: Array) -> Array:
        """Component by component; (..., n)."""
        return state - reference

    def displace(self, reference: Array, error: Array) -> Array:
        """Sum; (..., n)."""
        return reference + error

    def transition(self, transition: Array, before: Array, after: Array) -> Array:
        """Unchanged; (..., n, n)."""
        return transition

    def sensitivity(self, jacobian: Array, state: Array) -> Array:
        """Unchanged; (..., d, n)."""
        return jacobian

    def reduce(self, mean: Array, covariance: Array) -> Array:
        """Unchanged, since there is no attitude; (..., n, n)."""
        return covariance


class Additive:
    """Errors by components, the quaternion's four included (n error coordinates), as the seed papers do.

    The reading's sign is aligned with the prediction's, and the corrected quaternion is scaled to unit length.
    """

    attitude: AttitudeError = "quaternion"

    def difference(self, state: Array, reference: Array) -> Array:
        """Component by component, the quaternion of either sign; (..., n)."""
        apart = state - reference
        apart[..., ATTITUDE] = quaternion.align(state[..., ATTITUDE], reference[..., ATTITUDE]) - reference[..., ATTITUDE]
        return apart

    def displace(self, reference: Array, error: Array) -> Array:
        """Sum, with the quaternion scaled to unit length; (..., n)."""
        moved = reference + error
        moved[..., ATTITUDE] = quaternion.normalize(moved[..., ATTITUDE])
        return moved

    def transition(self, transition: Array, before: Array, after: Array) -> Array:
        """Unchanged; (..., n, n)."""
        return transition

    def sensitivity(self, jacobian: Array, state: Array) -> Array:
        """Unchanged; (..., d, n)."""
        return jacobian

    def reduce(self, mean: Array, covariance: Array) -> Array:
        """Covariance with the attitude as a rotation vector in B, (..., n-1, n-1)."""
        to_rotation = _to_rotation(mean)
        return to_rotation @ covariance @ to_rotation.swapaxes(-1, -2)


class Signed(Additive):
    """Errors by components of quaternions whose sign is taken as it is: q and -q are two states."""

    attitude: AttitudeError = "components"

    def difference(self, state: Array, reference: Array) -> Array:
        """Component by component; (..., n)."""
        return state - reference


class Multiplicative:
    """Attitude errors as a rotation vector in B (n-1 error coordinates), the rest by components (Markley & Crassidis 2014, ch. 6.2)."""

    attitude: AttitudeError = "rotation"

    def difference(self, state: Array, reference: Array) -> Array:
        """Rotation vector, rad, and the rest; (..., n) to (..., n-1)."""
        turn = quaternion.error(state[..., ATTITUDE], reference[..., ATTITUDE])
        return np.concatenate([turn, state[..., 4:] - reference[..., 4:]], axis=-1)

    def displace(self, reference: Array, error: Array) -> Array:
        """Turn by the rotation vector, add the rest; (..., n) and (..., n-1) to (..., n)."""
        turned = quaternion.multiply(quaternion.from_rotation_vector(error[..., :3]), reference[..., ATTITUDE])
        return np.concatenate([quaternion.normalize(turned), reference[..., 4:] + error[..., 3:]], axis=-1)

    def transition(self, transition: Array, before: Array, after: Array) -> Array:
        """blockdiag(2 Xi', I) Phi blockdiag(Xi / 2, I), the exact linearisation; (..., n, n) to (..., n-1, n-1)."""
        size = before.shape[-1]
        spread = np.zeros((*before.shape[:-1], size, size - 1))
        spread[..., :4, :3] = 0.5 * quaternion.xi(before[..., ATTITUDE])
        rest = np.arange(3, size - 1)
        spread[..., rest + 1, rest] = 1.0
        return _to_rotation(after) @ transition @ spread

    def sensitivity(self, jacobian: Array, state: Array) -> Array:
        """Times blockdiag(Xi / 2, I); (..., d, n) to (..., d, n-1)."""
        by_rotation = jacobian[..., ATTITUDE] @ (0.5 * quaternion.xi(state[..., ATTITUDE]))
        rest = jacobian[..., 4:]
        return np.concatenate([by_rotation, np.broadcast_to(rest, (*by_rotation.shape[:-1], rest.shape[-1]))], axis=-1)

    def reduce(self, mean: Array, covariance: Array) -> Array:
        """Unchanged; (..., n-1, n-1)."""
        return covariance
