"""Attitude regulation without a rate gyro: backstepping on an observer's rate, in finite time if so wished."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.feed_forward import BodyModel, times
from control.tracking import Estimate, Target, tracking_error
from models.attitude.quaternion import align, cross, inverse, multiply

Array = NDArray[np.floating]


def sig(value: Array, power: float) -> Array:
    """|x|^p sign(x), component by component."""
    return np.sign(value) * np.abs(value) ** power


@dataclass(frozen=True)
class OutputFeedback:
    """torque_B = J [-k2 sig^(2a-1)(xi) - gamma^2 kappa sig^a(q~)] + omega x (J omega + h), xi = sig^(1/a)(omega) - sig^(1/a)(omega_d).

    Rososhansky (2017, eq. 3.12), after Zou et al. (2014). All rates are estimates relative to the target's; omega_d = -k1 sig^a(dq_1:3) is
    the one that shrinks the estimated attitude error. The last term cancels the model's gyroscopic torque -omega x (J omega + h). The
    thesis writes omega_d = -k1 q, the same for a = 1, its value; with a < 1 it would let the attitude decay no faster than exp(-k1 t / 2).

    q~ is the observer's error, q_read * q^-1: the high-gain observer that the law is made for corrects its rate by gamma^2 kappa sig^a(q~),
    and only without that does the estimated rate obey d(omega)/dt = -k2 sig^(2a-1)(xi). Kalman and particle filters correct it otherwise;
    without a reading the term is left out.

    With a = 1 and a true state V = 2 (1 - dq_4) + |xi|^2 / 2 decreases if (1 + k1^2 / 2)^2 < 4 k1 (k2 - k1 / 2), and the attitude error
    dies out as exp(-k1 t / 2). With 1/2 < a < 1 it takes no more than 2 |q_i|^(1-a) / (k1 (1 - a)) on the surface xi = 0, dq_4 being one.

    Attributes:
      model: of the body, J and the wheels' momentum map.
      k1: rad/s, rate asked for a unit of quaternion error (to the power a).
      k2: 1/s for a = 1, rate at which omega_d is approached.
      gamma: 1/s, gain of the observer.
      kappa: another, no unit.
      power: a, above 1/2 and at most 1.
      shortest: turn to the nearer of dq_4 = 1 and -1, which are one attitude; False: to +1 as printed, the long way if need be.
    """

    model: BodyModel
    k1: float = 0.05
    k2: float = 15.0
    gamma: float = 2.0
    kappa: float = 10.0
    power: float = 1.0
    shortest: bool = False

    def __post_init__(self) -> None:
        if not 0.5 < self.power <= 1.0:
            raise ValueError(f"power a = {self.power:g}: need 1/2 < a <= 1")

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (..., 3) N m in B, without any limit."""
        error, a = tracking_error(estimate, target), self.power
        dq = error.dq if self.shortest else multiply(estimate.q_BN, inverse(target.q_DN))
        surface = sig(error.rate, 1.0 / a) + self.k1 ** (1.0 / a) * dq[..., :3]  # sig^(1/a) of -k1 sig^a(dq)
        wanted = -self.k2 * sig(surface, 2.0 * a - 1.0)
        if estimate.q_read is not None:
            missed = multiply(align(estimate.q_read, estimate.q_BN), inverse(estimate.q_BN))[..., :3]
            wanted = wanted - self.gamma**2 * self.kappa * sig(np.nan_to_num(missed, nan=0.0), a)
        momentum = times(self.model.inertia, estimate.omega_BN_B) + self.model.wheel_momentum(estimate)
        return times(self.model.inertia, wanted) + cross(estimate.omega_BN_B, momentum)
