"""Attitude quaternions, scalar last: q_BN = [q1, q2, q3, q4] with A(q) mapping N to B (Markley & Crassidis 2014, ch. 2).

The product is the one of Markley & Crassidis, A(p * q) = A(p) A(q); an error is what turns the reference into the actual
attitude, dq = q * q_ref^-1, so that its vector part is resolved in the body frame. MuJoCo, SciPy and Rerun store the
rotation from body to world: its quaternion has the same four numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

IDENTITY: Array = np.array([0.0, 0.0, 0.0, 1.0])

_LEVI_CIVITA = np.zeros((3, 3, 3))
_LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_LEVI_CIVITA[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1.0

_PRODUCT = np.zeros((4, 4, 4))  # (p * q)_i = _PRODUCT[i, j, k] p_j q_k
_PRODUCT[:3, :3, :3] = -_LEVI_CIVITA
_PRODUCT[[0, 1, 2], 3, [0, 1, 2]] = 1.0
_PRODUCT[[0, 1, 2], [0, 1, 2], 3] = 1.0
_PRODUCT[3, [0, 1, 2], [0, 1, 2]] = -1.0
_PRODUCT[3, 3, 3] = 1.0

_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


def cross_matrix(vector: Array) -> Array:
    """[v x], so that [v x] w = v x w (Markley & Crassidis 2014, eq. 2.55); (..., 3) to (..., 3, 3)."""
    return np.einsum("ijk,...j->...ik", _LEVI_CIVITA, vector)


def cross(left: Array, right: Array) -> Array:
    """Cross product of (..., 3) arrays."""
    return np.einsum("ijk,...j,...k->...i", _LEVI_CIVITA, left, right)


def multiply(left: Array, right: Array) -> Array:
    """Product with A(left * right) = A(left) A(right) (Markley & Crassidis 2014, eq. 2.82b); (..., 4)."""
    return np.einsum("ijk,...j,...k->...i", _PRODUCT, left, right)


def inverse(quaternion: Array) -> Array:
    """Inverse of unit quaternions: the conjugate; (..., 4)."""
    return quaternion * _CONJUGATE


def normalize(quaternion: Array) -> Array:
    """Scale to unit length; (..., 4)."""
    return quaternion / np.sqrt(_square(quaternion))


def attitude_matrix(quaternion: Array) -> Array:
    """A(q), which maps N to B (Markley & Crassidis 2014, eq. 2.125); (..., 4) to (..., 3, 3)."""
    vector, scalar = quaternion[..., :3], quaternion[..., 3, None, None]
    square = np.vecdot(vector, vector)[..., None, None]
    outer = vector[..., :, None] * vector[..., None, :]
    return (scalar**2 - square) * np.eye(3) + 2.0 * outer - 2.0 * scalar * cross_matrix(vector)


def xi(quaternion: Array) -> Array:
    """Xi(q), with dq/dt = Xi(q) omega_BN_B / 2 (Markley & Crassidis 2014, eq. 3.20); (..., 4) to (..., 4, 3)."""
    return np.einsum("ijk,...k->...ij", _PRODUCT[:, :3, :], quaternion)


def from_rotation_vector(rotation: Array) -> Array:
    """Quaternion of a turn by |rotation| rad about `rotation`, resolved in B; (..., 3) to (..., 4)."""
    half = 0.5 * np.sqrt(_square(rotation))
    return np.concatenate([0.5 * np.sinc(half / np.pi) * rotation, np.cos(half)], axis=-1)


def to_rotation_vector(quaternion: Array) -> Array:
    """Shortest rotation vector, rad, of unit quaternions of either sign; (..., 4) to (..., 3)."""
    vector = quaternion[..., :3] * np.where(quaternion[..., 3:] < 0.0, -1.0, 1.0)
    sine = np.sqrt(_square(vector))
    half = np.arctan2(sine, np.abs(quaternion[..., 3:]))
    return 2.0 * vector / np.maximum(np.sinc(half / np.pi), 1e-300)


def error(quaternion: Array, reference: Array) -> Array:
    """Rotation vector, rad in B, that turns `reference` into `quaternion`; (..., 4) to (..., 3)."""
    return to_rotation_vector(multiply(quaternion, inverse(reference)))


def angle(quaternion: Array, reference: Array) -> Array:
    """Angle, rad in [0, pi], between two attitudes; (..., 4) to (...)."""
    turn = error(quaternion, reference)
    return np.sqrt(np.vecdot(turn, turn))


def align(quaternion: Array, reference: Array) -> Array:
    """Of q and -q, the same attitude, the one nearer to `reference`; (..., 4).

    With a component missing (NaN) nobody knows which that is, so that the attitude is missing: four NaN.
    """
    along = np.vecdot(quaternion, reference)[..., None]
    return quaternion * np.where(along < 0.0, -1.0, np.where(along >= 0.0, 1.0, np.nan))


def _square(vector: Array) -> Array:
    """Its length squared, (..., n) to (..., 1)."""
    return np.vecdot(vector, vector)[..., None]
