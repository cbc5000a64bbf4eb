"""Quaternion feedback: proportional to the attitude error, derivative on the rate error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models import quaternion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ProportionalDerivative:
    """torque_B = -K_p sign(dq_4) dq_1:3 - K_d (omega - A(dq) omega_d), with dq = q * q_d^-1.

    McCafferty-Leroux et al. (2024, eq. 27) print it for the absolute quaternion and rate, which can only regulate to the identity, and
    subtract it in eq. 9, which would be positive feedback; here it acts on the tracking error and is the torque on the body
    (Markley & Crassidis 2014, eq. 7.7, 7.14).

    Attributes:
      proportional: K_p, N m.
      derivative: K_d, N m s/rad.
    """

    proportional: float
    derivative: float

    def step(self, q_BN: Array, omega_BN_B: Array, q_desired: Array, omega_desired: Array) -> Array:
        """Torque on the body, (..., 3) N m in B.

        Args:
          q_BN: attitude, (..., 4).
          omega_BN_B: rate, (..., 3) rad/s.
          q_desired: attitude of the reference frame D, (..., 4).
          omega_desired: rate of D relative to N, resolved in D, (..., 3) rad/s.
        """
        error = quaternion.multiply(q_BN, quaternion.inverse(q_desired))
        rate_error = omega_BN_B - (quaternion.attitude_matrix(error) @ omega_desired[..., None])[..., 0]
        sign = np.where(error[..., 3:] < 0.0, -1.0, 1.0)
        return -self.proportional * sign * error[..., :3] - self.derivative * rate_error
