"""Which agent of a formation reads wrongly, told by what its neighbours see of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.floating]


def agents_statistic(residual: Array, about: NDArray[np.int64], own: Array, others: Array) -> Array:
    """How unlikely each agent's error is by its neighbours' residuals, chi-square of three degrees of freedom while nothing fails.

    Each neighbour i of agent k has b_ik, the turn from what it sees of k to what k says. All have k's own error, and each its own beside:
    the best estimate of k's error weighs them by one over their variances d_i, and T_k = |sum b_ik / d_i / sum 1 / d_i|^2 /
    (s_k^2 + 1 / sum 1 / d_i), the generalised likelihood ratio of an unknown error of k alone (Willsky & Jones 1976). A neighbour's own
    error turns up in one residual about k and in all about the neighbour, so that the agent at fault has the greatest.

    Args:
      residual: b of each who sees another, (..., ways, 3) rad, NaN where one of the two reads nothing.
      about: whom, counted from zero, (ways,).
      own: variance of each agent's own reading, s^2, (..., agents) rad2.
      others: variance of what is added to it in each residual, d, (..., ways) rad2.

    Returns:
      T, (..., agents); zero of an agent that nobody sees.
    """
    seen = ~np.any(np.isnan(residual), axis=-1)
    whose: NDArray[np.bool_] = about[:, None] == np.arange(own.shape[-1])
    weight = np.where(seen, 1.0 / others, 0.0)
    total = weight @ whose
    known = np.where(total > 0.0, total, 1.0)
    mean = np.einsum("...wi,wa->...ai", weight[..., None] * np.nan_to_num(residual, nan=0.0), whose.astype(float)) / known[..., None]
    return np.where(total > 0.0, np.sum(mean**2, axis=-1) / (own + 1.0 / known), 0.0)


def named(statistic: Array, window: int, tail: float) -> NDArray[np.int64]:
    """Whom the sum over the last readings names: the agent of the greatest if it is less likely than `tail`, or else nobody, -1.

    Args:
      statistic: T, (ticks, ..., agents).
      window: readings that are summed, fewer at first.
      tail: probability of a sum of chi-square numbers, of one agent.

    Returns:
      Agent counted from zero, (ticks, ...).
    """
    count = np.minimum(np.arange(1, len(statistic) + 1), window).reshape(-1, *(1,) * (statistic.ndim - 1))
    total = np.cumsum(statistic, axis=0)
    total[window:] -= total[:-window].copy()
    surprising = total > chi2.isf(tail, 3.0 * count)
    return np.where(surprising.any(axis=-1), np.argmax(total, axis=-1), -1)
