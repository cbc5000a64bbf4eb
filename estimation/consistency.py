"""Whether a filter's covariance tells the truth: chi-square tests of NEES and NIS, and whiteness of innovations.

Bar-Shalom, Li & Kirubarajan (2001, sec. 5.4). Pure functions on arrays, NaN being no number: it is left out of every sum, and its
degrees of freedom with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2, norm

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]


class Bounds(NamedTuple):
    """Two-sided limits of a statistic."""

    low: Array
    high: Array


class AverageTest(NamedTuple):
    """An averaged NEES or NIS set against its chi-square bounds."""

    mean: Array  # (...,) over the axis of the test; NaN where there is no number
    bounds: Bounds  # (...,) each
    inside: Flags  # (...,)
    fraction_inside: float  # of the averages that there are


class Whiteness(NamedTuple):
    """Autocorrelation of innovations set against what white noise would have."""

    correlation: Array  # (..., lags, m) of lags 1, 2, ...
    bound: Array  # (..., lags, m) two-sided: |correlation| stays below it with the probability of the test
    fraction_inside: float  # of the correlations that there are


def normalized_squared(error: Array, covariance: Array) -> Array:
    """The square e' P^-1 e: NEES of an estimation error, NIS of an innovation; NaN where P is singular or has no number.

    Args:
      error: (..., n); broadcasts against the covariance.
      covariance: P, (..., n, n).

    Returns:
      (...,).
    """
    try:
        solved = np.linalg.solve(covariance, error[..., None])
    except np.linalg.LinAlgError:  # one singular matrix would spoil the whole stack
        with np.errstate(divide="ignore"):  # the logarithm of zero inside
            singular = (np.linalg.det(covariance) == 0.0)[..., None, None]
        solved = np.linalg.solve(np.where(singular, np.nan, covariance), error[..., None])
    return np.einsum("...i,...i->...", error, solved[..., 0])


def average_bounds(dof: ArrayLike, count: ArrayLike = 1, probability: float = 0.95) -> Bounds:
    """Interval that holds the mean of `count` chi-square variables, each with `dof`, with `probability`.

    `dof` is the dimension of the error state for NEES, the number of components of the reading that were accepted for NIS. Where it
    varies it is the mean over the variables: only their sum matters.
    """
    tail = 0.5 * (1.0 - probability)
    total = np.asarray(dof) * np.asarray(count)
    return Bounds(chi2.ppf(tail, total) / count, chi2.ppf(1.0 - tail, total) / count)


def average_test(statistic: Array, dof: ArrayLike, axis: int | tuple[int, ...] = 0, probability: float = 0.95) -> AverageTest:
    """Average NEES or NIS over independent trials, or NIS over the time of one, against its bounds.

    Args:
      statistic: NEES or NIS, any shape.
      dof: degrees of freedom of each value, broadcast to it; a value without any is left out.
      axis: of the trials; of the ticks for one trial's NIS, whose values are independent if the filter is right; or of both.
      probability: that a consistent filter's average is inside.
    """
    freedom = np.broadcast_to(np.asarray(dof, dtype=float), statistic.shape)
    use = np.isfinite(statistic) & (freedom > 0.0)
    count = np.sum(use, axis=axis)
    some = np.where(count, count, 1)
    mean = np.where(count, np.sum(np.where(use, statistic, 0.0), axis=axis) / some, np.nan)
    bounds = average_bounds(np.where(count, np.sum(np.where(use, freedom, 0.0), axis=axis) / some, np.nan), some, probability)
    inside = (bounds.low <= mean) & (mean <= bounds.high)
    return AverageTest(mean, bounds, inside, _share(inside, count > 0))


def whiteness(innovation: Array, lags: int, probability: float = 0.95) -> Whiteness:
    """Time-average autocorrelation of every component of an innovation.

    Lag j of K ticks is normal with variance 1 / K for white innovations. Components are judged apart from each other, so that their
    units do not matter.

    Args:
      innovation: (..., ticks, m), NaN where a component was missing; its mean is taken to be zero.
      lags: greatest lag, ticks.
      probability: that a white sequence's correlation is inside.
    """
    use = np.isfinite(innovation)
    value = np.where(use, innovation, 0.0)
    correlation, pairs = [], []
    for lag in range(1, lags + 1):
        early, late = value[..., :-lag, :], value[..., lag:, :]
        both = use[..., :-lag, :] & use[..., lag:, :]
        power = np.sum(both * early**2, axis=-2) * np.sum(both * late**2, axis=-2)
        correlation.append(np.sum(early * late, axis=-2) / np.sqrt(np.where(power > 0.0, power, np.nan)))
        pairs.append(np.sum(both, axis=-2))
    count = np.stack(pairs, axis=-2)
    found = np.stack(correlation, axis=-2)
    bound = norm.ppf(0.5 * (1.0 + probability)) / np.sqrt(np.where(count, count, np.nan))
    return Whiteness(found, bound, _share(np.abs(found) <= bound, np.isfinite(found)))


def _share(inside: Flags, there: Flags) -> float:
    """Share of what is inside among what is there; NaN if nothing is."""
    return float(np.sum(inside & there) / np.sum(there)) if np.any(there) else float("nan")
