"""Plane conics as symmetric 3 x 3 matrices, and where two of them meet.

A conic is the set x' Q x = 0 of homogeneous points x = (x_1, x_2, 1): with Q = [[A, -b], [-b', c]] it is the quadratic
p' A p - 2 p' b + c of the plane point p. Ellipses, hyperbolas and parabolas are alike in this form; only their points at infinity differ.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

_HALF_ANGLE = np.array([[1.0, 0.0, -1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 1.0]])  # (1, t, t^2) to (1 - t^2, 2 t, 1 + t^2)
_LOOKS = np.arange(8) * (np.pi / 4.0)  # a trigonometric polynomial of degree two cannot be small at all eight


def homogeneous(point: Array) -> Array:
    """(..., 2) to (..., 3) with a last component of one."""
    return np.concatenate([point, np.ones((*point.shape[:-1], 1))], axis=-1)


def value(conic: Array, point: Array) -> Array:
    """The quadratic x' Q x, (...,); conic (..., 3, 3), point (..., 2)."""
    x = homogeneous(point)
    return np.sum(x * (conic @ x[..., None])[..., 0], axis=-1)


def intersections(first: Array, second: Array) -> Array:
    """Real finite common points of pairs of conics, (..., 4, 2), NaN where there are fewer; first, second (..., 3, 3).

    One conic of the pencil spanned by the two, all of which meet in the same points, is parametrised by t as p = M (1, t, t^2)'
    (for pencils see Richter-Gebert 2011); p in a second conic of the pencil is a quartic in t, whose roots are the eigenvalues of its
    companion matrix. The conic parametrised is the one farthest from degenerate, so pairs of lines are fine; two of them with a common
    line or a common vertex, and two multiples of one conic, give NaN. A point of tangency comes twice.
    """
    first, second = np.broadcast_arrays(_normalized(first), _normalized(second))
    carrier, other = _best_of_pencil(first, second)
    frame, real = _parametrisation(carrier)
    frame = frame @ _away_from_infinity(frame, other)
    form = frame.swapaxes(-1, -2) @ other @ frame
    quartic = np.stack(  # in falling powers of t
        [form[..., 2, 2], 2 * form[..., 1, 2], 2 * form[..., 0, 2] + form[..., 1, 1], 2 * form[..., 0, 1], form[..., 0, 0]], axis=-1
    )
    size = np.linalg.norm(frame, axis=(-2, -1)) ** 2
    real = real & (np.abs(quartic[..., 0]) > 1e-14 * size)
    quartic = np.where(real[..., None], quartic, [1.0, 0.0, 0.0, 0.0, 1.0])  # t^4 = -1 has no real root
    t, found = _real_roots(quartic / quartic[..., :1])
    point = (frame[..., None, :, :] @ np.stack([np.ones_like(t), t, t * t], axis=-1)[..., None])[..., 0]
    found = found & (np.abs(point[..., 2]) > 1e-12 * np.linalg.norm(point, axis=-1))
    return np.where(found[..., None], point[..., :2], np.nan) / np.where(found, point[..., 2], 1.0)[..., None]


def _normalized(conic: Array) -> Array:
    return conic / np.maximum(np.linalg.norm(conic, axis=(-2, -1), keepdims=True), 1e-300)


def _best_of_pencil(first: Array, second: Array) -> tuple[Array, Array]:
    """The conic of the pencil whose smallest eigenvalue is largest, and another one to cut it with; (..., 3, 3) each."""
    carriers = np.stack([first, second, first + second, first - second], axis=-3)
    others = np.stack([second, first, first - second, first + second], axis=-3)
    weakest = np.min(np.abs(np.linalg.eigvalsh(carriers)), axis=-1)
    pick = np.argmax(weakest, axis=-1)[..., None, None, None]
    return np.take_along_axis(carriers, pick, axis=-3)[..., 0, :, :], np.take_along_axis(others, pick, axis=-3)[..., 0, :, :]


def _parametrisation(conic: Array) -> tuple[Array, Array]:
    """M (..., 3, 3) that maps the circle (cos, sin, 1) onto the conic, and whether the conic has real points and is no line pair."""
    turned = np.where(np.linalg.det(conic) > 0.0, -1.0, 1.0)[..., None, None] * conic  # signs -, +, + unless it is definite
    eigenvalue, axes = np.linalg.eigh(turned)
    real = (eigenvalue[..., 1] > 0.0) & (np.min(np.abs(eigenvalue), axis=-1) > 1e-14)
    scaled = axes / np.sqrt(np.where(real[..., None], np.abs(eigenvalue), 1.0))[..., None, :]
    return scaled[..., [1, 2, 0]], real


def _away_from_infinity(frame: Array, other: Array) -> Array:
    """Map of (1, t, t^2) onto the circle, (..., 3, 3), with t = infinity where `other` is far, so that no root is lost there."""
    circle = np.stack([np.cos(_LOOKS), np.sin(_LOOKS), np.ones_like(_LOOKS)], axis=-1)
    looked = (frame[..., None, :, :] @ circle[:, :, None])[..., 0]
    distance = np.abs(np.sum(looked * (other[..., None, :, :] @ looked[..., None])[..., 0], axis=-1))
    angle = _LOOKS[np.argmax(distance, axis=-1)] + np.pi
    cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    rotation = np.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1.0], axis=-1).reshape(*angle.shape, 3, 3)
    return rotation @ _HALF_ANGLE


def _real_roots(quartic: Array) -> tuple[Array, Array]:
    """Roots (..., 4) of t^4 + ... and which of them are real; quartic (..., 5), its first coefficient one."""
    companion = np.zeros((*quartic.shape[:-1], 4, 4))
    companion[..., 0, :] = -quartic[..., 1:]
    companion[..., [1, 2, 3], [0, 1, 2]] = 1.0
    root = np.linalg.eigvals(companion)
    t = np.real(root)
    found = np.abs(np.imag(root)) <= 1e-6 * (1.0 + np.abs(t))  # a double root comes as a pair that is apart by sqrt(epsilon)
    residual = np.sum(quartic[..., None, :] * t[..., None] ** np.arange(4, -1, -1), axis=-1)
    size = np.sum(np.abs(quartic), axis=-1, keepdims=True) * np.maximum(1.0, t * t) ** 2
    return t, found & (np.abs(residual) <= 1e-11 * size)
