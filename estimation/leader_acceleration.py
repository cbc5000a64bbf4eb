"""Distributed estimate of a leader's acceleration by agents most of which do not see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


@dataclass(frozen=True)
class LeaderAccelerationFilter:
    """dp_i/dt = -gain (sum_j a_ij (p_i - p_j) + a_i0 (p_i - dv_0/dt)) (Rososhansky 2017, eq. 4.10, which lacks the minus).

    What is heard holds for a tick, as messages do; the equation is then solved exactly. With a plus the estimates run away.

    Attributes:
      gain: 1/s.
      sign: -1; +1 is the sign as printed.
    """

    gain: float = 10.0
    sign: float = -1.0

    def step(self, estimate: Array, heard: Array, listening: Array, dt: float) -> Array:
        """Estimates after a tick.

        Args:
          estimate: p of each agent, (..., agents, 3) 1/s2.
          heard: the leader's acceleration and the agents' estimates as each agent has them, (..., agents or 1, 1 + agents, 3).
          listening: weights, (..., agents, 1 + agents).
          dt: of the tick, s.
        """
        total = np.sum(listening, axis=-1)[..., None]
        pulled = (listening[..., None, :] @ heard)[..., 0, :]
        mean = np.where(total > 0.0, pulled / np.where(total > 0.0, total, 1.0), estimate)
        return mean + (estimate - mean) * np.exp(self.sign * self.gain * total * dt)
