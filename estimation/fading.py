"""Fading memory: how much a filter widens what it predicts, so that old readings count less than new ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from estimation.consistency import normalized_squared
from estimation.observation import Observation

Array = NDArray[np.floating]


class Surprise(NamedTuple):
    """A reading against its prediction, before any fading; of uncorrelated errors only the variances are looked at."""

    residual: Array  # (..., d) reading minus prediction, NaN where missing
    predicted: Array  # (..., d, d) H M H', where M is the covariance that the model makes of the one before, without process noise
    process_noise: Array  # (..., d, d) H Q H'
    noise: Array  # (..., d, d) R

    @classmethod
    def of(cls, observation: Observation, predicted: Array, process_noise: Array) -> Surprise:
        """Of M and Q in the state's error coordinates, (..., e, e)."""
        residual, noise, sensitivity = observation
        if sensitivity is None:
            return cls(residual, predicted, process_noise, noise)
        swapped = sensitivity.swapaxes(-1, -2)
        return cls(residual, sensitivity @ predicted @ swapped, sensitivity @ process_noise @ swapped, noise)


class FadingLaw(Protocol):
    """A law of the fading factor lambda in P- = lambda M + Q: frozen settings, its memory handed in and out."""

    def factor(self, surprise: Surprise, variance: Array) -> tuple[Array, Array]:
        """Factor (...,), and the residuals' variance so far (..., d), NaN in a component of which there were none."""
        ...


@dataclass(frozen=True)
class ConstantFading:
    """The same factor at every step, which forgets readings older than 1 / (lambda - 1) steps; one: nothing fades.

    Rososhansky (2017, sec. 3.3) prints 1e3, with which nothing but the last reading counts.

    Attributes:
      value: lambda, of the covariance.
    """

    value: float = 1.0

    def factor(self, surprise: Surprise, variance: Array) -> tuple[Array, Array]:
        """The value; nothing is remembered."""
        return np.full(surprise.predicted.shape[:-2], self.value), variance


@dataclass(frozen=True)
class TraceFading:
    """One plus a multiple of the squared length of the innovation, as Rososhansky (2017, eq. 2.14) prints it, of this reading alone.

    lambda = 1 + c tr(nu nu') = 1 + c nu' nu, over what is read. Whether the thesis' 1e3 is c or its inverse cannot be read any more. nu
    is in the reading's own units, so that c belongs to one sensor: with a good model lambda tends to 1 + c tr(S), S being the
    innovations' covariance.

    Attributes:
      coefficient: c, one over the square of the reading's unit.
    """

    coefficient: float = 1e3

    def factor(self, surprise: Surprise, variance: Array) -> tuple[Array, Array]:
        """Factor of this step; nothing is remembered."""
        residual = np.nan_to_num(surprise.residual, nan=0.0)
        lead = np.broadcast_shapes(residual.shape[:-1], surprise.predicted.shape[:-2])
        return np.broadcast_to(1.0 + self.coefficient * np.sum(residual**2, axis=-1), lead), variance


@dataclass(frozen=True)
class StrongTracking:
    """A factor that makes residuals as large as they are expected to be (Zhou & Frank 1996, with one factor for all components).

    lambda = clip(tr W (V - H Q H' - R) / tr W H M H', 1, cap), where V is the residuals' covariance, V_1 = nu nu',
    V_k = (rho V_k-1 + nu nu') / (1 + rho), and W = diag(1 / R) on what is read. It does what the text of Rososhansky (2017, eq. 2.14) asks
    of the formula there, `TraceFading`, which does not see how large innovations are expected to be.

    V is worth about two readings (at rho = 0.95 a step keeps 0.49 of it), so that it scatters by its own size, and what is above one is
    kept: with an honest model lambda is one in the median, but above it in 36 to 43 % of the steps and 1.5 to 2.3 on average, which costs
    2 % (Q = R) to a factor of 4 (Q = 1e-4 R) of the Kalman filter's error. `GatedTracking` is one while nothing happens.

    Attributes:
      forgetting: rho.
      cap: greatest factor.
    """

    forgetting: float = 0.95
    cap: float = 1e3

    def factor(self, surprise: Surprise, variance: Array) -> tuple[Array, Array]:
        """Factor of this step and the variance with its residual in it."""
        seen = ~np.isnan(surprise.residual)
        square = np.where(seen, surprise.residual, 0.0) ** 2
        mixed = (self.forgetting * variance + square) / (1.0 + self.forgetting)
        variance = np.where(seen, np.where(np.isnan(variance), square, mixed), variance)
        predicted, process, noise = (np.diagonal(part, axis1=-2, axis2=-1) for part in surprise[1:])
        weight = np.where(seen, 1.0 / noise, 0.0)
        surplus = np.sum(weight * (np.where(seen, variance, 0.0) - process - noise), axis=-1)
        expected = np.sum(weight * predicted, axis=-1)
        return np.clip(surplus / np.where(expected > 0.0, expected, np.inf), 1.0, self.cap), variance


@dataclass(frozen=True)
class GatedTracking:
    """Strong tracking where residuals are larger than chance makes them, and a factor of one where they are not.

    r, the mean of NIS over its degrees of freedom d with a memory that fades by rho a step, is one with an honest model and has about
    the distribution of chi-square over its degrees of freedom, d (1 + rho) / (1 - rho), those of the same variance. While it is below
    the quantile of `tail`, lambda = 1; above it lambda makes residuals r times as large as were expected of the model:
    lambda = clip(tr W (r S - H Q H' - R) / tr W H M H', 1, cap) with S = H M H' + H Q H' + R and W = diag(1 / R).

    Attributes:
      forgetting: rho, of NIS; (1 + rho) / (1 - rho) readings count.
      tail: probability with which the statistic of an honest model is taken for a failing one; small, for once costs the filter all that
        it remembers, which may be the readings of hundreds of steps.
      cap: greatest factor.
    """

    forgetting: float = 0.8
    tail: float = 1e-5
    cap: float = 1e3

    def factor(self, surprise: Surprise, variance: Array) -> tuple[Array, Array]:
        """Factor of this step, and r with its residual in it, in every component alike (..., d)."""
        seen = ~np.isnan(surprise.residual)
        residual = np.where(seen, surprise.residual, 0.0)
        both = seen[..., :, None] & seen[..., None, :]
        spread = np.where(both, surprise.predicted + surprise.process_noise + surprise.noise, np.eye(residual.shape[-1]))
        dof = np.sum(seen, axis=-1)
        ratio = normalized_squared(residual, spread) / np.where(dof > 0, dof, np.nan)
        before = np.where(np.isnan(variance[..., 0]), 1.0, variance[..., 0])  # as if it had always been what is expected
        mean = np.where(np.isnan(ratio), before, self.forgetting * before + (1.0 - self.forgetting) * ratio)
        freedom = np.maximum(dof, 1) * (1.0 + self.forgetting) / (1.0 - self.forgetting)
        failing = mean > chi2.isf(self.tail, freedom) / freedom
        total, predicted, process, noise = (np.diagonal(part, axis1=-2, axis2=-1) for part in (spread, *surprise[1:]))
        weight = np.where(seen, 1.0 / noise, 0.0)
        surplus = np.sum(weight * (mean[..., None] * total - process - noise), axis=-1)
        expected = np.sum(weight * predicted, axis=-1)
        factor = np.clip(surplus / np.where(expected > 0.0, expected, np.inf), 1.0, self.cap)
        return np.where(failing, factor, 1.0), np.broadcast_to(mean[..., None], residual.shape)
