"""A filter of your own beside the built-in ones: here a fixed-gain observer of the paper's model."""

from typing import NamedTuple

import numpy as np

import nacs
from models.dynamics.process import runge_kutta


class Belief(NamedTuple):
    mean: np.ndarray  # (trials, 11): q_BN, omega_BN_B rad/s, wheel speeds rad/s


class Luenberger:
    """Predicts by the model, and corrects by a fixed share of what was read."""

    def __init__(self, setting):
        self.process, self.space, self.rest = setting.process_with_drag, setting.space, setting.layout.rest

    def initial(self, measurement):
        return Belief(np.where(np.isnan(measurement), self.rest, measurement))

    def step(self, belief, command, measurement, dt):
        predicted = runge_kutta(self.process, belief.mean, command, dt)
        surprise = np.nan_to_num(self.space.difference(measurement, predicted))
        return Belief(self.space.displace(predicted, 0.3 * surprise))


flown = nacs.run("nacs/fault-free", trials=4, set={"run.ticks": 200, "phases": {}}, observers=[Luenberger])
table = flown.metrics
wanted = table[(table.metric == "rmse_truth_rate") & (table.phase == "all")]
print(1e3 * wanted.groupby("subject").value.mean().round(6), "1e-3 rad/s")
