"""Attitude over a step in closed form: one rotation, found from the rates at the stages of a Runge-Kutta step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion

Array = NDArray[np.floating]


def rotation(rates: tuple[Array, Array, Array, Array], dt: float) -> Array:
    """Rotation vector of a step, (..., 3) rad in B, by Magnus' expansion to fourth order.

    dt/6 (w1 + 2 w2 + 2 w3 + w4) + dt^2/12 w1 x w4. A constant rate gives Markley & Crassidis (2014, eq. 6.60), which is exact; the
    second term is what rates that change their direction do, since rotations do not commute (Iserles et al. 2000, eq. 2.25).

    Args:
      rates: at the four stages, (..., 3) rad/s in B.
      dt: step, s.
    """
    first, second, third, last = rates
    return dt / 6.0 * (first + 2.0 * (second + third) + last) + dt**2 / 12.0 * quaternion.cross(first, last)


def turned(attitude: Array, turn: Array) -> Array:
    """Attitude (..., 4) after a turn by a rotation vector (..., 3)."""
    return quaternion.multiply(quaternion.from_rotation_vector(turn), attitude)


def rotation_sensitivity(rates: tuple[Array, Array, Array, Array], by_state: tuple[Array, Array, Array, Array], dt: float) -> Array:
    """How the rotation changes with the state before the step, (..., 3, n), given how the rates at the stages do, (..., 3, n)."""
    first, second, third, last = by_state
    turning = quaternion.cross_matrix(rates[0]) @ last - quaternion.cross_matrix(rates[3]) @ first
    return dt / 6.0 * (first + 2.0 * (second + third) + last) + dt**2 / 12.0 * turning


def turned_sensitivity(after: Array, turn: Array, by_state: Array, attitude_before: slice) -> Array:
    """How the attitude after a turn changes with the state before, (..., 4, n).

    Args:
      after: attitude after the turn, (..., 4).
      turn: its rotation vector, (..., 3).
      by_state: how that changes with the state before, (..., 3, n).
      attitude_before: where the attitude lies in that state, which is turned along.
    """
    matrix = 0.5 * quaternion.xi(after) @ (_left_jacobian(turn) @ by_state)
    matrix[..., attitude_before] += quaternion.product_matrix(quaternion.from_rotation_vector(turn))
    return matrix


def _left_jacobian(turn: Array) -> Array:
    """J with exp(turn + d) = exp(J d) exp(turn), (..., 3, 3), for rotations that map N to B."""
    square = np.vecdot(turn, turn)[..., None, None]
    angle = np.sqrt(square)
    half = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2  # (1 - cos a) / a^2
    small = square < 1e-2
    series = (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))) / 6.0
    third = np.where(small, series, (angle - np.sin(angle)) / np.where(small, 1.0, square * angle))  # (a - sin a) / a^3
    cross = quaternion.cross_matrix(turn)
    return np.eye(3) - half * cross + third * (cross @ cross)
