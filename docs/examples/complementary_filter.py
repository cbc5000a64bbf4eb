"""A complementary filter: the model predicts, a fixed share of each sensor's surprise corrects. It flies on every kind of plant."""

from typing import NamedTuple

import numpy as np

from models.dynamics.process import runge_kutta

GAINS = {"attitude": 0.4, "rate": 0.7, "wheels": 0.3, "position": 0.4, "velocity": 0.7}


class Belief(NamedTuple):
    """What the loop asks for, and whatever the filter wants to remember."""

    mean: np.ndarray  # (trials, [agents,] n): q_BN, omega_BN_B rad/s, wheel speeds rad/s, or what else `setting.layout` says


class ComplementaryFilter:
    """Shares of the surprise in each block of the state that are believed."""

    def __init__(self, setting):
        self.process, self.space, self.layout = setting.process_with_drag, setting.space, setting.layout
        self.gain = setting.layout.repeated(GAINS)

    def initial(self, measurement):
        """Start from the first reading, at rest where it is missing."""
        return Belief(np.where(np.isnan(measurement), self.layout.rest, measurement))

    def step(self, belief, command, measurement, dt):
        """Predict, then correct with what was read; a missing component is NaN."""
        predicted = runge_kutta(self.process, belief.mean, command, dt)
        surprise = self.space.difference(measurement, predicted)
        correction = np.nan_to_num(self.gain * surprise)
        if "rate" in self.layout.places:  # without a gyro the rate follows from how the attitude is wrong
            attitude, rate = self.layout.error_places["attitude"], self.layout.error_places["rate"]
            correction[..., rate] += np.where(np.isnan(surprise[..., rate]), 0.1 * np.nan_to_num(surprise[..., attitude]) / dt, 0.0)
        return Belief(self.space.displace(predicted, correction))
