"""Proportional, integral and derivative control of an axis, many laws at once, and the error that a law needs to give a torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]


class ErrorMemory(NamedTuple):
    """What a law remembers of the error r - y; leading axes: law, trial, ..."""

    total: Array  # (...,) rad s, its integral
    last: Array  # (...,) rad


@dataclass(frozen=True, eq=False)
class IntegralControl:
    """u = C_p e + C_I int e dt + C_d de/dt with e = r - y, or with - C_d dy/dt of the measured rate in place of the last term.

    Tsao, Brozenec & Safonov, eq. 5 and, of the measured rate and without integral, eq. 8. Sampled by the backward rule (Astrom & Wittenmark
    1997, sec. 8.5), s = (1 - 1/z) / T: the inverse of the law, their eq. 7, is then causal and stable for all gains that are not negative,
    so that any torque and motion tell at once what error and, as r = y + e, what reference the law would have needed.

    Attributes:
      proportional: C_p, N m/rad, (...,) as laws and trials are.
      integral: C_I, N m/(rad s).
      derivative: C_d, N m s/rad.
      of_error: whether the derivative is that of the error (eq. 5) instead of the measured rate (eq. 8).
      tick_s: sampling time T.
    """

    proportional: Array
    integral: Array
    derivative: Array
    of_error: Flags
    tick_s: float

    def start(self, shape: tuple[int, ...]) -> ErrorMemory:
        """No error so far."""
        return ErrorMemory(np.zeros(shape), np.zeros(shape))

    @property
    def _difference(self) -> Array:
        """Torque a change of the error from tick to tick, N m/rad."""
        return np.where(self.of_error, self.derivative, 0.0) / self.tick_s

    @property
    def _damping(self) -> Array:
        """Torque a measured rate, N m s/rad."""
        return np.where(self.of_error, 0.0, self.derivative)

    def torque(self, memory: ErrorMemory, error: Array, rate: Array) -> tuple[Array, ErrorMemory]:
        """Torque (...,) N m, and what is remembered; error rad, rate dy/dt rad/s."""
        total = memory.total + self.tick_s * error
        torque = self.proportional * error + self.integral * total + self._difference * (error - memory.last) - self._damping * rate
        return torque, ErrorMemory(total, error)

    def error(self, memory: ErrorMemory, torque: Array, rate: Array) -> tuple[Array, ErrorMemory]:
        """Error (...,) rad under which the law gives a torque, and what it then remembers; torque N m, rate dy/dt rad/s."""
        known = self.integral * memory.total - self._difference * memory.last - self._damping * rate
        error = (torque - known) / (self.proportional + self.integral * self.tick_s + self._difference)
        return error, ErrorMemory(memory.total + self.tick_s * error, error)
