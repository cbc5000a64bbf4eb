"""Quaternion feedback: proportional to the attitude error, derivative on the rate error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.tracking import Estimate, Target, tracking_error

Array = NDArray[np.floating]


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

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (..., 3) N m in B; the wheel speeds and the target's acceleration are not used."""
        error = tracking_error(estimate, target)
        return -self.proportional * error.dq[..., :3] - self.derivative * error.rate
