"""Analytic model of an agent that slides in a plane under a known force alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.dynamics.process import Linearization

Array = NDArray[np.floating]


@dataclass(frozen=True)
class PlanarBody:
    """dx/dt = v, dv/dt = u / m, of the state [x, v] (..., 4) in m and m/s; the command is the force u, (..., 2) N.

    Attributes:
      mass: kg.
    """

    mass: float = 1.0

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt; (..., 4) and (..., 2) to (..., 4)."""
        velocity = state[..., 2:]
        return np.concatenate([velocity, np.broadcast_to(command / self.mass, velocity.shape)], axis=-1)

    def linearize(self, state: Array, command: Array) -> Linearization:
        """Derivative and Jacobian, (..., 4) and (..., 4, 4)."""
        return Linearization(self.derivative(state, command), np.broadcast_to(np.eye(4, k=2), (*state.shape, 4)))
