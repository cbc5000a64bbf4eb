"""Quaternion feedback: proportional to the attitude error, derivative on the rate error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.feed_forward import BodyModel, feed_forward
from control.gain_blending import blend
from control.tracking import Estimate, Target, tracking_error

Array = NDArray[np.floating]


@dataclass(frozen=True)
class ProportionalDerivative:
    """torque_B = -K_p sign(dq_4) dq_1:3 - K_d (omega - A(dq) omega_d), with dq = q * q_d^-1.

    McCafferty-Leroux et al. (2024, eq. 27) print it for the absolute quaternion and rate, which can only regulate to the identity, and
    subtract it in eq. 9, which would be positive feedback; here it acts on the tracking error and is the torque on the body
    (Markley & Crassidis 2014, eq. 7.7, 7.14). Hill et al. (2021, eq. 32-34) add the feed-forward of a body model and blend gains of
    several modes.

    Attributes:
      proportional: K_p, N m; one number, or one a mode, the healthy one first.
      derivative: K_d, N m s/rad; likewise.
      model: of the body, for the feed-forward; None: pure feedback.
    """

    proportional: float | tuple[float, ...]
    derivative: float | tuple[float, ...]
    model: BodyModel | None = None

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (..., 3) N m in B; wheel speeds and the target's acceleration serve the feed-forward alone."""
        error = tracking_error(estimate, target)
        proportional = blend(self.proportional, estimate.mode_probabilities)[..., None]
        derivative = blend(self.derivative, estimate.mode_probabilities)[..., None]
        feedback = -proportional * error.dq[..., :3] - derivative * error.rate
        return feedback if self.model is None else feedback + feed_forward(self.model, estimate, error, target)
