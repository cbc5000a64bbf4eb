"""Mass properties of rigid bodies: moving the reference point, and what no rigid body can have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.floating]


def tensor(moments: tuple[float, ...] | Array) -> Array:
    """Symmetric tensor of [xx, yy, zz, xy, xz, yz], MuJoCo's order, kg m2; (..., 6) to (..., 3, 3)."""
    xx, yy, zz, xy, xz, yz = np.moveaxis(np.asarray(moments, dtype=float), -1, 0)
    return np.stack([np.stack([xx, xy, xz], -1), np.stack([xy, yy, yz], -1), np.stack([xz, yz, zz], -1)], -2)


def elements(inertia: Array) -> tuple[float, ...]:
    """[xx, yy, zz, xy, xz, yz] of a symmetric tensor (3, 3), kg m2: the inverse of `tensor`."""
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    return tuple(inertia[rows, columns].tolist())


def point_mass(mass: Array | float, position: Array) -> Array:
    """Inertia about the origin of a point mass, m (r.r I - r r'), kg m2; position (..., 3) m to (..., 3, 3)."""
    square = np.sum(position * position, axis=-1)[..., None, None]
    return np.asarray(mass)[..., None, None] * (square * np.eye(3) - position[..., :, None] * position[..., None, :])


def why_impossible(inertia: Array) -> str | None:
    """Why no rigid body has the tensor (3, 3), kg m2, or None: symmetric, positive, each moment at most the sum of the others."""
    if not np.allclose(inertia, inertia.T, rtol=0, atol=1e-12 * np.abs(inertia).max()):
        return "it is not symmetric"
    low, middle, high = np.linalg.eigvalsh(inertia)
    if low <= 0:
        return f"its principal moment {low:.6g} kg m2 is not positive"
    if high > (low + middle) * (1 + 1e-9):
        return f"its principal moments break the triangle inequality: {high:.6g} > {low:.6g} + {middle:.6g} kg m2"
    return None


def principal(inertia: Array) -> tuple[Array, Array]:
    """Principal moments (..., 3), descending, and MuJoCo's scalar-first quaternion (..., 4) of their axes, of tensors (..., 3, 3)."""
    moments, axes = np.linalg.eigh(inertia)
    moments, axes = moments[..., ::-1], axes[..., ::-1]
    axes = axes * np.where(np.linalg.det(axes) < 0, -1.0, 1.0)[..., None, None]
    quaternion = Rotation.from_matrix(axes.reshape(-1, 3, 3)).as_quat(scalar_first=True)
    return moments, quaternion.reshape(*moments.shape[:-1], 4)
