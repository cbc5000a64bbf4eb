"""One faulty agent told by its neighbours' residuals: the statistic against its distribution and by hand, and the flights."""

import numpy as np
import pytest
from scipy import stats

from estimation.neighbours_residuals import agents_statistic, named
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.formation import evaluate
from sim.scenario.files import load

RING = np.array([[i, (i + step) % 6] for i in range(6) for step in (1, -1)])


def residuals(rng, count: int, error: np.ndarray, own: float, sight: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a ring whose agents read with `own` and see each other with `sight`, rad; `error` (6, 3) is what they are off by besides."""
    read = error + own * rng.standard_normal((count, 6, 3))
    seen = sight * rng.standard_normal((count, len(RING), 3))
    b = read[:, RING[:, 1]] - read[:, RING[:, 0]] - seen
    return b, np.full((count, 6), own**2), np.full((count, len(RING)), own**2 + sight**2)


def test_while_nothing_fails_it_is_chi_square():
    b, own, others = residuals(np.random.default_rng(1), 20_000, np.zeros((6, 3)), 2.0, 3.0)
    found = agents_statistic(b, RING[:, 1], own, others)
    for agent in range(6):
        assert stats.kstest(found[:, agent], stats.chi2(3).cdf).pvalue > 0.01


def test_by_hand():
    """Two who see agent 1: b = 3 and 6 with d = 1 and 2, s^2 = 1: mean 4, variance 1 + 2/3, T = 16 / (5/3); nobody sees agent 2."""
    b = np.array([[3.0, 0.0, 0.0], [6.0, 0.0, 0.0]])
    found = agents_statistic(b, np.array([0, 0]), np.ones(2), np.array([1.0, 2.0]))
    np.testing.assert_allclose(found, [16.0 / (5.0 / 3.0), 0.0])
    gone = agents_statistic(np.where([[True], [False]], b, np.nan), np.array([0, 0]), np.ones(2), np.array([1.0, 2.0]))
    np.testing.assert_allclose(gone, [9.0 / 2.0, 0.0])


@pytest.mark.parametrize("agent", range(6))
def test_the_agent_that_is_off_is_named_and_not_its_neighbours(agent):
    error = np.zeros((6, 3))
    error[agent] = [0.0, 4.0, -3.0]
    b, own, others = residuals(np.random.default_rng(agent), 200, error, 1.0, 1.0)
    whom = named(agents_statistic(b, RING[:, 1], own, others), 20, 1e-6)
    assert (whom[20:] == agent).all()


def test_sums_are_over_the_window():
    statistic = np.zeros((50, 1, 2))
    statistic[10, 0, 1] = 1e3
    whom = named(statistic, 5, 1e-6)[:, 0]
    np.testing.assert_array_equal(np.flatnonzero(whom == 1), np.arange(10, 15))
    assert set(whom) == {-1, 1}


def test_false_alarms_are_as_rare_as_the_tail_says():
    rng, tail = np.random.default_rng(5), 1e-3
    b, own, others = residuals(rng, 40_000, np.zeros((6, 3)), 1.0, 2.0)
    whom = named(agents_statistic(b, RING[:, 1], own, others), 10, tail)
    assert 0.5 * 6 * tail < np.mean(whom[10::10] >= 0) < 1.2 * 6 * tail


def fly(agent: int, fault: dict, trials: int = 4):
    at = {"agents": [agent], "start_s": 1.0, "duration_s": 0.5}
    changes = {"run.ticks": 150, "faults": [fault | at]}
    scenario = load("formation/sensor-fault", changes)
    recording = run(build(scenario, np.arange(trials), loop="aukf"))
    return {m.metric: m.values for m in evaluate("aukf", recording, scenario) if m.metric.startswith("isolation")}


@pytest.mark.parametrize("agent", [1, 3])
@pytest.mark.parametrize("fault", [
    {"kind": "bias", "sensor": "attitude", "size": 0.02}, {"kind": "noise", "sensor": "attitude", "deviation": 0.02}])  # fmt: skip
def test_a_formation_names_the_agent_whose_sensor_fails(agent, fault):
    found = fly(agent, fault)
    np.testing.assert_array_equal(found["isolation_right"], 1.0)
    np.testing.assert_array_equal(found["isolation_missed"], 0.0)
    np.testing.assert_array_equal(found["isolation_false_alarms"], 0.0)
    np.testing.assert_allclose(found["isolation_quiet_s"], 1.0)
    assert found["isolation_delay_s"].max() < 0.2


def test_looking_for_a_fault_changes_no_loop():
    one, other = (run(build(load("formation/sensor-fault", {"run.ticks": 30, "faults": []} | more), np.arange(2), loop="aukf"))
                  for more in ({}, {"isolation.deviation_rad": 0.1}))  # fmt: skip
    np.testing.assert_array_equal(one.channels["truth/state"], other.channels["truth/state"])
    plain = run(build(load("formation/fault-free", {"run.ticks": 5, "phases": {}}), np.arange(2), loop="truth"))
    assert not any(name.startswith("isolation") for name in plain.figures)
