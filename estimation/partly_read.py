"""Adaptive unscented filter of a state of which the first components alone are ever read, as when the rest are parameters."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimation.adaptive_unscented import FadingMemory
from estimation.fading import ConstantFading, FadingLaw, Surprise
from estimation.gaussian import Belief, corrected, innovate, no_detection, symmetrize
from estimation.unscented import UnscentedFilter

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class PartlyReadFilter:
    """`AdaptiveUnscentedFilter` that does not carry along what is never read: P- = lambda M + Q, a reading of `read` components.

    With many parameters in the state an innovation of the whole of it would be the larger part of the work. The error coordinates of
    what is read must be the first ones, and read directly.

    Attributes:
      unscented: the filter of the whole state; its measurement noise is that of what is read, (read, read).
      fading: law of lambda.
    """

    unscented: UnscentedFilter
    fading: FadingLaw = field(default_factory=ConstantFading)

    @property
    def read(self) -> int:
        """Components that are read."""
        return int(self.unscented.measurement_model.noise.shape[-1])

    def initial(self, reading: Array) -> Belief:
        """Start from the first reading (..., read) and its noise; all else comes from the prior."""
        read, prior = self.read, self.unscented.prior
        missing = np.isnan(reading)
        lead = reading.shape[:-1]
        mean = np.array(np.broadcast_to(prior, (*lead, len(prior))))
        mean[..., :read] = np.where(missing, mean[..., :read], reading)
        covariance = np.array(np.broadcast_to(np.diag(self.unscented.prior_variance), (*lead, len(prior), len(prior))))
        known = ~missing[..., :, None] & ~missing[..., None, :]
        covariance[..., :read, :read] = np.where(known, self.unscented.measurement_model.noise, covariance[..., :read, :read])
        nothing, unknown = np.zeros(lead), np.full(lead, np.nan)
        memory = FadingMemory(np.ones(lead), np.full((*lead, read), np.nan), nothing)
        dof = np.sum(~missing, axis=-1, dtype=float)
        empty = np.zeros((*lead, read))
        return Belief(mean, covariance, empty, unknown, nothing, dof, no_detection(nothing), lost=nothing, memory=memory)

    def step(self, belief: Belief, command: Array, reading: Array, dt: float) -> Belief:
        """Predict over `dt` seconds of `command` (..., r), then correct with `reading` (..., read), NaN where missing.

        Raises:
          LostDefiniteness: the innovation covariance is not positive definite.
        """
        memory: FadingMemory = belief.memory
        read, noise, process = self.read, self.unscented.measurement_model.noise, self.unscented.process_noise
        predicted = self.unscented.propagate(belief, command, dt)
        residual = reading - predicted.mean[..., :read]
        part = predicted.covariance[..., :read, :read]
        factor, variance = self.fading.factor(Surprise(residual, part, process[..., :read, :read], noise), memory.variance)
        covariance = factor[..., None, None] * predicted.covariance + process

        seen = ~np.isnan(residual)
        innovation = innovate(covariance[..., :read, :read], residual, noise)
        shared = covariance[..., :read] * seen[..., None, :]
        spread = np.where(seen[..., :, None] & seen[..., None, :], covariance[..., :read, :read] + noise, np.eye(read))
        gain = np.linalg.solve(symmetrize(spread), shared.swapaxes(-1, -2)).swapaxes(-1, -2)
        keep = np.array(np.broadcast_to(np.eye(gain.shape[-2]), covariance.shape))
        keep[..., :read] -= gain
        after = symmetrize(keep @ covariance @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2))
        return corrected(
            self.unscented.space.displace(predicted.mean, (gain @ innovation.residual[..., None])[..., 0]),
            after,
            innovation,
            belief,
            predicted.lost,
            FadingMemory(factor, variance, memory.elapsed + dt),
        )
