"""What Gaussian filters have in common: the belief, the innovation, the gain and the covariance update."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.state_space import StateSpace
from models.dynamics.state_layout import ATTITUDE

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

LOG_TWO_PI = float(np.log(2.0 * np.pi))


class LostDefiniteness(ArithmeticError):
    """A covariance, most often an innovation's, is no longer positive definite; `where` is the index of the first such matrix."""

    def __init__(self, where: tuple[int, ...], what: str = "innovation covariance") -> None:
        super().__init__(f"{what} {where} is not positive definite")
        self.where, self.what = where, what


class Detection(NamedTuple):
    """What a fault detector keeps from reading to reading."""

    statistic: Array  # (...,) smoothed normalised innovation squared
    declared: Flags  # (...,) a fault is declared
    history: tuple[Array, ...]  # of each detector, (..., readings)


class Belief(NamedTuple):
    """What a Gaussian filter believes after a reading."""

    mean: Array  # (..., n)
    covariance: Array  # (..., e, e) of the state space's error coordinates
    innovation: Array  # (..., d) reading minus prediction; zero where the reading is missing
    nis: Array  # (...,) normalised innovation squared
    log_likelihood: Array  # (...,) of the reading given the ones before
    dof: Array  # (...,) degrees of freedom of the NIS: components read, a unit quaternion's four counting three
    detection: Detection
    lost: Array | None = None  # (...,) covariances repaired so far because they had no Cholesky factor; None: the filter needs none
    modes: Modes | None = None  # of a filter with several models
    memory: Any = None  # what else a filter keeps from reading to reading


class Modes(NamedTuple):
    """What a filter with several models believes of each; the modes are one more batch axis, behind those of the trials."""

    probabilities: Array  # (..., modes)
    members: Belief  # means (..., modes, n), covariances (..., modes, e, e) and so on


class Innovation(NamedTuple):
    """A reading set against its prediction."""

    residual: Array  # (..., d)
    gain: Array  # (..., e, d) Kalman's
    nis: Array
    log_likelihood: Array
    dof: Array  # (...,) components that were not missing, a quaternion's four counting four: the dimension of the density
    sensitivity: Array | None = None  # H, (..., d, e), rows of zeros where the reading is missing; None: the unit matrix


def first_belief(space: StateSpace, measurement: Array, noise: Array, prior: Array, prior_variance: Array) -> Belief:
    """Where filters of a fully measured state begin: the first reading with its noise, and the prior for what it misses.

    Args:
      space: error coordinates of the state.
      measurement: (..., n), NaN where missing.
      noise: R in error coordinates, (..., e, e).
      prior: state (..., n) for what is missing.
      prior_variance: variance of that, in error coordinates, (..., e).
    """
    lead = np.broadcast_shapes(measurement.shape[:-1], noise.shape[:-2])
    seen = np.broadcast_to(measurement, (*lead, measurement.shape[-1]))
    if space.attitude != "components":  # a part of a quaternion is no attitude, and beside a part of the prior's it would be another one
        torn = np.isnan(seen[..., ATTITUDE]).any(axis=-1, keepdims=True)
        seen = np.concatenate([np.where(torn, np.nan, seen[..., ATTITUDE]), seen[..., 4:]], axis=-1)
    mean = np.where(np.isnan(seen), prior, seen)
    zero = space.difference(seen, mean)  # NaN where missing, in error coordinates
    missing = np.isnan(zero)
    known = ~missing[..., :, None] & ~missing[..., None, :]
    covariance = np.where(known, noise, 0.0) + (missing * prior_variance)[..., None] * np.eye(zero.shape[-1])
    nothing = np.zeros(lead)
    dof = np.sum(~missing, axis=-1, dtype=float)
    if space.attitude == "quaternion":  # a unit quaternion's four components have three degrees of freedom
        dof = dof - ~missing[..., 0]
    unknown = np.full(lead, np.nan)  # nothing was predicted, so nothing can be surprising
    return Belief(mean, covariance, np.zeros(zero.shape), unknown, nothing, dof, no_detection(nothing))


def corrected(
    mean: Array, covariance: Array, innovation: Innovation, dof: Array, before: Belief, lost: Array, memory: Any = None
) -> Belief:
    """What an unscented filter believes after a reading.

    Args:
      mean: (..., n).
      covariance: (..., e, e).
      innovation: of the reading.
      dof: degrees of freedom of its NIS, (...,).
      before: the belief before.
      lost: 1 where a covariance had to be repaired since then, (...,).
      memory: what else the filter keeps.
    """
    return Belief(
        mean=mean,
        covariance=covariance,
        innovation=innovation.residual,
        nis=innovation.nis,
        log_likelihood=innovation.log_likelihood,
        dof=dof,
        detection=no_detection(innovation.nis),
        lost=lost if before.lost is None else before.lost + lost,
        memory=memory,
    )


def no_detection(statistic: Array) -> Detection:
    """What a filter that declares no faults keeps: the statistic (...,) as it is."""
    return Detection(statistic, np.zeros(statistic.shape, dtype=bool), (np.zeros((*statistic.shape, 0)),))


def symmetrize(matrix: Array) -> Array:
    """(M + M') / 2; (..., n, n)."""
    return 0.5 * (matrix + matrix.swapaxes(-1, -2))


def cholesky(matrix: Array) -> Array:
    """Lower Cholesky factors of (..., n, n); raises LostDefiniteness naming the first matrix that has none, or has a NaN."""
    try:
        root = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise LostDefiniteness(_first_lost(matrix)) from None
    if not np.isfinite(np.diagonal(root, axis1=-2, axis2=-1)).all():
        raise LostDefiniteness(_first_lost(matrix))
    return root


def weighted(covariance: Array, right: Array) -> Array:
    """Inverse of covariances (..., n, n) times `right` (..., n, m); raises LostDefiniteness naming the first that has none."""
    try:
        return np.linalg.solve(covariance, right)
    except np.linalg.LinAlgError:
        raise LostDefiniteness(_first_lost(covariance)) from None


def _first_lost(matrix: Array) -> tuple[int, ...]:
    """Index of the first matrix without a Cholesky factor; one by one, since it ends a run."""
    for index in np.ndindex(matrix.shape[:-2]):
        try:
            if np.isfinite(np.linalg.cholesky(matrix[index])).all():
                continue
        except np.linalg.LinAlgError:
            pass
        return index
    return ()


def innovate(covariance: Array, residual: Array, noise: Array, sensitivity: Array | None = None) -> Innovation:
    """Gain and likelihood of a reading, by Cholesky factors of S = H P H' + R.

    Components of the residual that are NaN are missing: they get no gain and count nothing.

    Args:
      covariance: P before the reading, (..., e, e).
      residual: reading minus prediction, (..., d).
      noise: R, (..., d, d).
      sensitivity: H, (..., d, e); None: the unit matrix, the reading being of the whole error state.

    Raises:
      LostDefiniteness: S is not positive definite.
    """
    missing = np.isnan(residual)
    predicted = covariance
    if sensitivity is not None:
        known = np.where(missing, 0.0, 1.0)
        residual = np.where(missing, 0.0, residual)
        sensitivity = sensitivity * known[..., None]
        predicted = covariance @ sensitivity.swapaxes(-1, -2)  # P H'
        spread = sensitivity @ predicted + noise * known[..., None, :] * known[..., :, None]
        spread = spread + missing[..., None] * np.eye(residual.shape[-1])  # unit variance, zero residual: no effect
    elif missing.any():
        residual = np.where(missing, 0.0, residual)
        known = np.where(missing, 0.0, 1.0)
        predicted = covariance * known[..., None, :]  # P H'
        spread = predicted * known[..., :, None] + noise * known[..., None, :] * known[..., :, None]
        spread = spread + missing[..., None] * np.eye(residual.shape[-1])  # unit variance, zero residual: no effect
    else:
        spread = covariance + noise
    root = cholesky(spread)
    right = np.concatenate([predicted.swapaxes(-1, -2), residual[..., None]], axis=-1)
    white = np.linalg.solve(root, right)
    whitened, cross = white[..., -1], white[..., :-1]
    nis = np.einsum("...i,...i->...", whitened, whitened)
    dof = np.sum(~missing, axis=-1, dtype=float)
    log_det = 2.0 * np.sum(np.log(np.diagonal(root, axis1=-2, axis2=-1)), axis=-1)
    # in C order, so that the products to come give the same bits whether or not a gain law has copied it
    gain = np.ascontiguousarray(np.linalg.solve(root.swapaxes(-1, -2), cross).swapaxes(-1, -2))
    return Innovation(residual, gain, nis, -0.5 * (nis + log_det + dof * LOG_TWO_PI), dof, sensitivity)


def joseph(covariance: Array, gain: Array, noise: Array, sensitivity: Array | None = None) -> Array:
    """Covariance after a reading with any gain, (I - K H) P (I - K H)' + K R K' (McCafferty-Leroux et al. 2024, eq. 16; Joseph form).

    Args:
      covariance: P before the reading, (..., e, e).
      gain: K, (..., e, d), with columns of zeros where the reading is missing.
      noise: R, (..., d, d).
      sensitivity: H, (..., d, e); None: the unit matrix.
    """
    keep = np.eye(gain.shape[-2]) - (gain if sensitivity is None else gain @ sensitivity)
    return symmetrize(keep @ covariance @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2))
