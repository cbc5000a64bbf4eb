"""What printed tables say of the causes: posterior by an emulator of each table, and what it predicts of a table that was left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, qmc

from docs.as_flown.causes import CAUSES
from docs.as_flown.elliptical_slice import effective, sample
from docs.as_flown.emulator import COMPARED, ROUNDING, Emulator, Prediction, near, predict, predict_sums

Array = NDArray[np.floating]

CHAINS = 96
STEPS = 100  # of which the first quarter is left out
SEED = 715
COUNT = len(CAUSES)
WRONG = 0.1  # scale of the half-normal density, beforehand, of what the plant cannot do: relative, common to a group and of each value


class Posterior(NamedTuple):
    """Of the causes, given some tables.

    Attributes:
      tables: places of those in TABLES.
      shares: samples in the unit cube, (samples, causes).
      wrong: what the plant cannot do: standard deviation of the logarithm that three values of a filter (q1 to q3, or the rates) have in
        common, and of each value, (samples, 2).
      densities: logarithms, but for a constant, over the places in the ranges, (samples,).
      effective: how many independent samples they are worth, of the cause of which they are worth least.
    """

    tables: tuple[int, ...]
    shares: Array
    wrong: Array
    densities: Array
    effective: float

    @property
    def mode(self) -> Array:
        """Sample of the greatest density, (causes,)."""
        return self.shares[int(np.argmax(self.densities))]

    @property
    def mean(self) -> Array:
        """Of the shares, (causes,)."""
        return self.shares.mean(axis=0)


def log_likelihood(observed: Array, prediction: Prediction, wrong: Array) -> Array:
    """Of a printed table, (n,).

    Values are lognormal about what is predicted; their variances are those of emulator and trials, of the printed digits and of what the
    plant cannot do. Three values of a filter have a part of that in common.

    Args:
      observed: printed, (filters, 6).
      prediction: (n, filters, 6).
      wrong: (n, 2), as in `Posterior`.
    """
    variance = prediction.variance + (ROUNDING / observed) ** 2 + wrong[:, 1, None, None] ** 2
    residual = np.log(observed) - prediction.mean
    groups = (*variance.shape[:2], 2, 3)
    precision, residual = 1.0 / variance.reshape(groups), residual.reshape(groups)
    shared = wrong[:, 0, None, None] ** 2
    stiff = 1.0 + shared * precision.sum(axis=-1)  # Sherman and Morrison, and the determinant's lemma
    square = np.sum(precision * residual**2, axis=-1) - shared * np.sum(precision * residual, axis=-1) ** 2 / stiff
    return np.sum(-0.5 * square - 0.5 * np.log(stiff) + 0.5 * np.sum(np.log(precision), axis=-1), axis=(1, 2))


def infer(emulators: Mapping[int, Emulator], observed: Array, tables: Sequence[int], steps: int = STEPS) -> Posterior:
    """Posterior of the causes given printed tables; a share is uniform beforehand.

    Args:
      emulators: by table.
      observed: what is printed, (tables, filters, states).
      tables: places of those that are taken to be known.
      steps: of the chains.
    """

    def likelihood(normal: Array) -> Array:
        """At places whose coordinates are standard normal beforehand, (n, causes + 2)."""
        shares, wrong = _unpacked(normal)
        possible = np.all([near(emulators[table], shares) for table in tables], axis=0)
        out = np.full(len(normal), -np.inf)
        if possible.any():
            out[possible] = sum(
                log_likelihood(observed[table][:, COMPARED], predict(emulators[table], shares[possible]), wrong[possible])
                for table in tables
            )
        return out

    first = norm.ppf(qmc.Sobol(COUNT + 2, rng=SEED).random_base2(11))
    start = first[np.argsort(likelihood(first))[-CHAINS:]]
    path, heights = sample(likelihood, start, steps, np.random.default_rng(SEED))
    kept, densities = path[steps // 4 :], heights[steps // 4 :]
    shares, wrong = _unpacked(kept.reshape(-1, COUNT + 2))
    prior = -0.5 * np.sum((wrong / WRONG) ** 2, axis=-1)
    return Posterior(tuple(tables), shares, wrong, densities.reshape(-1) + prior, float(effective(kept).min()))


def _unpacked(normal: Array) -> tuple[Array, Array]:
    """Places in the ranges, and what the plant cannot do, from coordinates that are standard normal beforehand."""
    return norm.cdf(normal[:, :COUNT]), WRONG * np.abs(normal[:, COUNT:])


def predicted_sums(emulator: Emulator, posterior: Posterior, many: int = 2000) -> Array:
    """Samples of a table's sums as ten trials would have them, with what the plant cannot do, (many, filters)."""
    rng = np.random.default_rng(SEED)
    chosen = rng.choice(len(posterior.shares), many)
    prediction = predict_sums(emulator, posterior.shares[chosen])
    wrong = np.sqrt(posterior.wrong[chosen, :1] ** 2 + posterior.wrong[chosen, 1:] ** 2 / 3.0)
    return np.exp(prediction.mean + np.sqrt(prediction.variance + wrong**2) * rng.standard_normal(prediction.mean.shape))


def predicted_values(emulator: Emulator, posterior: Posterior, many: int = 2000) -> Array:
    """Samples of q1 to q3 and the rates of a table as ten trials would have them, (many, filters, 6)."""
    rng = np.random.default_rng(SEED)
    chosen = rng.choice(len(posterior.shares), many)
    prediction = predict(emulator, posterior.shares[chosen])
    groups = np.repeat(rng.standard_normal((*prediction.mean.shape[:2], 2)), 3, axis=-1)
    own = np.sqrt(prediction.variance + posterior.wrong[chosen, 1, None, None] ** 2)
    common = posterior.wrong[chosen, 0, None, None] * groups
    return np.exp(prediction.mean + common + own * rng.standard_normal(prediction.mean.shape))
