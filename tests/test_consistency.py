"""The filters' covariances tell the truth: NEES and NIS averaged over trials stay inside their chi-square bounds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from sim.build import build
from sim.loop import run
from sim.scenario import load

TRIALS, DOF = 50, 10


@pytest.fixture(scope="module")
def recording():
    return run(build(load("nacs/fault-free", {"run.seed": 31337, "run.ticks": 500}), np.arange(TRIALS)))


@pytest.mark.parametrize("observer", ["ekf", "mekf"])
@pytest.mark.parametrize("statistic", ["nees", "nis"])
def test_the_consistent_set_is_consistent_at_most_ticks(recording, observer: str, statistic: str) -> None:
    average = recording.channels[f"{observer}/{statistic}"][1:].mean(axis=1)  # the first belief is the first reading: no innovation
    low, high = chi2.ppf([0.025, 0.975], DOF * TRIALS) / TRIALS
    assert np.mean((low < average) & (average < high)) >= 0.80


def test_a_filter_that_trusts_its_model_too_much_is_found_out() -> None:
    overconfident = {
        "process_noise": [1e-12, 4e-9, 1.3e-2],
        "measurement_noise": "sensors",
        "boundary_layer": [4e-4, 8e-3, 2.0],
        "wheel_drag": True,
    }
    short = run(build(load("nacs/fault-free", {"run.ticks": 200, "tuning": overconfident}), np.arange(TRIALS)))
    average = short.channels["mekf/nees"][50:].mean(axis=1)
    assert np.mean(average < chi2.ppf(0.975, DOF * TRIALS) / TRIALS) < 0.1
