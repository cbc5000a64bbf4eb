"""Marginalised unscented particle filter: a state and the unknown parameters of its model, one by particles, the other by Gaussians."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.observation import begin
from estimation.rao_blackwellised import BlockBelief, BlockDraws, Joint, RaoBlackwellisedFilter
from estimation.resampling import Resampling, multinomial
from estimation.sigma_points import SigmaPoints, factor
from estimation.state_space import Euclidean
from models.dynamics.measurement import MeasurementModel
from models.dynamics.process import ProcessModel, runge_kutta

Array = NDArray[np.floating]

Sampled = Literal["state", "parameters"]


class ParameterModel(ProcessModel, Protocol):
    """A model of [motion, parameters] whose accelerations are linear in parameters that stay as they are."""

    @property
    def size(self) -> int:
        """Motion and parameters."""
        ...

    def acceleration(self, motion: Array, parameters: Array, command: Array) -> Array:
        """(..., 2 d), (..., p) and (..., r) to (..., d)."""
        ...

    def by_weights(self, motion: Array) -> Array:
        """Sensitivity of accelerations to parameters, (..., 2 d) to (..., d, p)."""
        ...


@dataclass(frozen=True, eq=False)
class GivenMotion:
    """Particles on the motion, the parameters by a Kalman filter each (variant B).

    With the acceleration held as it is at the middle of the step the motion is linear in the parameters: the unscented transform of a
    linear function is exact, and so are the two products that stand here in its place.

    Attributes:
      process: of motion and parameters.
      motion_noise: Q of one step, (2 d, 2 d).
      parameter_noise: variance of one step's random walk, (p,).
    """

    process: ParameterModel
    motion_noise: Array
    parameter_noise: Array

    def joint(self, sampled: Array, mean: Array, covariance: Array, command: Array, dt: float) -> Joint:
        """As `ConditionalModel`."""
        half = sampled.shape[-1] // 2
        place, speed = sampled[..., :half], sampled[..., half:]
        now = self.process.acceleration(sampled, mean, command)
        middle = np.concatenate([place + 0.5 * dt * speed, speed + 0.5 * dt * now], axis=-1)
        held = self.process.acceleration(middle, mean, command)
        after = np.concatenate([place + dt * speed + 0.5 * dt**2 * held, speed + dt * held], axis=-1)
        towards = self.process.by_weights(middle)
        shared = (towards @ covariance).swapaxes(-1, -2)  # (..., p, d)
        uncertain = towards @ shared
        spread = np.concatenate(
            [
                np.concatenate([0.25 * dt**4 * uncertain, 0.5 * dt**3 * uncertain], axis=-1),
                np.concatenate([0.5 * dt**3 * uncertain, dt**2 * uncertain], axis=-1),
            ],
            axis=-2,
        )
        cross = np.concatenate([0.5 * dt**2 * shared, dt * shared], axis=-1)
        wider = np.array(covariance)
        np.einsum("...ii->...i", wider)[...] += self.parameter_noise
        return Joint(after, mean, spread + self.motion_noise, cross, wider)


@dataclass(frozen=True, eq=False)
class GivenParameters:
    """Particles on the parameters, the motion by an unscented Kalman filter each (variant A, Rososhansky 2017, eq. 5.8-5.16).

    The motion is moved by the parameters after their step, so that a reading says something of that step; to first order in it.

    Attributes:
      process: of motion and parameters.
      motion_noise: Q of one step, (2 d, 2 d).
      parameter_noise: variance of one step's random walk, (p,).
      points: how sigma points are drawn.
      integrate: discretisation.
    """

    process: ParameterModel
    motion_noise: Array
    parameter_noise: Array
    points: SigmaPoints = field(default_factory=SigmaPoints)
    integrate: Callable[[ProcessModel, Array, Array, float], Array] = runge_kutta

    def joint(self, sampled: Array, mean: Array, covariance: Array, command: Array, dt: float) -> Joint:
        """As `ConditionalModel`."""
        before = mean[..., None, :] + self.points.offsets(factor(covariance)[0])
        parameters = np.broadcast_to(sampled[..., None, :], (*before.shape[:-1], sampled.shape[-1]))
        state = np.concatenate([before, parameters], axis=-1)
        after = self.integrate(self.process, state, command[..., None, :], dt)[..., : mean.shape[-1]]
        shift, spread = self.points.moments(after[..., 1:, :] - after[..., :1, :])
        pushed = self.process.by_weights(mean)
        towards = np.concatenate([0.5 * dt**2 * pushed, dt * pushed], axis=-2)  # (..., 2 d, p)
        cross = towards * self.parameter_noise
        walk = np.diag(self.parameter_noise)[None]
        return Joint(sampled, after[..., 0, :] + shift, walk, cross, spread + self.motion_noise + cross @ towards.swapaxes(-1, -2))


@dataclass(frozen=True, eq=False)
class MarginalisedUnscentedFilter:
    """State [motion, parameters] of which the motion is read, or a function of it, NaN where not (Rososhansky 2017, sec. 5.2.4).

    The thesis defines the filter twice, in contradiction: eq. 5.8-5.16 put the particles on the parameters (A), its introduction and the
    plots of its appendix C on the motion (B). Eq. 5.12 to 5.14 give all particles one gain and, for a likelihood, a predicted reading;
    here each particle has its own gain and the density of its own innovation.

    Attributes:
      process: of motion and parameters.
      motion_noise: Q of one step, (2 d, 2 d).
      parameter_noise: variance of one step's random walk, (p,).
      measurement_noise: R of a reading of the motion, (2 d, 2 d); None where `measurement` is given.
      parameter_variance: of the parameters at first, around zero, (p,).
      sampled: which block the particles are of: `state` (B) or `parameters` (A).
      particles: how many.
      proposal: importance density.
      resampling: scheme.
      threshold: effective share of the particles below which they are resampled.
      every: steps after which they are resampled whatever their weights, in place of the threshold; 0: there is no such schedule.
      points: sigma points of variant A.
      integrate: discretisation of variant A.
      measurement: model of a reading of the motion, and its noise.
      prior: motion (2 d,) from which a `measurement` begins.
      prior_variance: variance of that, (2 d,).

    Raises:
      ValueError: `measurement` without a prior.
    """

    process: ParameterModel
    motion_noise: Array
    parameter_noise: Array
    measurement_noise: Array | None
    parameter_variance: Array
    sampled: Sampled = "state"
    particles: int = 100
    proposal: Literal["optimal", "prior", "likelihood"] = "optimal"
    resampling: Resampling = multinomial
    threshold: float = 0.8
    every: int = 0
    points: SigmaPoints = field(default_factory=SigmaPoints)
    integrate: Callable[[ProcessModel, Array, Array, float], Array] = runge_kutta
    measurement: MeasurementModel | None = None
    prior: Array | None = None
    prior_variance: Array | None = None

    def __post_init__(self) -> None:
        if self.measurement is not None and (self.prior is None or self.prior_variance is None):
            raise ValueError("a measurement model needs prior and prior_variance, those of the motion before the first reading")
        _ = self.blocks  # so that bad settings are refused here

    @property
    def size(self) -> int:
        """Random numbers a particle and step."""
        return len(self.motion_noise) if self.sampled == "state" else len(self.parameter_noise)

    @cached_property
    def blocks(self) -> RaoBlackwellisedFilter:
        """The filter of two blocks that this is."""
        motion, parameters = len(self.motion_noise), len(self.parameter_noise)
        noises = self.process, self.motion_noise, self.parameter_noise
        common: dict[str, Any] = {
            "measurement_noise": self.measurement_noise,
            "particles": self.particles,
            "proposal": self.proposal,
            "resampling": self.resampling,
            "threshold": self.threshold,
            "every": self.every,
            "measurement": self.measurement,
        }
        whole = self.measurement is None
        if self.sampled == "state":
            by_motion = np.eye(motion) if whole else None
            return RaoBlackwellisedFilter(GivenMotion(*noises), by_motion, None, **common, measured="sampled")
        model = GivenParameters(*noises, self.points, self.integrate)
        by_parameters, by_motion = (np.zeros((motion, parameters)), np.eye(motion)) if whole else (None, None)
        return RaoBlackwellisedFilter(model, by_parameters, by_motion, **common, measured="conditional")

    def initial(self, reading: Array, draws: BlockDraws) -> BlockBelief:
        """Start around the first reading of the motion, (..., 2 d), of which nothing may be missing; or from the prior and any reading."""
        nothing, ignorance = np.zeros((*reading.shape[:-1], len(self.parameter_variance))), np.diag(self.parameter_variance)
        motion, spread = reading, self.measurement_noise
        if self.measurement is not None and self.prior is not None and self.prior_variance is not None:
            motion, spread = begin(self.measurement, Euclidean(), reading, self.prior, self.prior_variance)[:2]
        assert spread is not None
        if self.sampled == "state":
            return self.blocks.initial(motion, spread, nothing, ignorance, draws)
        return self.blocks.initial(nothing, ignorance, motion, spread, draws)

    def step(self, belief: BlockBelief, command: Array, reading: Array, dt: float, draws: BlockDraws) -> BlockBelief:
        """Predict over `dt` seconds of `command` (..., r), then correct with `reading` (..., m)."""
        return self.blocks.step(belief, command, reading, dt, draws)

    def motion(self, belief: BlockBelief) -> Array:
        """Estimate of the motion, (..., 2 d)."""
        return belief.sampled_mean if self.sampled == "state" else belief.conditional_mean

    def parameters(self, belief: BlockBelief) -> Array:
        """Estimate of the parameters, (..., p)."""
        return belief.conditional_mean if self.sampled == "state" else belief.sampled_mean
