"""Analytic model of an agent that slides in a plane, its unknown dynamics a Chebyshev network whose weights are states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.process import Linearization, ProcessModel, runge_kutta_along
from models.dynamics.state_layout import PLANE, VELOCITY

Array = NDArray[np.floating]


@dataclass(frozen=True)
class PlanarAgent:
    """dx/dt = v, dv/dt = (W phi(x, v) + u) / m, dW/dt = 0, of the state [x, v, W row by row] (Rososhansky 2017, eq. 5.4-5.6).

    The command is the force u, (..., 2) N.

    Attributes:
      network: of inputs (x, v) and one output an axis.
      mass: kg.
    """

    network: ChebyshevNetwork
    mass: float = 1.0

    @property
    def size(self) -> int:
        """States: positions, speeds and weights."""
        return 4 + self.network.size

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt; (..., n) and (..., 2) to (..., n)."""
        out = np.zeros(np.broadcast_shapes(state.shape, (*command.shape[:-1], 1)))
        out[..., :2] = state[..., 2:4]
        out[..., 2:4] = self.acceleration(state[..., PLANE], state[..., 4:], command)
        return out

    def acceleration(self, motion: Array, weights: Array, command: Array) -> Array:
        """dv/dt at [x, v]; (..., 4), (..., weights) and (..., 2) to (..., 2) m/s2."""
        return (self.network.output(weights, motion) + command) / self.mass

    def linearize(self, state: Array, command: Array) -> Linearization:
        """Derivative and Jacobian, (..., n) and (..., n, n)."""
        motion, weights = state[..., PLANE], state[..., 4:]
        rows = weights.reshape(*weights.shape[:-1], 2, self.network.terms)
        derivative = self.derivative(state, command)
        jacobian = np.zeros((*derivative.shape, self.size))
        jacobian[..., :2, 2:4] = np.eye(2)
        jacobian[..., VELOCITY, PLANE] = rows @ self.network.slope(motion) / self.mass
        jacobian[..., 2:4, 4:] = self.by_weights(motion)
        return Linearization(derivative, jacobian)

    def by_weights(self, motion: Array) -> Array:
        """Sensitivity of dv/dt to the weights, in which it is linear; (..., 4) to (..., 2, weights)."""
        basis = self.network.basis(motion) / self.mass
        out = np.zeros((*basis.shape[:-1], 2, 2, self.network.terms))
        out[..., 0, 0, :] = out[..., 1, 1, :] = basis
        return out.reshape(*basis.shape[:-1], 2, self.network.size)


def runge_kutta_of_motion(process: ProcessModel, state: Array, command: Array, dt: float) -> Array:
    """`process.runge_kutta` of a planar agent, which leaves the weights alone, since they do not move; (..., n)."""
    assert isinstance(process, PlanarAgent)
    motion, weights = state[..., PLANE], state[..., 4:]

    def slope(motion: Array) -> Array:
        return np.concatenate([motion[..., 2:], process.acceleration(motion, weights, command)], axis=-1)

    moved = runge_kutta_along(slope, motion, dt)
    out = np.array(np.broadcast_to(state, (*moved.shape[:-1], state.shape[-1])))
    out[..., PLANE] = moved
    return out
