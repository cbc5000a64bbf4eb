"""Joint adaptive unscented filter: a state, and parameters that drive it linearly and are never read, estimated together."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.adaptive_unscented import FadingMemory
from estimation.fading import ConstantFading, FadingLaw, Surprise
from estimation.gaussian import Belief, cholesky, corrected, innovate, symmetrize
from estimation.observation import begin, degrees_of_freedom, observe, observe_by_points, whole_state
from estimation.sigma_points import SigmaPoints, factor
from estimation.state_space import Multiplicative
from models.dynamics.measurement import MeasurementModel
from models.dynamics.state_layout import MOTION

Array = NDArray[np.floating]

ATTITUDE = Multiplicative()


class DrivenModel(Protocol):
    """A model of [q, omega] that constant parameters drive linearly."""

    @property
    def parameters(self) -> int:
        """How many."""
        ...

    def move(self, motion: Array, weights: Array, command: Array, dt: float) -> Array:
        """State after `dt` seconds; (..., 7), (..., p) and (..., r) to (..., 7)."""
        ...

    def sensitivity(self, motion: Array, command: Array, dt: float) -> Array:
        """Its change with the parameters, in error coordinates, given the state at half of it; (..., 7) and (..., r) to (..., 6, p)."""
        ...


@dataclass(frozen=True, eq=False)
class JointUnscentedFilter:
    """Adaptive unscented filter of [q, omega, W] (Rososhansky 2017, sec. 2.5 and eq. 5.4-5.6), its transform marginalised over W.

    Given the state the model is linear in W, so that only the six errors of the state need sigma points; each takes along what W is
    expected to be there, and the rest of W's spread goes through the sensitivity, as in a Kalman filter: 13 points instead of
    2 (6 + p) + 1 (Morelande & Moran 2007, the marginalised unscented transform). No factor of the whole covariance is ever needed.
    W is a random walk, never less known than at first. Belief.mean is [q, omega, W], its covariance that of [rotation vector, rate, W].

    Attributes:
      process: analytic model.
      process_noise: added to the state's covariance every step, (6, 6).
      parameter_noise: variance of each parameter's step, (p,).
      measurement_noise: of a reading of [q, omega], (6, 6); None where `measurement` is given.
      prior: state (7,) of which what the first reading misses is taken.
      prior_variance: its variance, (6,).
      parameter_variance: of parameters before the first step, which begin at zero, (p,).
      alpha: spread of the sigma points.
      beta: see `SigmaPoints`.
      kappa: secondary spread.
      fading: law of the factor lambda in P- = lambda M + Q.
      measurement: model of a reading of [q, omega], and its noise.

    Raises:
      ValueError: settings of the sigma points that can turn a covariance negative; neither `measurement_noise` nor `measurement`, or both.
    """

    process: DrivenModel
    process_noise: Array
    parameter_noise: Array
    measurement_noise: Array | None
    prior: Array
    prior_variance: Array
    parameter_variance: Array
    alpha: float = 0.1
    beta: float = 2.0
    kappa: float = 0.0
    fading: FadingLaw = field(default_factory=ConstantFading)
    measurement: MeasurementModel | None = None

    def __post_init__(self) -> None:
        _ = self.points, self.measurement_model  # so that bad settings are refused here

    @cached_property
    def points(self) -> SigmaPoints:
        """How sigma points are drawn."""
        return SigmaPoints(self.alpha, self.beta, self.kappa)

    @cached_property
    def measurement_model(self) -> MeasurementModel:
        """What is read of [q, omega]."""
        return whole_state(self.measurement, self.measurement_noise, ATTITUDE)

    @property
    def space(self) -> Multiplicative:
        """Error coordinates of the covariance; parameters by components."""
        return ATTITUDE

    def initial(self, reading: Array) -> Belief:
        """Start from the first reading (..., m), of [q, omega] unless told otherwise, and its noise; the rest comes from the prior."""
        first = begin(self.measurement_model, ATTITUDE, reading, self.prior, self.prior_variance)
        lead, unknown = first.nis.shape, self.process.parameters
        covariance = np.zeros((*lead, 6 + unknown, 6 + unknown))
        covariance[..., :6, :6] = first.covariance
        covariance[..., 6:, 6:] = np.diag(self.parameter_variance)
        mean = np.concatenate([first.mean, np.zeros((*lead, unknown))], axis=-1)
        memory = FadingMemory(np.ones(lead), np.full(first.innovation.shape, np.nan), np.zeros(lead))
        return first._replace(mean=mean, covariance=covariance, lost=np.zeros(lead), memory=memory)

    def step(self, belief: Belief, command: Array, reading: Array, dt: float) -> Belief:
        """Predict over `dt` seconds of `command` (..., r), then correct with a reading (..., m), NaN where missing.

        Raises:
          LostDefiniteness: the innovation covariance is not positive definite.
        """
        memory: FadingMemory = belief.memory
        motion, covariance, lost = self.propagate(belief, command, dt)
        seen_there = observe(self.measurement_model, ATTITUDE, reading, motion)
        fading, variance = self.fading.factor(Surprise.of(seen_there, covariance[..., :6, :6], self.process_noise), memory.variance)
        covariance = fading[..., None, None] * covariance
        covariance[..., :6, :6] += self.process_noise
        covariance[..., 6:, 6:] += np.diag(self.parameter_noise)
        covariance = self._bounded(covariance)

        own = covariance[..., :6, :6]
        observation, repaired = observe_by_points(self.points, self.measurement_model, ATTITUDE, reading, motion, own)
        residual, noise, sensitivity = observation
        innovation = innovate(own, *observation)
        seen = ~np.isnan(residual)
        both = seen[..., :, None] & seen[..., None, :]
        read = covariance[..., :6, :] if sensitivity is None else sensitivity @ covariance[..., :6, :]  # H P
        spread = own if sensitivity is None else read[..., :6] @ sensitivity.swapaxes(-1, -2)
        root = cholesky(np.where(both, spread + noise, np.eye(seen.shape[-1])))
        # L^-1 H P with S = L L': gain and covariance follow from it by products of few rows, where Joseph's form takes the whole matrix
        cross = np.linalg.solve(root, read * seen[..., :, None])
        white = np.linalg.solve(root, innovation.residual[..., None])
        correction = (cross.swapaxes(-1, -2) @ white)[..., 0]
        moved = ATTITUDE.displace(motion, correction[..., :6])
        return corrected(
            np.concatenate([moved, belief.mean[..., MOTION.stop :] + correction[..., 6:]], axis=-1),
            symmetrize(covariance - cross.swapaxes(-1, -2) @ cross),
            innovation,
            degrees_of_freedom(self.measurement_model, ATTITUDE, residual),
            belief,
            lost if repaired is None else np.maximum(lost, repaired),
            FadingMemory(fading, variance, memory.elapsed + dt),
        )

    def _bounded(self, covariance: Array) -> Array:
        """The same with no parameter less known than before the first reading; (..., 6 + p, 6 + p).

        Forgetting inflates what no reading excites without limit (Astrom & Wittenmark 1995, sec. 11.5), until it has no factor any more.
        """
        variance = np.diagonal(covariance, axis1=-2, axis2=-1)[..., 6:]
        excess = variance > self.parameter_variance
        if not excess.any():
            return covariance
        scale = np.ones(covariance.shape[:-1])
        scale[..., 6:] = np.sqrt(np.where(excess, self.parameter_variance / np.where(excess, variance, 1.0), 1.0))
        return covariance * scale[..., :, None] * scale[..., None, :]

    def propagate(self, belief: Belief, command: Array, dt: float) -> tuple[Array, Array, Array]:
        """State (..., 7) and joint covariance (..., 6 + p, 6 + p) as the model moves them, and 1 where one was repaired, (...,)."""
        motion, weights = belief.mean[..., MOTION], belief.mean[..., MOTION.stop :]
        own, shared, rest = belief.covariance[..., :6, :6], belief.covariance[..., :6, 6:], belief.covariance[..., 6:, 6:]
        root, lost = factor(own)
        along = np.linalg.solve(root, shared)  # deviations of W that belong to one of the state, (..., 6, p)
        apart = rest - along.swapaxes(-1, -2) @ along  # covariance of W given the state

        offsets = self.points.offsets(root)
        spread = self.points.alpha * np.sqrt(6.0 + self.points.kappa)
        moved = np.zeros((*offsets.shape[:-1], weights.shape[-1]))
        moved[..., 1:7, :], moved[..., 7:, :] = spread * along, -spread * along
        before = ATTITUDE.displace(motion[..., None, :], offsets)
        after = self.process.move(before, weights[..., None, :] + moved, command[..., None, :], dt)
        centre = after[..., 0, :]
        errors = ATTITUDE.difference(after[..., 1:, :], centre[..., None, :])
        mean, state = self.points.moments(errors)

        middle = ATTITUDE.displace(motion, 0.5 * ATTITUDE.difference(centre, motion))
        slope = self.process.sensitivity(middle, command, dt)
        slid = slope @ apart
        covariance = np.empty(belief.covariance.shape)
        covariance[..., :6, :6] = state + symmetrize(slid @ slope.swapaxes(-1, -2))
        cross = 0.5 / spread**2 * (errors.swapaxes(-1, -2) @ moved[..., 1:, :]) + slid
        covariance[..., :6, 6:], covariance[..., 6:, :6] = cross, cross.swapaxes(-1, -2)
        covariance[..., 6:, 6:] = rest
        return ATTITUDE.displace(centre, mean), covariance, lost
