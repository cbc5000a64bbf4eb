"""Modified Rodrigues parameters of attitudes: sigma = e tan(theta / 4), three numbers that tell a turn from its complement.

sigma and its shadow -sigma / |sigma|^2 are one attitude reached by two turns, theta and theta - 2 pi, as q and -q are. Nothing here changes
from one to the other unless it says so, and the sign of a quaternion is taken as it is: sigma follows a body continuously through
|sigma| = 1, half a turn, up to the singular full turn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.attitude.quaternion import cross_matrix

Array = NDArray[np.floating]


def from_quaternion(quaternion: Array) -> Array:
    """Parameters of scalar-last unit quaternions, q_v / (1 + q_4); (..., 4) to (..., 3). The sign of q chooses the set."""
    return quaternion[..., :3] / (1.0 + quaternion[..., 3:])


def to_quaternion(sigma: Array) -> Array:
    """Unit quaternions, scalar last, of the same turn: q_4 < 0 where |sigma| > 1; (..., 3) to (..., 4)."""
    square = np.sum(sigma * sigma, axis=-1, keepdims=True)
    return np.concatenate([2.0 * sigma, 1.0 - square], axis=-1) / (1.0 + square)


def shadow(sigma: Array) -> Array:
    """The same attitude by the complementary turn, -sigma / |sigma|^2 (Schaub & Junkins 1996); (..., 3), not zero."""
    return -sigma / np.sum(sigma * sigma, axis=-1, keepdims=True)


def shorter(sigma: Array) -> Array:
    """Of the two sets the one with |sigma| <= 1, turns of at most pi; (..., 3); NaN if a component is missing, since either may be it."""
    square = np.sum(sigma * sigma, axis=-1, keepdims=True)
    return np.where(square > 1.0, -sigma / np.where(square > 1.0, square, 1.0), np.where(np.isnan(square), np.nan, sigma))


def nearer(sigma: Array, reference: Array) -> Array:
    """Of the two sets the one nearer to `reference` in its components; (..., 3); NaN if a component is missing, since either may be it."""
    square = np.sum(sigma * sigma, axis=-1, keepdims=True)
    other = -sigma / np.where(square > 0.0, square, np.inf)
    there = np.sum((other - reference) ** 2, axis=-1, keepdims=True) < np.sum((sigma - reference) ** 2, axis=-1, keepdims=True)
    return np.where(there & (square > 0.0), other, np.where(np.isnan(square), np.nan, sigma))


def kinematics(sigma: Array) -> Array:
    """T, with d sigma / dt = T omega_BN_B (Rososhansky 2017, eq. 4.5; Markley & Crassidis 2014, eq. 3.24); (..., 3) to (..., 3, 3)."""
    square = np.sum(sigma * sigma, axis=-1)[..., None, None]
    return 0.5 * (0.5 * (1.0 - square) * np.eye(3) + cross_matrix(sigma) + sigma[..., :, None] * sigma[..., None, :])


def rate(sigma: Array, omega: Array) -> Array:
    """Change d sigma / dt by body rates, rad/s; (..., 3) and (..., 3) to (..., 3) 1/s."""
    return (kinematics(sigma) @ omega[..., None])[..., 0]


def body_rate(sigma: Array, rate: Array) -> Array:
    """omega_BN_B = T^-1 d sigma / dt, where T^-1 = 16 T' / (1 + |sigma|^2)^2; (..., 3) and (..., 3) to (..., 3) rad/s."""
    square = np.sum(sigma * sigma, axis=-1, keepdims=True)
    return 16.0 / (1.0 + square) ** 2 * (kinematics(sigma).swapaxes(-1, -2) @ rate[..., None])[..., 0]
