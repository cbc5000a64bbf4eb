"""A complementary filter: the model predicts, a fixed share of each sensor's surprise corrects."""

from typing import NamedTuple

import numpy as np

from estimation.state_space import Multiplicative
from models.dynamics.process import runge_kutta

SPACE = Multiplicative()  # differences of states, the attitude's as a rotation vector


class Belief(NamedTuple):
    """What the loop asks for, and whatever the filter wants to remember."""

    mean: np.ndarray  # (trials, 11): q_BN, omega_BN_B rad/s, wheel speeds rad/s


class ComplementaryFilter:
    """Shares of the surprise in attitude, rate and wheel speed that are believed."""

    def __init__(self, setting):
        self.process = setting.process_with_drag
        self.gain = np.repeat([0.4, 0.7, 0.3], [3, 3, setting.wheels])

    def initial(self, measurement):
        """Start from the first reading, at rest where it is missing."""
        return Belief(np.where(np.isnan(measurement), np.eye(measurement.shape[-1])[3], measurement))

    def step(self, belief, command, measurement, dt):
        """Predict, then correct with what was read."""
        predicted = runge_kutta(self.process, belief.mean, command, dt)
        surprise = np.nan_to_num(SPACE.difference(measurement, predicted))  # a missing component is NaN: it corrects nothing
        return Belief(SPACE.displace(predicted, self.gain * surprise))
