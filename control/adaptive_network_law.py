"""Adaptive law: a network's weights driven by the sliding surface, so that a Lyapunov function cannot grow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


@dataclass(frozen=True)
class AdaptiveNetworkLaw:
    """dW/dt = Gamma s phi' (Rososhansky 2017, eq. 5.29), by explicit Euler steps.

    With s(0) of tens and polynomials of speeds beyond 1 it is stiff: at Gamma = 5 steps of 2 ms hold and 5 ms lose the agents.

    Attributes:
      rate: Gamma.
    """

    rate: float = 5.0

    def step(self, weights: Array, surface: Array, basis: Array, dt: float) -> Array:
        """Weights after `dt` seconds; row by row (..., outputs x terms), s (..., outputs), phi (..., terms)."""
        growth = surface[..., :, None] * basis[..., None, :]
        return weights + dt * self.rate * growth.reshape(*weights.shape)
