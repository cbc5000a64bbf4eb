"""Falsification: what recorded inputs and outputs alone say of a controller that need not have been in the loop.

With u = C_p (r - y) - C_d dy/dt and theta = (1/C_p, C_d/C_p), a controller theta would have produced the record under the fictitious
reference r~ = theta' psi + y, psi = (u, dy/dt) (Tsao, Brozenec & Safonov, eq. 8 and 11; Safonov & Tsao 1997). It is falsified when
||w1 * (r~ - y)|| >= ||r~|| or ||w2 * u|| >= ||r~||, norms in L2[0, t] (eq. 10): two quadratic inequalities in theta, whose
coefficients are running sums.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from control import conics

Array = NDArray[np.floating]

DAMPING_PARABOLA = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # 2 theta_1 - theta_2^2, theta without unit


class Evidence(NamedTuple):
    """What is remembered of the record: a filter's state and two sums."""

    lag: Array  # (..., 2) state of the weight on psi
    plain: Array  # (..., 3, 3) s, integral of phi phi' with phi = (psi, y), so that the integral of r~^2 is x' plain x, x = (theta, 1)
    weighted: Array  # (..., 2, 2) s, integral of zeta zeta' with zeta = w1 * psi


@dataclass(frozen=True, eq=False)
class Specification:
    """|T_er| < 1/|W1| and |T_ur| < 1/|W2|, W1 = (s + z)/(s + z/100)/M1 and W2 = (s + z)/(s + z/100)/k2, discretised by Tustin's rule.

    Frequency counts in units of the pace lambda (rad/s) and torque a radian in units of J^ lambda^2, J^ being the inertia believed:
    theta = (J^ lambda^2 / C_p, lambda C_d / C_p) and psi = (u / (J^ lambda^2), (dy/dt) / lambda) have no unit. The seed prints neither
    weight; it says that the zero is near the flexible mode and that 1/W1 and 1/W2 bound the responses of a faster loop than the
    nominal one. k2 is the torque a radian that is allowed at high frequency, where T_ur tends to C_p.

    Attributes:
      zero: z / lambda.
      error_bound: M1, the bound on |T_er| at high frequency.
      effort_bound: k2 / (J^ lambda^2), a number or (axes,).
      tick: lambda times the sampling time.
    """

    zero: float
    error_bound: float
    effort_bound: float | Array
    tick: float

    def start(self, shape: tuple[int, ...]) -> Evidence:
        """No evidence yet."""
        return Evidence(np.zeros((*shape, 2)), np.zeros((*shape, 3, 3)), np.zeros((*shape, 2, 2)))

    @cached_property
    def weight(self) -> tuple[float, float, float]:
        """W1 as b_0, b_1, a_1 of (b_0 + b_1 / z) / (1 + a_1 / z)."""
        numerator, denominator, _ = signal.cont2discrete(([1.0, self.zero], [1.0, 0.01 * self.zero]), self.tick, method="bilinear")
        b, a = numerator[0] / self.error_bound, denominator
        return float(b[0]), float(b[1]), float(a[1])

    def record(self, evidence: Evidence, effort: Array, rate: Array, position: Array) -> Evidence:
        """Add a sample; effort u, rate dy/dt and position y, counted from the attitude of rest, (...,) each and without unit."""
        b_0, b_1, a_1 = self.weight
        psi = np.stack([effort, rate], axis=-1)
        phi = np.stack([effort, rate, position], axis=-1)
        zeta = b_0 * psi + evidence.lag
        return Evidence(
            lag=b_1 * psi - a_1 * zeta,
            plain=evidence.plain + self.tick * phi[..., :, None] * phi[..., None, :],
            weighted=evidence.weighted + self.tick * zeta[..., :, None] * zeta[..., None, :],
        )

    def tests(self, evidence: Evidence) -> Array:
        """The error's and the effort's conic, (..., 2, 3, 3): theta is falsified where either is not negative.

        theta' (int zeta zeta' - psi psi') theta - 2 theta' B + C with B = + int psi y, C_e = - int y^2, C_u = int (w2 * u)^2 - y^2. The
        seed's eq. 12 has B = - int psi y and C_e = + int y^2, which contradict its eq. 10 and 11: theta = 0, that is no error at all,
        would be falsified. Both weights have one shape, so w2 * u = (M1 / k2) w1 * u.
        """
        tests = np.stack([-evidence.plain, -evidence.plain], axis=-3)
        tests[..., 0, :2, :2] += evidence.weighted
        tests[..., 1, 2, 2] += (self.error_bound / self.effort_bound) ** 2 * evidence.weighted[..., 0, 0]
        return tests


def energy(tests: Array) -> Array:
    """The integral of y^2, (...,) rad^2 s without unit of time; tests (..., 2, 3, 3)."""
    return -tests[..., 0, 2, 2]


def tightened(tests: Array, margin: float) -> Array:
    """Tests (..., 2, 3, 3) that are failed earlier, by `margin` times the integral of y^2."""
    tighter = tests.copy()
    tighter[..., 2, 2] += margin * energy(tests)[..., None]
    return tighter


def values(tests: Array, theta: Array) -> Array:
    """Both tests of theta (..., 2), (..., 2); falsified where >= 0."""
    return conics.value(tests, theta[..., None, :])
