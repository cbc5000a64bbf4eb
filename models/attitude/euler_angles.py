"""3-1-3 Euler angles (phi, theta, psi) = (precession, nutation, spin) of A(q_BN) = R3(psi) R1(theta) R3(phi)."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.floating]

_INTRINSIC = "ZXZ"  # SciPy's matrix is A', body to world: Rz(phi) Rx(theta) Rz(psi), about axes that turn along


def from_euler_313(angles: Array) -> Array:
    """q_BN of (phi, theta, psi) rad (Markley & Crassidis 2014, ch. 2); (..., 3) to (..., 4)."""
    quaternion: Array = Rotation.from_euler(_INTRINSIC, angles.reshape(-1, 3)).as_quat()
    return quaternion.reshape(*angles.shape[:-1], 4)


def to_euler_313(quaternion: Array) -> Array:
    """(phi, theta, psi) rad with phi, psi in [-pi, pi], theta in [0, pi]; (..., 4) to (..., 3).

    At theta = 0 and pi only the sum or difference of phi and psi is known; psi is then set to zero. What lacks a component has no angles
    (NaN).
    """
    known = ~np.isnan(quaternion).any(axis=-1)
    angles = np.full((*quaternion.shape[:-1], 3), np.nan)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock", category=UserWarning)
        angles[known] = Rotation.from_quat(quaternion[known]).as_euler(_INTRINSIC)
    return angles


def wrapped_difference(angle: Array, reference: Array) -> Array:
    """Difference angle - reference, wrapped to [-pi, pi]; any shape, rad."""
    return np.mod(angle - reference + np.pi, 2.0 * np.pi) - np.pi
