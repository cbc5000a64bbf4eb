"""Sigma points: a Gaussian as a few displaced states, and the Gaussian that such states stand for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import LostDefiniteness, symmetrize

Array = NDArray[np.floating]

FLOOR = 1e-12  # least eigenvalue of a repaired covariance, its variances counted as one
SUSPECT = 1e-9  # relative eigenvalue above which there is a Cholesky factor for certain


@dataclass(frozen=True)
class SigmaPoints:
    """The scaled symmetric set of 2 e + 1 points in e error coordinates (Julier & Uhlmann 2004; van der Merwe 2004, ch. 3.2).

    All moments are taken about the central point, the first: its weight, which is negative for a small `alpha`, is then not needed, and
    the covariance of the others plus (beta - alpha^2) times the mean's square is the textbook's weighted sum exactly. It is positive
    semidefinite by construction, whatever the model does, since beta + alpha^2 kappa / e >= 0.

    Attributes:
      alpha: spread; the points are alpha sqrt(e + kappa) deviations out.
      beta: what is known of the fourth moment; 2 for a Gaussian.
      kappa: secondary spread.
    """

    alpha: float = 0.1
    beta: float = 2.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        if not (self.alpha > 0 and self.beta >= 0 and self.kappa >= 0):
            settings = f"alpha = {self.alpha:g}, beta = {self.beta:g}, kappa = {self.kappa:g}"
            raise ValueError(f"{settings}: need alpha > 0, beta >= 0, kappa >= 0, or covariances can turn negative")

    def offsets(self, root: Array) -> Array:
        """Error coordinates of the points of a covariance L L', the first being zero; L (..., e, e) to (..., 2 e + 1, e)."""
        size = root.shape[-1]
        out = np.zeros((*root.shape[:-2], 2 * size + 1, size))
        np.multiply(root.swapaxes(-1, -2), self.alpha * np.sqrt(size + self.kappa), out=out[..., 1 : size + 1, :])
        np.negative(out[..., 1 : size + 1, :], out=out[..., size + 1 :, :])
        return out

    def moments(self, errors: Array) -> tuple[Array, Array]:
        """Mean (..., d) and covariance (..., d, d) of what 2 e points have become, as seen from the central one: `errors` (..., 2 e, d)."""
        size = errors.shape[-2] // 2
        weight = 0.5 / (self.alpha**2 * (size + self.kappa))
        mean = (np.full((1, 2 * size), weight) @ errors)[..., 0, :]
        covariance = weight * (errors.swapaxes(-1, -2) @ errors)
        return mean, symmetrize(covariance + (self.beta - self.alpha**2) * mean[..., :, None] * mean[..., None, :])


def factor(covariance: Array) -> tuple[Array, Array]:
    """Lower Cholesky factors of (..., e, e), and 1 where a covariance had to be repaired to have one, else 0, (...,).

    Raises:
      LostDefiniteness: a covariance holds a NaN or infinity, so nothing can be repaired.
    """
    try:
        return np.linalg.cholesky(covariance), np.zeros(covariance.shape[:-2])
    except np.linalg.LinAlgError:
        pass
    finite = np.isfinite(covariance).all(axis=(-2, -1))
    if not finite.all():
        raise LostDefiniteness(tuple(int(i) for i in np.argwhere(~finite)[0]), "covariance")
    eigenvalues = np.linalg.eigvalsh(covariance)
    lost = np.zeros(covariance.shape[:-2], dtype=bool)
    for where in np.argwhere(eigenvalues[..., 0] <= SUSPECT * eigenvalues[..., -1]):  # the few that may have none, one by one
        lost[tuple(where)] = not _has_factor(covariance[tuple(where)])
    mended = covariance.copy()
    mended[lost] = repair(covariance[lost])
    return np.linalg.cholesky(mended), lost.astype(float)


def repair(covariance: Array) -> Array:
    """The nearest covariance whose correlations have no eigenvalue below FLOOR; (..., e, e).

    Eigenvalues are those of correlations, so that rad and wheel speeds of hundreds of rad/s are repaired alike.
    """
    variance = np.abs(np.diagonal(covariance, axis1=-2, axis2=-1))
    deviation = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    scale = deviation[..., :, None] * deviation[..., None, :]
    values, vectors = np.linalg.eigh(symmetrize(covariance / scale))
    floored = np.maximum(values, FLOOR * np.maximum(values[..., -1:], 1.0))[..., None, :]
    return symmetrize((vectors * floored) @ vectors.swapaxes(-1, -2)) * scale


def _has_factor(matrix: Array) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
