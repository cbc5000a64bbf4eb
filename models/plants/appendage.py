"""A hub with an undamped flexible appendage about one axis: the linear analytic model of small angles, exact between samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Array = NDArray[np.floating]


class Sampled(NamedTuple):
    """x_next = transition x + input u, for a torque that is held over the step."""

    transition: Array  # (4, 4)
    input: Array  # (4,) per N m


@dataclass(frozen=True, eq=False)
class FlexibleChannel:
    """M d2(theta, q)/dt2 + K (theta, q) = (u, 0): hub angle theta and appendage angle q relative to the hub, both rad; u N m on the hub.

    One mode with zero damping ratio, as Tsao, Brozenec & Safonov assume in elevation (sec. 3); they print no equation: these are the
    hybrid coordinates of Likins (1970). With M12 = 0 the hub is rigid and the appendage stays at rest.

    Attributes:
      mass: M, (2, 2) kg m2; M11 of the whole about the axis, M22 of the appendage about its hinge, M12 between them.
      stiffness: K = diag(0, k), (2, 2) N m/rad.
    """

    mass: Array
    stiffness: Array

    @property
    def coupling(self) -> float:
        """M12^2 / (M11 M22), between 0 (rigid) and 1."""
        return float(self.mass[0, 1] ** 2 / (self.mass[0, 0] * self.mass[1, 1]))

    @property
    def held_frequency(self) -> float:
        """Of the mode while the hub is held (cantilevered), rad/s; the zero of the transfer function from torque to hub angle."""
        return float(np.sqrt(self.stiffness[1, 1] / self.mass[1, 1]))

    @property
    def free_frequency(self) -> float:
        """Of the mode while nothing holds the hub, rad/s; the pole: held_frequency / sqrt(1 - coupling)."""
        return self.held_frequency / float(np.sqrt(1.0 - self.coupling))

    @property
    def rates(self) -> tuple[Array, Array]:
        """A (4, 4) and b (4,) of dx/dt = A x + b u; x = [theta, q, dtheta/dt, dq/dt]."""
        inverse, rates = np.linalg.inv(self.mass), np.zeros((4, 4))
        rates[:2, 2:] = np.eye(2)
        rates[2:, :2] = -inverse @ self.stiffness
        return rates, np.concatenate([np.zeros(2), inverse[:, 0]])

    def sampled(self, dt: float) -> Sampled:
        """Exact motion over `dt` seconds under a torque that is held."""
        rates, push = self.rates
        transition, given, *_ = signal.cont2discrete((rates, push[:, None], np.eye(4), np.zeros((4, 1))), dt, method="zoh")
        return Sampled(transition, given[:, 0])

    def transfer(self, s: Array) -> Array:
        """Hub angle by torque at complex frequencies s (...,) rad/s, (...,) rad/(N m).

        (s^2 + w_held^2) / (M11 (1 - coupling) s^2 (s^2 + w_free^2)).
        """
        square = np.asarray(s) ** 2
        rest = self.mass[0, 0] * (1.0 - self.coupling)
        response: Array = (square + self.held_frequency**2) / (rest * square * (square + self.free_frequency**2))
        return response
