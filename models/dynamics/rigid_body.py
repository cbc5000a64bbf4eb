"""Rigid body under known torques and known stored momentum: the seven-state analytic model of a spacecraft whose wheels are measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from models.dynamics.process import Linearization
from models.dynamics.state_layout import MOTION

Array = NDArray[np.floating]


def _no_torque() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class RigidBody:
    """Attitude and body rate, [q_BN, omega_BN_B], driven by r inputs u and turned by s stored momenta that are known, [u, s].

    dq/dt = Xi(q) omega / 2, J domega/dt = torque_map u + constant_torque_B - omega x (J omega + momentum_map s)
    (Hill et al. 2021, eq. 3, 4; Markley & Crassidis 2014, eq. 3.20, 3.147). The paper's T_c = -dh_w/dt is the torque on the body; with
    motor torques on the wheels as inputs the body feels minus them, torque_map = -W, and with wheel speeds as s momentum_map = W J_w.
    The wheels' own answer to domega/dt (J_w / J) is neglected, as in the paper.

    Attributes:
      inertia: J of the whole with wheels locked, (3, 3) kg m2. Any invertible tensor is accepted.
      torque_map: N m on the body in B per unit of input, (..., 3, r); leading axes, such as fault modes, broadcast with those of states.
      momentum_map: N m s in B per unit of stored momentum, (3, s); s may be zero.
      constant_torque_B: what acts on the body whatever the input, (..., 3) N m; leading axes as above.
    """

    inertia: Array
    torque_map: Array
    momentum_map: Array
    constant_torque_B: Array = field(default_factory=_no_torque)

    turns: ClassVar[bool] = True

    @property
    def size(self) -> int:
        """Number of states."""
        return 7

    @cached_property
    def _inverse(self) -> Array:
        return np.linalg.inv(self.inertia)

    @cached_property
    def _input(self) -> Array:
        """Angular acceleration per unit of input, (..., 3, r)."""
        return self._inverse @ self.torque_map

    @cached_property
    def _constant(self) -> Array:
        """Angular acceleration by the constant torque, (..., 3) rad/s2."""
        return (self._inverse @ self.constant_torque_B[..., None])[..., 0]

    def _acceleration(self, command: Array) -> Array:
        """By input and constant torque, (..., r + s) to (..., 3) rad/s2."""
        return (self._input @ command[..., : self.torque_map.shape[-1], None])[..., 0] + self._constant

    def _motion(self, state: Array, momentum: Array, acceleration: Array) -> Array:
        """dx/dt of states (..., 7) with stored momentum (..., 3) N m s in B and angular acceleration by torques (..., 3) rad/s2.

        Written out by component on arrays of their own: the same bits whatever the batch, because every operation is element by element,
        and without the overhead of many products of small matrices.
        """
        q1, q2, q3, q4, w1, w2, w3 = own = np.moveaxis(state, -1, 0).copy()
        H1, H2, H3 = (_combine(self.inertia[i], (w1, w2, w3), momentum[..., i]) for i in range(3))
        torque = (H2 * w3 - H3 * w2, H3 * w1 - H1 * w3, H1 * w2 - H2 * w1)  # -omega x H
        own[4:] *= 0.5  # the kinematics' half
        w1, w2, w3 = own[4:]
        motion = np.empty((*np.broadcast_shapes(state.shape[:-1], momentum.shape[:-1], acceleration.shape[:-1]), 7))
        motion[..., 0] = q4 * w1 - q3 * w2 + q2 * w3
        motion[..., 1] = q3 * w1 + q4 * w2 - q1 * w3
        motion[..., 2] = q1 * w2 - q2 * w1 + q4 * w3
        motion[..., 3] = -(q1 * w1 + q2 * w2 + q3 * w3)
        for i in range(3):
            motion[..., 4 + i] = _combine(self._inverse[i], torque, acceleration[..., i])
        return motion

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt; state (..., 7), command [u, s] (..., r + s)."""
        momentum = (self.momentum_map @ command[..., self.torque_map.shape[-1] :, None])[..., 0]
        return self._motion(state, momentum, self._acceleration(command))

    @cached_property
    def _curvature(self) -> Array:
        """Constant second derivatives of the torque-free motion in state and stored momentum (3,), first by the state: (49, 10).

        The motion is purely quadratic in the two together, so polarisation finds them exactly.
        """
        unit, none = np.eye(10), np.zeros(3)
        single = self._motion(unit[:, MOTION], unit[:, MOTION.stop :], none)
        sums = unit[:, None, :] + unit[None, :, :]
        pairs = self._motion(sums[..., MOTION], sums[..., MOTION.stop :], none) - single[:, None, :] - single[None, :, :]
        return np.ascontiguousarray(np.moveaxis(pairs[MOTION], -1, 0).reshape(49, 10))

    @cached_property
    def _momentum_slope(self) -> Array:
        """Constant change of the Jacobian with the momentum variables, (49, s)."""
        return self._curvature[:, MOTION.stop :] @ self.momentum_map

    @cached_property
    def _state_slope(self) -> Array:
        """Constant change of the Jacobian with the state, (49, 7)."""
        return np.ascontiguousarray(self._curvature[:, MOTION])

    def linearize(self, state: Array, command: Array) -> Linearization:
        """dx/dt and its Jacobian, linear in state and momentum; state (..., 7), command [u, s] (..., r + s)."""
        momentum = command[..., self.torque_map.shape[-1] :]
        slopes = self._state_slope @ state[..., None] + self._momentum_slope @ momentum[..., None]
        return Linearization(self.derivative(state, command), slopes.reshape(*slopes.shape[:-2], 7, 7))

    def momentum(self, state: Array, command: Array) -> Array:
        """Total angular momentum in B, J omega + momentum_map s, N m s; (..., 7) and (..., r + s) to (..., 3)."""
        stored = self.momentum_map @ command[..., self.torque_map.shape[-1] :, None]
        return (self.inertia @ state[..., 4:, None] + stored)[..., 0]


def _combine(row: Array, parts: tuple[Array, ...], start: Array) -> Array:
    """Sum of `start` and row_i parts_i, without the zeros of a diagonal tensor."""
    for factor, part in zip(row, parts, strict=True):
        if factor:
            start = start + factor * part
    return start
