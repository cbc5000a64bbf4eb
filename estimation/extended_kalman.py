"""Extended Kalman filter with the gain as an exchangeable part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief, Detection, Innovation, innovate, joseph, symmetrize
from estimation.observation import begin, degrees_of_freedom, observe, whole_state
from estimation.state_space import Additive, StateSpace
from models.dynamics.measurement import MeasurementModel
from models.dynamics.process import Prediction, ProcessModel, predict

Array = NDArray[np.floating]


class GainLaw(Protocol):
    """How an innovation is turned into a gain; may remember past innovations in a Detection."""

    def start(self, shape: tuple[int, ...]) -> Detection:
        """Memory before the first reading, for beliefs of batch shape `shape`."""
        ...

    def gain(self, innovation: Innovation, detection: Detection) -> tuple[Array, Detection]:
        """Gain (..., e, d) for this reading, and the memory after it."""
        ...


class KalmanGain:
    """The gain of least variance, K = P H' S^-1 (McCafferty-Leroux et al. 2024, eq. 14); declares no faults."""

    def start(self, shape: tuple[int, ...]) -> Detection:
        """Empty memory."""
        return Detection(np.zeros(shape), np.zeros(shape, dtype=bool), (np.zeros((*shape, 0)),))

    def gain(self, innovation: Innovation, detection: Detection) -> tuple[Array, Detection]:
        """Kalman's gain as it is."""
        return innovation.gain, detection._replace(statistic=innovation.nis)


@dataclass(frozen=True, eq=False)
class ExtendedFilter:
    """Predict with a nonlinear model, correct with a reading (McCafferty-Leroux et al. 2024, eq. 11-16).

    The reading is the whole state (C = I there) unless `measurement` says otherwise. With `Additive` coordinates this is the paper's EKF,
    with `Multiplicative` ones the MEKF of Markley & Crassidis (2014, ch. 6.2). Missing components of a reading are NaN: a wholly missing
    reading predicts only.

    Attributes:
      process: model dx/dt = f(x, u) of the state [q, ...], (..., n).
      process_noise: Q of one step in error coordinates, (..., e, e); of what is added at its end.
      measurement_noise: R of a reading of the whole state, in error coordinates, (..., e, e); None where `measurement` is given.
      gain: law of the gain.
      space: error coordinates of the state.
      prediction: discretisation, `process.predict` or `process.predict_euler`.
      prior: state (n,) that fills what the first reading misses.
      prior_variance: variance of that, in error coordinates, (e,).
      measurement: model of the reading and its noise.
      process_noise_before: of what is added at the step's begin and moved by it, (..., e, e); Q is half of each where it is what torques do
        during the step (Crassidis & Markley 2003, eq. 41).

    Raises:
      ValueError: neither `measurement_noise` nor `measurement` is given, or both are.
    """

    process: ProcessModel
    process_noise: Array
    measurement_noise: Array | None
    prior: Array
    prior_variance: Array
    gain: GainLaw = field(default_factory=KalmanGain)
    space: StateSpace = field(default_factory=Additive)
    prediction: Callable[[ProcessModel, Array, Array, float], Prediction] = predict
    measurement: MeasurementModel | None = None
    process_noise_before: Array | float = 0.0

    def __post_init__(self) -> None:
        _ = self.measurement_model  # so that bad settings are refused here

    @cached_property
    def measurement_model(self) -> MeasurementModel:
        """What is read."""
        return whole_state(self.measurement, self.measurement_noise, self.space)

    def initial(self, measurement: Array) -> Belief:
        """Start from the first reading (..., m) and its noise; what it misses comes from the prior."""
        belief = begin(self.measurement_model, self.space, measurement, self.prior, self.prior_variance)
        return belief._replace(detection=self.gain.start(belief.nis.shape))

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Predict over `dt` seconds of `command` (..., r), then correct with `measurement` (..., m).

        Raises:
          LostDefiniteness: the innovation covariance is not positive definite.
        """
        mean, transition = self.prediction(self.process, belief.mean, command, dt)
        transition = self.space.transition(transition, belief.mean, mean)
        covariance = symmetrize(transition @ (belief.covariance + self.process_noise_before) @ transition.swapaxes(-1, -2))
        covariance = covariance + self.process_noise
        observation = observe(self.measurement_model, self.space, measurement, mean)
        innovation = innovate(covariance, *observation)
        gain, detection = self.gain.gain(innovation, belief.detection)
        correction = (gain @ innovation.residual[..., None])[..., 0]
        return Belief(
            mean=self.space.displace(mean, correction),
            covariance=joseph(covariance, gain, observation.noise, innovation.sensitivity),
            innovation=innovation.residual,
            nis=innovation.nis,
            log_likelihood=innovation.log_likelihood,
            dof=degrees_of_freedom(self.measurement_model, self.space, observation.residual),
            detection=detection,
        )
