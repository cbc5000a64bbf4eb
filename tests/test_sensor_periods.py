"""Sensors that read at periods of their own, and filters that go on with what there is."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.consistency import average_bounds
from models.plants.nacs import compile_nacs
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.one_body import evaluate
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


@pytest.mark.parametrize(
    ("name", "sensors", "missing", "incomplete"),
    [(NAME, {}, {*range(10, 17), 18, 20}, set(range(1, 30))), ("nacs/fault-free", {"gyro": False}, set(range(15, 21)), set(range(30)))],
    ids=["periods", "no gyro"],
)
def test_only_readings_that_were_due_are_missing(name: str, sensors: dict[str, bool], missing: set[int], incomplete: set[int]) -> None:
    """A gyro (read at every tick, or never) fails from tick 10 to 16, the wheels' sensor (every second tick, or each) from 15 to 20."""
    dt = load(name).run.tick_s
    faults = [
        {"kind": "drop-out", "sensor": "gyro", "start_s": 10 * dt, "duration_s": 7 * dt},
        {"kind": "drop-out", "sensor": "wheels", "start_s": 15 * dt, "duration_s": 6 * dt},
    ]
    overrides = {"run.ticks": 30, "faults": faults, "observers": {"mekf": {"type": "mekf"}}, "control.feedback": "truth"}
    scenario = load(name, overrides | {f"sensors.{key}": value for key, value in sensors.items()})
    recording = run(build(scenario, np.arange(2)))
    found = {m.metric: m.values for m in evaluate(recording, compile_nacs()) if (m.subject, m.phase) == ("loop", "all")}
    np.testing.assert_array_equal(found["missing_readings"], len(missing))
    np.testing.assert_array_equal(found["incomplete_readings"], len(incomplete))
