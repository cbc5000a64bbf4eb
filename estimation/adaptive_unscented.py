"""Adaptive unscented Kalman filter: an unscented filter with a fading memory and process noise that may depend on the estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.fading import ConstantFading, FadingLaw, Surprise
from estimation.gaussian import Belief
from estimation.observation import observe
from estimation.proposals import ProcessNoise
from estimation.state_space import StateSpace
from estimation.unscented import Predicted, UnscentedFilter

Array = NDArray[np.floating]


class FadingMemory(NamedTuple):
    """What the filter keeps besides a Gaussian belief, as `Belief.memory`."""

    fading: Array  # (...,) factor of the last step
    variance: Array  # (..., d) of residuals
    elapsed: Array  # (...,) s since the first reading


@dataclass(frozen=True, eq=False)
class AdaptiveUnscentedFilter:
    """Unscented filter whose predicted covariance is lambda M + Q (Rososhansky 2017, sec. 2.5, eq. 2.13).

    M is what the model makes of the covariance before. With a constant factor of one and constant noise it is the unscented filter.

    Attributes:
      unscented: the filter; its own process noise is not used.
      process_noise: of one step.
      fading: law of lambda.
    """

    unscented: UnscentedFilter
    process_noise: ProcessNoise
    fading: FadingLaw = field(default_factory=ConstantFading)

    @property
    def space(self) -> StateSpace:
        """Error coordinates of the covariance."""
        return self.unscented.space

    def initial(self, measurement: Array) -> Belief:
        """Start from the first reading (..., m) and its noise; what it misses comes from the prior."""
        belief = self.unscented.initial(measurement)
        lead, size = belief.nis.shape, belief.innovation.shape[-1]
        return belief._replace(memory=FadingMemory(np.ones(lead), np.full((*lead, size), np.nan), np.zeros(lead)))

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Predict over `dt` seconds of `command` (..., r), then correct with `measurement` (..., m).

        Raises:
          LostDefiniteness: the innovation covariance is not positive definite.
        """
        memory: FadingMemory = belief.memory
        predicted = self.unscented.propagate(belief, command, dt)
        root = self.process_noise.root(belief.mean, memory.elapsed)
        process = root @ root.swapaxes(-1, -2)
        observation = observe(self.unscented.measurement_model, self.space, measurement, predicted.mean)
        factor, variance = self.fading.factor(Surprise.of(observation, predicted.covariance, process), memory.variance)
        faded = Predicted(predicted.mean, factor[..., None, None] * predicted.covariance + process, predicted.lost)
        return self.unscented.correct(faded, belief, measurement, FadingMemory(factor, variance, memory.elapsed + dt))
