"""Unscented Kalman filter: models are asked at sigma points instead of for their Jacobians."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from estimation.gaussian import Belief, corrected, innovate, joseph
from estimation.observation import begin, degrees_of_freedom, observe_by_points, whole_state
from estimation.sigma_points import SigmaPoints, factor
from estimation.state_space import Additive, StateSpace
from models.dynamics.direction_measurement import DirectionsOfAttitude
from models.dynamics.measurement import MeasurementModel
from models.dynamics.process import ProcessModel, runge_kutta

Array = NDArray[np.floating]


def euler(process: ProcessModel, state: Array, command: Array, dt: float) -> Array:
    """State (..., n) after one explicit Euler step (Hill et al. 2021, eq. 8)."""
    return state + dt * process.derivative(state, command)


class Predicted(NamedTuple):
    """A belief before its reading."""

    mean: Array  # (..., n)
    covariance: Array  # (..., e, e)
    lost: Array  # (...,) 1 where the covariance before had to be repaired


@dataclass(frozen=True, eq=False)
class UnscentedFilter:
    """Predict with sigma points, correct with a reading (Julier & Uhlmann 2004; Wan & van der Merwe 2000).

    With `Additive` coordinates the quaternion is treated by components as in Hill et al. (2021), whose state is [q, omega]: every sigma
    point and every mean is scaled to unit length, readings of either sign are aligned. With `Multiplicative` ones this is the filter of
    Crassidis & Markley (2003), attitude errors being seen from the central sigma point, but that the error is a rotation vector instead of
    generalised Rodrigues parameters (equal to second order for their f = 2 (a + 1)). They add half of Q before the prediction.

    Where the reading is the whole state, or linear in its errors, Kalman's correction is exact and points need not be redrawn with Q in
    them. Where `measurement` is another function of the state they are, and go through it.

    Missing components of a reading are NaN: a wholly missing reading predicts only. A covariance without a Cholesky factor is repaired
    in its trial alone and counted in `Belief.lost`.

    Attributes:
      process: model dx/dt = f(x, u) of the state, (..., n).
      process_noise: Q of one step in error coordinates, (..., e, e); of what is added at its end.
      measurement_noise: R of a reading of the whole state, in error coordinates, (..., e, e); None where `measurement` is given.
      prior: state (n,) that fills what the first reading misses.
      prior_variance: variance of that, in error coordinates, (e,).
      space: error coordinates of the state.
      alpha: spread of the sigma points.
      beta: what is known of the fourth moment; 2 for a Gaussian.
      kappa: secondary spread.
      integrate: discretisation, `process.runge_kutta` or `euler`.
      measurement: model of the reading and its noise.
      process_noise_before: of what is added at the step's begin and moved by it, (..., e, e).
      outlier_tail: probability below which a reading as surprising as this one is taken for an outlier and not believed; 0: none is.

    Raises:
      ValueError: settings of the sigma points that can turn a covariance negative; neither `measurement_noise` nor `measurement`, or both.
    """

    process: ProcessModel
    process_noise: Array
    measurement_noise: Array | None
    prior: Array
    prior_variance: Array
    space: StateSpace = field(default_factory=Additive)
    alpha: float = 0.1
    beta: float = 2.0
    kappa: float = 0.0
    integrate: Callable[[ProcessModel, Array, Array, float], Array] = runge_kutta
    measurement: MeasurementModel | None = None
    process_noise_before: Array | float = 0.0
    outlier_tail: float = 0.0

    def __post_init__(self) -> None:
        _ = self.points, self.measurement_model  # so that bad settings are refused here

    @cached_property
    def points(self) -> SigmaPoints:
        """How sigma points are drawn."""
        return SigmaPoints(self.alpha, self.beta, self.kappa)

    @cached_property
    def measurement_model(self) -> MeasurementModel:
        """What is read."""
        return whole_state(self.measurement, self.measurement_noise, self.space)

    def initial(self, measurement: Array) -> Belief:
        """Start from the first reading (..., m) and its noise; what it misses comes from the prior."""
        belief = begin(self.measurement_model, self.space, measurement, self.prior, self.prior_variance)
        belief = belief._replace(lost=np.zeros(belief.nis.shape))
        if not isinstance(self.measurement_model, DirectionsOfAttitude):
            return belief
        lead = belief.nis.shape
        mean = np.array(np.broadcast_to(self.prior, (*lead, self.prior.shape[-1])))
        covariance = np.broadcast_to(self.prior_variance[..., None] * np.eye(self.prior_variance.shape[-1]), belief.covariance.shape)
        first = replace(self, outlier_tail=0.0).correct(Predicted(mean, covariance, np.zeros(lead)), belief, measurement)
        return first._replace(nis=belief.nis, innovation=belief.innovation, log_likelihood=belief.log_likelihood)

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Predict over `dt` seconds of `command` (..., r), then correct with `measurement` (..., m).

        Raises:
          LostDefiniteness: the innovation covariance is not positive definite.
        """
        predicted = self.propagate(belief, command, dt)
        return self.correct(predicted._replace(covariance=predicted.covariance + self.process_noise), belief, measurement)

    def correct(self, predicted: Predicted, before: Belief, reading: Array, memory: Any = None) -> Belief:
        """What is believed after a reading (..., m) of what was predicted, process noise included, from the belief `before`."""
        mean, covariance, lost = predicted
        observation, repaired = observe_by_points(self.points, self.measurement_model, self.space, reading, mean, covariance)
        innovation = innovate(covariance, *observation)
        dof = degrees_of_freedom(self.measurement_model, self.space, observation.residual)
        if self.outlier_tail > 0.0:
            outlier = innovation.nis > chi2.isf(self.outlier_tail, np.maximum(dof, 1.0))
            gain = np.where(outlier[..., None, None], 0.0, innovation.gain)
            innovation = innovation._replace(gain=gain)
        correction = (innovation.gain @ innovation.residual[..., None])[..., 0]
        return corrected(
            self.space.displace(mean, correction),
            joseph(covariance, innovation.gain, observation.noise, innovation.sensitivity),
            innovation,
            dof,
            before,
            lost if repaired is None else np.maximum(lost, repaired),
            memory,
        )

    def propagate(self, belief: Belief, command: Array, dt: float) -> Predicted:
        """Mean and covariance after `dt` seconds as the model moves them, before the noise at the end of the step and the reading."""
        root, lost = factor(belief.covariance + self.process_noise_before)
        before = self.space.displace(belief.mean[..., None, :], self.points.offsets(root))
        after = self.integrate(self.process, before, command[..., None, :], dt)
        centre = after[..., 0, :]
        mean, covariance = self.points.moments(self.space.difference(after[..., 1:, :], centre[..., None, :]))
        return Predicted(self.space.displace(centre, mean), covariance, lost)
