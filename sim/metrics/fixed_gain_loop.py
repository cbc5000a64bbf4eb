"""A fixed proportional-derivative controller around the linear flexible model, tick by tick: its responses and whether it is stable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.plants.appendage import FlexibleChannel

Array = NDArray[np.floating]

_ON_THE_CIRCLE = 1e-6  # a mode that the torque does not move stays there, up to rounding


@dataclass(frozen=True, eq=False)
class FixedGainLoop:
    """u_k = C_p (r_k - y_k) - C_d (dy/dt)_k, which the plant feels `delay_ticks` later and which is held for a tick.

    Attributes:
      channel: hub and appendage about the axis.
      proportional: C_p, N m/rad.
      derivative: C_d, N m s/rad.
      dt: of a tick, s.
      delay_ticks: from a decision to its torque.
    """

    channel: FlexibleChannel
    proportional: float
    derivative: float
    dt: float
    delay_ticks: int = 0

    @property
    def feedback(self) -> Array:
        """Torque by state [theta, q, dtheta/dt, dq/dt], (4,), with its sign turned."""
        return np.array([self.proportional, 0.0, self.derivative, 0.0])

    @property
    def is_stable(self) -> bool:
        """Whether no pole of the sampled loop is outside the unit circle."""
        transition, push = self.channel.sampled(self.dt)
        waiting = self.delay_ticks
        loop = np.zeros((4 + waiting, 4 + waiting))
        inner = slice(0, len(transition))
        loop[inner, inner] = transition
        if waiting:
            loop[:4, 4] = push
            loop[4:-1, 5:] = np.eye(waiting - 1)
            loop[-1, inner] = -self.feedback
        else:
            loop -= np.outer(push, self.feedback)
        return bool(np.max(np.abs(np.linalg.eigvals(loop))) <= 1.0 + _ON_THE_CIRCLE)

    def responses(self, frequency: Array) -> tuple[Array, Array]:
        """T_er and T_ur N m/rad from the reference at frequencies (n,) rad/s, complex (n,) each."""
        transition, push = self.channel.sampled(self.dt)
        z = np.exp(1j * frequency * self.dt)
        moved = np.linalg.solve(z[:, None, None] * np.eye(4) - transition, push[:, None])[..., 0] * z[:, None] ** -self.delay_ticks
        effort = self.proportional / (1.0 + moved @ self.feedback)
        return 1.0 - moved[:, 0] * effort, effort
