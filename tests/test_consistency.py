"""Chi-square tests against known distributions; and the filters' covariances tell the truth: NEES and NIS stay inside their bounds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from estimation.consistency import average_bounds, average_test, normalized_squared, whiteness
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.scenario.files import load

TRIALS, DOF = 50, 10


@pytest.fixture(scope="module")
def recording():
    return run(build(load("nacs/fault-free", {"run.seed": 31337, "run.ticks": 500}), np.arange(TRIALS)))


@pytest.mark.parametrize("observer", ["ekf", "mekf"])
@pytest.mark.parametrize("statistic", ["nees", "nis"])
def test_the_consistent_set_is_consistent_at_most_ticks(recording, observer: str, statistic: str) -> None:
    # the first belief is the first reading: no innovation
    assert average_test(recording.channels[f"{observer}/{statistic}"][1:], DOF, axis=1).fraction_inside >= 0.80


def test_a_filter_that_trusts_its_model_too_much_is_found_out() -> None:
    overconfident = {
        "process_noise": [1e-12, 4e-9, 1.3e-2],
        "measurement_noise": "sensors",
        "boundary_layer": [4e-4, 8e-3, 2.0],
        "wheel_drag": True,
    }
    short = run(build(load("nacs/fault-free", {"run.ticks": 200, "tuning": overconfident}), np.arange(TRIALS)))
    found = average_test(short.channels["mekf/nees"][50:], DOF, axis=1)
    assert np.mean(found.mean > found.bounds.high) > 0.9


def random_covariances(random: np.random.Generator, count: int, size: int) -> np.ndarray:
    root = random.standard_normal((count, size, size))
    return root @ root.swapaxes(-1, -2) + 0.1 * np.eye(size)


def test_normalized_squared_is_what_an_explicit_inverse_gives() -> None:
    random = np.random.Generator(np.random.PCG64(1))
    covariance, error = random_covariances(random, 7, 4), random.standard_normal((7, 4))
    expected = [e @ np.linalg.inv(p) @ e for e, p in zip(error, covariance, strict=True)]
    np.testing.assert_allclose(normalized_squared(error, covariance), expected, rtol=1e-9)


def test_a_singular_covariance_costs_its_own_trial_alone() -> None:
    random = np.random.Generator(np.random.PCG64(2))
    covariance, error = random_covariances(random, 3, 4), random.standard_normal((3, 4))
    alone = normalized_squared(error, covariance)
    covariance[1, 2:], covariance[1, :, 2:] = 0.0, 0.0
    found = normalized_squared(error, covariance)
    np.testing.assert_array_equal(found[[0, 2]], alone[[0, 2]])
    assert np.isnan(found[1])
    assert np.isnan(normalized_squared(error, np.full((3, 4, 4), np.nan))).all()


def test_bounds_hold_what_they_promise() -> None:
    random = np.random.Generator(np.random.PCG64(3))
    draws = np.sum(random.standard_normal((20_000, 8, 5)) ** 2, axis=-1)  # 20 000 ticks of 8 trials with 5 degrees of freedom
    low, high = average_bounds(5, 8, 0.9)
    mean = draws.mean(axis=1)
    assert np.mean(mean < low) == pytest.approx(0.05, abs=0.006)  # four standard deviations of such a share
    assert np.mean(mean > high) == pytest.approx(0.05, abs=0.006)
    np.testing.assert_allclose(average_bounds(10, 50), chi2.ppf([0.025, 0.975], 500) / 50, rtol=1e-12)


def test_missing_components_change_the_degrees_of_freedom_tick_by_tick() -> None:
    random = np.random.Generator(np.random.PCG64(4))
    there = random.random((20, 4000, 6)) < 0.7  # trials, ticks, components
    squares = random.standard_normal((20, 4000, 6)) ** 2
    statistic, dof = np.sum(squares * there, axis=-1), np.sum(there, axis=-1)
    right = average_test(np.where(dof > 0, statistic, np.nan), dof)
    assert right.fraction_inside == pytest.approx(0.95, abs=0.014)
    assert average_test(statistic, 6).fraction_inside < 0.5  # as if nothing had been missing
    for tick in (0, 17):
        low, high = chi2.ppf([0.025, 0.975], dof[:, tick].sum()) / np.sum(dof[:, tick] > 0)
        np.testing.assert_allclose([right.bounds.low[tick], right.bounds.high[tick]], [low, high], rtol=1e-12)


def test_nothing_to_average_is_no_number() -> None:
    found = average_test(np.array([[np.nan, 1.0], [np.nan, 2.0]]), 2)
    assert np.isnan(found.mean[0])
    assert found.mean[1] == 1.5
    assert found.fraction_inside == 1.0
    assert np.isnan(average_test(np.full((2, 2), np.nan), 2).fraction_inside)


def test_one_trials_nis_is_tested_over_time_or_over_both() -> None:
    random = np.random.Generator(np.random.PCG64(5))
    nis = np.sum(random.standard_normal((10, 300, 3)) ** 2, axis=-1)
    assert average_test(nis, 3, axis=1).mean.shape == (10,)
    both = average_test(nis, 3, axis=(0, 1))
    assert both.inside
    assert not average_test(1.1 * nis, 3, axis=(0, 1)).inside
    np.testing.assert_allclose(both.mean, nis.mean(), rtol=1e-12)


def test_autocorrelation_is_what_the_sums_of_the_textbook_give() -> None:
    random = np.random.Generator(np.random.PCG64(6))
    x = random.standard_normal((40, 2))
    x[[3, 9], 0] = np.nan
    found = whiteness(x, 4)
    for lag in (1, 4):
        pairs = [(a, b) for a, b in zip(x[:-lag, 0], x[lag:, 0], strict=True) if np.isfinite(a) and np.isfinite(b)]
        a, b = np.array(pairs).T
        assert found.correlation[lag - 1, 0] == pytest.approx(np.sum(a * b) / np.sqrt(np.sum(a**2) * np.sum(b**2)))
        assert found.bound[lag - 1, 0] == pytest.approx(1.959964 / np.sqrt(len(pairs)))


def test_white_noise_is_white_and_an_autoregression_is_not() -> None:
    random = np.random.Generator(np.random.PCG64(7))
    white = random.standard_normal((50, 600, 3)) * [1.0, 1e-3, 40.0]  # trials, ticks, components of different units
    assert whiteness(white, 10).fraction_inside == pytest.approx(0.95, abs=0.02)
    coloured = white.copy()
    for k in range(1, 600):
        coloured[:, k] += 0.3 * coloured[:, k - 1]
    found = whiteness(coloured, 3)
    np.testing.assert_allclose(found.correlation.mean(axis=(0, 2)), [0.3, 0.09, 0.027], atol=0.015)
    assert np.mean(np.abs(found.correlation[:, 0]) > found.bound[:, 0]) > 0.99


@pytest.mark.parametrize("tick_s", [0.01, 0.02, 0.05, 0.2, 0.3])
def test_the_consistent_set_is_consistent_at_other_periods(tick_s: float) -> None:
    """Means over 10 trials and 150 ticks; with the noise of a tick of 0.1 s added as it is they are 6 to 18."""
    observers = {"mekf": {"type": "mekf"}, "ekf": {"type": "ekf"}, "ukf": {"type": "ukf"}}
    settings = {"run.ticks": 180, "run.tick_s": tick_s, "run.seed": 4242, "observers": observers, "control.feedback": "mekf"}
    recording = run(build(load("nacs/fault-free", settings), np.arange(10)))
    for name in observers:
        assert 9.0 < np.mean(recording.channels[f"{name}/nees"][30:]) < 10.8
        assert 9.5 < np.mean(recording.channels[f"{name}/nis"][30:]) < 10.6


def test_a_set_of_a_paper_says_which_tick_it_is_meant_for() -> None:
    usual, slower = (load("nacs/fault-free", {"tuning": "paper", "run.tick_s": tick_s}) for tick_s in (0.1, 0.2))
    assert not usual.warnings()
    said = [line for line in slower.warnings() if "tuning" in line]
    assert len(said) == 5
    assert said[0] == "observers.ekf.tuning: its noises are those of a tick of 0.1 s and are added at every tick of 0.2 s as they are"
