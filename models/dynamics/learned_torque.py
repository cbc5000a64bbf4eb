"""Rigid body that feels a torque nobody modelled: a Chebyshev network of what the torque can depend on, its weights to be learned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from models.attitude.quaternion import cross_matrix
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.process import runge_kutta_along
from models.dynamics.rigid_body import RigidBody
from models.dynamics.state_layout import ATTITUDE
from models.dynamics.unmodelled_torque import vertical

Array = NDArray[np.floating]
Input = Literal["tilt", "rate", "wheels"]


@dataclass(frozen=True)
class TorqueBasis:
    """phi of a torque W phi: Chebyshev polynomials of each input alone (`ChebyshevNetwork`), or nothing but a constant.

    Physics says which inputs carry anything. `tilt`: the horizontal components of the vertical in B, in which the torque of a centre of
    mass is linear; the third is one but for their squares, so that heading drops out. `rate`: drag. `wheels`: the speed of each wheel,
    since dry friction of one does not know the others. Inputs are scaled to [-1, 1] and cut off there, where polynomials would explode.

    Attributes:
      inputs: which; none, or order 0: a constant torque in B.
      order: of the highest polynomial.
      wheels: number of wheels.
      greatest_tilt: rad, that is 1.
      greatest_rate: rad/s, that is 1.
      greatest_speed: of a wheel, rad/s, that is 1.
    """

    inputs: tuple[Input, ...] = ("tilt", "rate", "wheels")
    order: int = 3
    wheels: int = 4
    greatest_tilt: float = 0.2
    greatest_rate: float = 0.1
    greatest_speed: float = 500.0

    @cached_property
    def network(self) -> ChebyshevNetwork | None:
        """The network; None: a constant."""
        count = {"tilt": 2, "rate": 3, "wheels": self.wheels}
        size = sum(count[name] for name in self.inputs)
        return ChebyshevNetwork(size, 3, self.order) if size and self.order else None

    @property
    def terms(self) -> int:
        """Entries of phi."""
        return self.network.terms if self.network else 1

    def of(self, motion: Array, speed: Array) -> Array:
        """Phi at [q, omega], (..., 7), and wheel speeds (..., wheels) rad/s; (..., terms)."""
        if self.network is None:
            return np.ones((*np.broadcast_shapes(motion.shape[:-1], speed.shape[:-1]), 1))
        lead = np.broadcast_shapes(motion.shape[:-1], speed.shape[:-1])
        known = {
            "tilt": vertical(motion[..., ATTITUDE])[..., :2] / np.sin(self.greatest_tilt),
            "rate": motion[..., 4:] / self.greatest_rate,
            "wheels": speed / self.greatest_speed,
        }
        parts = [known[name] for name in self.inputs]
        inputs = np.concatenate([np.broadcast_to(part, (*lead, part.shape[-1])) for part in parts], axis=-1)
        return self.network.basis(np.clip(inputs, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class BodyWithLearnedTorque:
    """`RigidBody` plus a torque W phi(q, omega, omega_wheel): J domega/dt = ... + W phi, dW/dt = 0 (as Rososhansky 2017, eq. 5.4-5.6).

    The command is [torques of the wheel motors, wheel speeds], (..., 2 wheels); parameters are W row by row, N m. Attitude and rate tell
    W phi through domega/dt alone: one torque a tick, so that only the torque along the flown path can be learned, not the weights.

    Attributes:
      body: what is known.
      basis: what the unknown torque can depend on; None: there is none.
    """

    body: RigidBody
    basis: TorqueBasis | None = None

    @property
    def parameters(self) -> int:
        """Entries of W."""
        return 3 * self.basis.terms if self.basis else 0

    @cached_property
    def _inverse(self) -> Array:
        return np.linalg.inv(self.body.inertia)

    def _speed(self, command: Array) -> Array:
        return command[..., self.body.torque_map.shape[-1] :]

    def torque(self, motion: Array, weights: Array, speed: Array) -> Array:
        """W phi, (..., 3) N m in B; motion [q, omega] (..., 7), weights (..., parameters), wheel speeds (..., wheels) rad/s."""
        if self.basis is None:
            return np.zeros((*motion.shape[:-1], 3))
        phi = self.basis.of(motion, speed)
        return np.einsum("...ij,...j->...i", weights.reshape(*weights.shape[:-1], 3, self.basis.terms), phi)

    def derivative(self, motion: Array, weights: Array, command: Array) -> Array:
        """d[q, omega]/dt; (..., 7), (..., parameters) and (..., 2 wheels) to (..., 7)."""
        out = self.body.derivative(motion, command)
        if self.basis is not None:
            torque = self.torque(motion, weights, self._speed(command))
            out[..., 4:] += (self._inverse @ torque[..., None])[..., 0]
        return out

    def move(self, motion: Array, weights: Array, command: Array, dt: float) -> Array:
        """[q, omega] after `dt` seconds of constant command and weights (Runge-Kutta); shapes as above."""
        return runge_kutta_along(lambda at: self.derivative(at, weights, command), motion, dt)

    def sensitivity(self, motion: Array, command: Array, dt: float) -> Array:
        """How weights turn and spin the body in `dt` seconds, rad and rad/s per N m; (..., 7) and (..., 2 wheels) to (..., 6, parameters).

        [dt^2 / 2 + dt^3 / 6 (A - [omega x]); dt + dt^2 / 2 A] J^-1 kron phi, where A = J^-1 ([H x] - [omega x] J) turns a rate's error
        on; the first terms alone miss some per cent when the wheels are fast. phi is that of the motion at half of `dt`, which is given.
        """
        lead = np.broadcast_shapes(motion.shape[:-1], command.shape[:-1])
        if self.basis is None:
            return np.zeros((*lead, 6, 0))
        phi = self.basis.of(motion, self._speed(command))
        turning = cross_matrix(motion[..., 4:])
        onward = self._inverse @ (cross_matrix(self.body.momentum(motion, command)) - turning @ self.body.inertia)
        turn = 0.5 * dt**2 * np.eye(3) + dt**3 / 6.0 * (onward - turning)
        per_torque = np.concatenate([turn, dt * np.eye(3) + 0.5 * dt**2 * onward], axis=-2) @ self._inverse
        return (per_torque[..., None] * phi[..., None, None, :]).reshape(*lead, 6, self.parameters)
