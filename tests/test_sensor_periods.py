"""Sensors that read at periods of their own, and filters that go on with what there is."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.consistency import average_bounds
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.scenario.files import load

NAME = "nacs/three-rates"


@pytest.mark.parametrize("seed", [8, 515])
def test_filters_of_three_rates_are_consistent(seed: int) -> None:
    """Averages over 10 trials and many ticks, most of which are inside the bounds of one tick."""
    trials = np.arange(10)
    recording = run(build(load(NAME, {"run.ticks": 150, "run.seed": seed}), trials))
    low, high = average_bounds(10, len(trials))
    assert recording.observers == ("mekf", "ukf", "pf")
    for name in recording.observers:
        nees = recording.channels[f"{name}/nees"][25:]
        assert low < np.nanmean(nees) < high, name
        inside = np.nanmean(nees, axis=1)
        assert np.mean((inside > low) & (inside < high)) > 0.5, name


def test_each_sensor_reads_at_its_own_period() -> None:
    recording = run(build(load(NAME, {"run.ticks": 41, "observers": {"mekf": {"type": "mekf"}}}), np.arange(2)))
    there = ~np.isnan(recording.channels["reading"][:, 0])
    ticks = np.arange(41)
    np.testing.assert_array_equal(there[:, :4].all(axis=-1), ticks % 5 == 0)
    np.testing.assert_array_equal(there[:, 4:7].all(axis=-1), ticks % 1 == 0)
    np.testing.assert_array_equal(there[:, 7:].all(axis=-1), ticks % 2 == 0)
    dof = recording.channels["mekf/dof"][1:, 0]
    np.testing.assert_array_equal(dof, (3.0 * there[:, 0] + 3.0 * there[:, 4] + 4.0 * there[:, 7])[1:])


def test_a_period_that_is_no_whole_number_of_ticks_is_one_line(nacs) -> None:
    result = nacs("run", NAME, "--set", "sensors.gyro_period_s=0.05", "--out", "it")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "sensors.gyro_period_s: 0.05 s is not a whole number of ticks (run.tick_s = 0.02 s)" in result.err
