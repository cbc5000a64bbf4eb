"""Rigid body in modified Rodrigues parameters and their rates: the second-order analytic model of spacecraft in formation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.dynamics.process import Linearization

Array = NDArray[np.floating]
Vector = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class AttitudeByRodrigues:
    """Attitude and its rate, [sigma, v], under a torque on the body: dsigma/dt = v, dv/dt = f(sigma, v) + g(sigma) torque.

    f = -T dP/dt v - T J^-1 (P v) x J P v and g = T J^-1 with P = T^-1 (Rososhansky 2017, eq. 4.6). Any invertible tensor is accepted,
    also one that no body has. A body that carries spinning wheels turns what they hold with it: (P v) x (J P v + h), the torque being
    what their motors leave to the body and J without their spinning part (Markley & Crassidis 2014, eq. 3.147).

    Attributes:
      inertia: J, (..., 3, 3) kg m2; leading axes, such as agents, broadcast with those of states.
    """

    inertia: Array

    @property
    def size(self) -> int:
        """Number of states."""
        return 6

    @cached_property
    def _inverse(self) -> Array:
        return np.linalg.inv(self.inertia)

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt; state [sigma, v] (..., 6) in 1 and 1/s, command (..., 3) N m on the body in B, or (..., 6) with h, N m s, after it.

        Written out by component, as in `RigidBody`, for the same bits whatever the batch.
        """
        sigma, v = _split(state)
        omega = _body_rate(sigma, v)
        momentum = self._times(self.inertia, omega)
        if command.shape[-1] > 3:
            momentum = _plus(momentum, _split_one(command[..., 3:]))
        torque = _minus(_split_one(command[..., :3]), _cross(omega, momentum))
        moved = (*v, *self._carry(sigma, v, omega, self._times(self._inverse, torque)))
        motion = np.empty((*np.broadcast_shapes(state.shape[:-1], moved[-1].shape), 6), dtype=moved[-1].dtype)
        for i, part in enumerate(moved):
            motion[..., i] = part
        return motion

    def acceleration(self, state: Array) -> Array:
        """f(sigma, v), dv/dt without a torque; (..., 6) to (..., 3) 1/s2."""
        return self.derivative(state, np.zeros(3))[..., 3:]

    def torque(self, state: Array, acceleration: Array, stored: Array | None = None) -> Array:
        """Torque under which dv/dt is `acceleration`, g^-1 (a - f); (..., 6), (..., 3) 1/s2 and h (..., 3) N m s to (..., 3) N m."""
        sigma, v = _split(state)
        omega = _body_rate(sigma, v)
        none: Vector = (np.zeros(()), np.zeros(()), np.zeros(()))
        left = _minus(_split_one(acceleration), self._carry(sigma, v, omega, none))
        momentum = self._times(self.inertia, omega)
        if stored is not None:
            momentum = _plus(momentum, _split_one(stored))
        needed = _plus(self._times(self.inertia, _body_rate(sigma, left)), _cross(omega, momentum))
        return np.stack(np.broadcast_arrays(*needed), axis=-1)

    def linearize(self, state: Array, command: Array) -> Linearization:
        """dx/dt and its Jacobian by complex steps, exact to rounding; the model is analytic."""
        step = 1e-30
        moved = state[..., None, :] + 1j * step * np.eye(6)
        there = self._widened().derivative(moved, command[..., None, :])
        return Linearization(self.derivative(state, command), there.imag.swapaxes(-1, -2) / step)

    def _widened(self) -> AttitudeByRodrigues:
        """The same for states with one more axis."""
        return AttitudeByRodrigues(self.inertia[..., None, :, :])

    @cached_property
    def _diagonal(self) -> bool:
        return not np.any(self.inertia * (1.0 - np.eye(3)))

    def _times(self, matrix: Array, vector: Vector) -> Vector:
        """The tensor or its inverse (..., 3, 3) times vectors, without the zeros of a diagonal one."""
        x, y, z = vector
        if self._diagonal:
            return matrix[..., 0, 0] * x, matrix[..., 1, 1] * y, matrix[..., 2, 2] * z
        first, second, third = (matrix[..., i, 0] * x + matrix[..., i, 1] * y + matrix[..., i, 2] * z for i in range(3))
        return first, second, third

    @staticmethod
    def _carry(sigma: Vector, v: Vector, omega: Vector, alpha: Vector) -> Vector:
        """dT/dt omega + T alpha, of angular accelerations alpha in B."""
        inner = 0.5 * (1.0 - _dot(sigma, sigma))
        forward, along, outward = _dot(sigma, v), _dot(sigma, omega), _dot(v, omega) + _dot(sigma, alpha)
        turned, lifted = _cross(v, omega), _cross(sigma, alpha)
        first, second, third = (
            0.5 * (along * v[i] - forward * omega[i] + outward * sigma[i] + inner * alpha[i] + turned[i] + lifted[i]) for i in range(3)
        )
        return first, second, third


def _split_one(vector: Array) -> Vector:
    x, y, z = np.moveaxis(vector, -1, 0).copy()
    return x, y, z


def _split(state: Array) -> tuple[Vector, Vector]:
    s1, s2, s3, v1, v2, v3 = np.moveaxis(state, -1, 0).copy()
    return (s1, s2, s3), (v1, v2, v3)


def _dot(a: Vector, b: Vector) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _body_rate(sigma: Vector, v: Vector) -> Vector:
    """P v."""
    square, forward, turned = _dot(sigma, sigma), _dot(sigma, v), _cross(sigma, v)
    scale = 8.0 / (1.0 + square) ** 2
    inner = 0.5 * (1.0 - square)
    first, second, third = (scale * (inner * v[i] - turned[i] + forward * sigma[i]) for i in range(3))
    return first, second, third
