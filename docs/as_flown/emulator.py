"""What a table would print, as a function of the causes: Gaussian processes through the flights of the design."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from docs.as_flown.causes import ALL, CAUSES, NAMES, TABLES, acting, values_of
from docs.as_flown.flights import FILTERS, STATES
from docs.as_flown.gaussian_process import GaussianProcess, fit
from sim.scenario.files import load

Array = NDArray[np.floating]

LOGS = [(float(np.log(cause.low)), float(np.log(cause.high))) for cause in CAUSES]
LOADS = (  # products of powers of causes: what fills the wheels over their top speed
    ((1.0, "centre of mass off the axis"), (-1.0, "top speed of the wheels")),
    ((1.0, "torque of the air"), (0.5, "its correlation time"), (-1.0, "top speed of the wheels")),
    ((1.0, "yaw rate asked for, peak"), (-1.0, "top speed of the wheels")),
)
TRIALS = 10  # of the paper's experiments, over which its tables are means
KINDS = ((0, 1, 2), (4, 5, 6))  # places in STATES of q1 to q3 and of the rates, each emulated with one kernel a filter
COMPARED = KINDS[0] + KINDS[1]  # q4 is second order near the identity, docs/errata.md
LOG_CHI_SQUARE = 1.270362845  # minus the mean of the logarithm of a chi-square variable of one degree of freedom
ROUNDING = 5e-9 / np.sqrt(3.0)  # deviation of a printed value, of which the last digit is 1e-8
FAR = np.log(2.5)  # flights of which a sum is further than that from print, either way, are not what was flown: wheels without speed left


class Emulator(NamedTuple):
    """Logarithms of residuals' root mean squares in a table.

    Attributes:
      table: place among TABLES.
      values: processes of q1 to q3 and of the rates, filter by filter.
      totals: process of the four sums.
      scatter: of the logarithm of a trial's variance, a plane (filters, kinds, 1 + inputs), and of the sums' (filters, 1 + inputs).
      distance: process of the greatest distance of a sum from print, up to twice FAR, through all points; beyond FAR the others know
        nothing.
      used: which points of the design those go through, (points,).
    """

    table: int
    values: tuple[tuple[GaussianProcess, ...], ...]
    totals: GaussianProcess
    scatter: tuple[Array, Array]
    distance: GaussianProcess
    used: NDArray[np.bool_]


class Prediction(NamedTuple):
    """Of the logarithm of a mean over the paper's trials."""

    mean: Array  # (n, filters, 6), or of sums (n, filters)
    variance: Array  # of the emulator and of the trials' scatter


def printed() -> Array:
    """What the paper prints, (tables, filters, states)."""
    published = [load(f"nacs/as-flown/{table}").published for table in TABLES]
    return np.array([[[one.values[f][f"rmse_residual_{s}"] for s in STATES] for f in FILTERS] for one in published if one])


def flights(path: Path) -> tuple[Array, Array]:
    """Points (points, causes) and what was flown there, (tables, points, trials, filters, states), as `flights.keep` writes them."""
    with np.load(path) as kept:
        return kept["shares"].astype(float), kept["residuals"].astype(float)


def emulate(table: int, shares: Array, residuals: Array) -> Emulator:
    """Fit a table's emulator to flights (points, trials, filters, states) at points (points, causes)."""
    sums = residuals.sum(axis=-1)
    apart = np.abs(np.log(sums.mean(axis=1) / printed()[table].sum(axis=-1))).max(axis=-1)
    used = apart < FAR  # a flight that broke down is NaN, which is not less than anything
    distance = fit(inputs_of(table, shares), np.fmin(apart, 2.0 * FAR)[:, None])
    inputs, flown = inputs_of(table, shares[used]), residuals[used]
    logs, totals = np.log(flown.mean(axis=1)), np.log(sums[used].mean(axis=1))
    values = tuple(tuple(fit(inputs, logs[:, f, kind]) for kind in KINDS) for f, _ in enumerate(FILTERS))
    planes = np.stack([np.stack([_plane(inputs, flown[:, :, f][..., kind]) for kind in KINDS]) for f, _ in enumerate(FILTERS)])
    of_sums = np.stack([_plane(inputs, sums[used][:, :, f, None]) for f, _ in enumerate(FILTERS)])
    return Emulator(table, values, fit(inputs, totals), (planes, of_sums), distance, used)


def inputs_of(table: int, shares: Array) -> Array:
    """Causes that act in a table, and what asks the wheels for momentum over what they can hold; all in [-1, 1]."""
    logs = np.log(values_of(np.clip(shares, 0.0, 1.0)))
    known = {name: (logs[..., place], LOGS[place]) for place, name in enumerate(NAMES)}
    loads = [_between([(weight, *known[name]) for weight, name in load]) for load in LOADS]
    return np.concatenate([2.0 * shares[..., acting(table)] - 1.0, np.stack(loads, axis=-1)], axis=-1)


def predict(emulator: Emulator, shares: Array) -> Prediction:
    """Of q1 to q3 and the rates at points (n, causes)."""
    inputs = inputs_of(emulator.table, shares)
    each = [[process.at(inputs) for process in kinds] for kinds in emulator.values]
    mean, variance = (np.stack([np.concatenate([kind[i] for kind in kinds], axis=-1) for kinds in each], axis=1) for i in (0, 1))
    return _of_ten(mean, variance, np.repeat(_trial_variance(emulator.scatter[0], inputs), 3, axis=-1))


def _between(terms: Sequence[tuple[float, Array, tuple[float, float]]]) -> Array:
    """A weighted sum of logarithms, from its least and greatest value to [-1, 1]."""
    total = sum(weight * log for weight, log, _ in terms)
    ends = [sorted((weight * low, weight * high)) for weight, _, (low, high) in terms]
    low, high = (sum(end[i] for end in ends) for i in (0, 1))
    return 2.0 * (total - low) / (high - low) - 1.0


def near(emulator: Emulator, shares: Array) -> NDArray[np.bool_]:
    """Whether flights at points (n, causes) are like what was flown, so that an emulator can say what they would be."""
    return emulator.distance.at(inputs_of(emulator.table, shares))[0][:, 0] < FAR


def predict_sums(emulator: Emulator, shares: Array) -> Prediction:
    """Of the sums over all states at points (n, causes)."""
    inputs = inputs_of(emulator.table, shares)
    mean, variance = emulator.totals.at(inputs)
    return _of_ten(mean, variance, _trial_variance(emulator.scatter[1], inputs))


def left_out_errors(emulator: Emulator) -> tuple[Array, Array]:
    """Root mean square over the points of what is predicted by all others less what was flown: (filters, kinds), and of sums (filters,).

    Of logarithms; it includes the scatter of the two trials at a point.
    """
    each = [[np.sqrt(np.mean(process.left_out()[0] ** 2)) for process in kinds] for kinds in emulator.values]
    return np.array(each), np.sqrt(np.mean(emulator.totals.left_out()[0] ** 2, axis=0))


def _plane(inputs: Array, pairs: Array) -> Array:
    """Plane of the logarithm of a trial's variance (1 + inputs,), from pairs (points, 2, outputs) of what was flown (Harvey 1976)."""
    squares = 0.5 * (np.log(pairs[:, 0]) - np.log(pairs[:, 1])) ** 2
    logs = np.log(np.maximum(squares, 1e-10)).mean(axis=-1) + LOG_CHI_SQUARE
    slopes = np.concatenate([np.ones((len(inputs), 1)), inputs], axis=-1)
    ridge = np.eye(slopes.shape[1])
    ridge[0, 0] = 0.0
    return np.linalg.solve(slopes.T @ slopes + ridge, slopes.T @ logs)


def _trial_variance(planes: Array, inputs: Array) -> Array:
    """Variance of the logarithm of one trial at inputs (n, inputs), (n, ...)."""
    return np.exp(np.moveaxis(planes[..., 0, None] + planes[..., 1:] @ inputs.T, -1, 0))


def _of_ten(mean: Array, variance: Array, trial: Array) -> Prediction:
    """From the mean of two trials, which was emulated, to that of ten: of something lognormal its logarithm is higher, and it scatters."""
    return Prediction(mean + 0.5 * trial * (1.0 / 2.0 - 1.0 / TRIALS), variance + trial / TRIALS)


def without(table: int) -> tuple[int, ...]:
    """All tables but one."""
    return tuple(one for one in ALL if one != table)
