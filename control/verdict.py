"""The verdict of a whole record on candidate controllers, none of which need have been in the loop: when each is falsified, and why."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.falsification import Specification

Array = NDArray[np.floating]

NEVER = -1


class Verdict(NamedTuple):
    """What a record says of each candidate; the last axis is the error's and the effort's test."""

    ratio: Array  # (..., 2) greatest ||w1 * (r~ - y)|| / ||r~|| and ||w2 * u|| / ||r~||; NaN where there was never enough data
    worst: NDArray[np.int64]  # (..., 2) tick of it, NEVER without data
    first: NDArray[np.int64]  # (..., 2) first tick with a ratio of one or more, NEVER if there is none

    @property
    def falsified(self) -> NDArray[np.bool_]:
        """Whether either test was failed, (...)."""
        return np.asarray(np.any(self.first != NEVER, axis=-1))


class _Sums(NamedTuple):
    """Running sums of squares and states of the weights, by candidate and trial."""

    seen: Array  # (trials,) of y
    asked: Array  # (candidates, trials) of r~
    weighted: Array  # (candidates, trials, 2)
    lag: Array  # (candidates, trials, 2)


def judge(specification: Specification, errors: Iterable[Array], effort: Array, position: Array, gate: float) -> Verdict:
    """Hold eq. 10 of Tsao, Brozenec & Safonov against a record at every tick, in norms over all ticks so far.

    Args:
      specification: what is asked of a controller.
      errors: fictitious error r~ - y of each candidate, tick by tick, (candidates, trials) rad.
      effort: u / (J^ lambda^2), (ticks, trials) rad.
      position: y, counted from the attitude of rest, (ticks, trials) rad.
      gate: least integral of y^2 with which a record tells anything, rad^2 times lambda s.

    Returns:
      Of (candidates, trials, 2).
    """
    b_0, b_1, a_1 = specification.weight
    heavier = np.array([1.0, specification.error_bound / float(specification.effort_bound)])  # both weights have one shape
    sums: _Sums | None = None
    ratio = np.zeros(0)
    worst = first = np.zeros(0, dtype=np.int64)
    for tick, (error, u, y) in enumerate(zip(errors, effort, position, strict=True)):
        if sums is None:
            pair = (*error.shape, 2)
            sums = _Sums(np.zeros(error.shape[1:]), np.zeros(error.shape), np.zeros(pair), np.zeros(pair))
            ratio, worst, first = np.full(pair, -1.0), np.full(pair, NEVER), np.full(pair, NEVER)
        signals = np.stack(np.broadcast_arrays(error, u), axis=-1)
        through = b_0 * signals + sums.lag
        sums = _Sums(
            seen=sums.seen + specification.tick * y**2,
            asked=sums.asked + specification.tick * (error + y) ** 2,
            weighted=sums.weighted + specification.tick * (heavier * through) ** 2,
            lag=b_1 * signals - a_1 * through,
        )
        tells = (sums.seen > gate)[:, None] & (sums.weighted > 0.0)
        with np.errstate(divide="ignore"):  # a law that would have been asked for nothing, and yet moved
            now = np.where(tells, np.sqrt(sums.weighted / sums.asked[..., None]), -1.0)
        first = np.where((first == NEVER) & (now >= 1.0), tick, first)
        worst, ratio = np.where(now > ratio, tick, worst), np.maximum(ratio, now)
    return Verdict(np.where(worst == NEVER, np.nan, ratio), worst, first)
